"""Every code cell of every notebook runs, in order, in one namespace, and says what it should."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[1] / "notebooks"


def _run(name: str) -> dict[str, Any]:
    cells = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    namespace: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), namespace)  # noqa: S102
    return namespace


def test_every_notebook_has_a_test() -> None:
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == {"first_steps", "paper_figures"}


def test_first_steps_ends_with_a_checked_profile(capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("first_steps")["report"].certificate.points > 0
    assert "points certified" in capsys.readouterr().out


def test_the_positive_region_is_nearly_a_cube_of_side_two() -> None:
    """The paper's remark on figure 5: true to a per cent, and not exactly."""
    reach = _run("paper_figures")["reach"]
    assert reach == pytest.approx([2, 2, 2], rel=0.05)
