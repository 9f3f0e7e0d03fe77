"""Every notebook runs in a real kernel, says what it should and shows its figures as pictures."""

from __future__ import annotations

import os
import re
import warnings
from base64 import b64decode
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from identification import NotebookFigure

ROOT = Path(__file__).parents[1]
PNG = b"\x89PNG\r\n\x1a\n"
#: Notebook and how many figures it shows.
FIGURES = {"first_steps": 3, "paper_figures": 2}


def _outputs(name: str, folder: Path) -> list[Any]:
    """What the cells of a notebook put out, in order, run in ``folder`` with the code of here."""
    notebook: Any = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}})
    with warnings.catch_warnings():
        # What the kernel's own libraries announce to one another is no affair of a notebook.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.filterwarnings("ignore", "Proactor event loop")  # on Windows
        client.execute(env={**os.environ, "PYTHONPATH": str(ROOT)})
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def _figures_and_text(name: str, folder: Path) -> tuple[list[bytes], str]:
    outputs = _outputs(name, folder)
    data = [output["data"] for output in outputs if "data" in output]
    figures = [b64decode(each["image/png"]) for each in data if "image/png" in each]
    bare = [each for each in data if "image/png" not in each and "Figure" in str(each)]
    assert not bare, "a figure is shown by its name"
    assert all(figure.startswith(PNG) for figure in figures)
    return figures, "".join(output["text"] for output in outputs if "text" in output)


def test_every_notebook_has_a_test() -> None:
    assert {path.stem for path in (ROOT / "notebooks").glob("*.ipynb")} == set(FIGURES)


def test_first_steps_ends_with_a_checked_profile(tmp_path: Path) -> None:
    figures, text = _figures_and_text("first_steps", tmp_path)
    assert len(figures) == FIGURES["first_steps"]
    assert re.search(r"^[1-9]\d* points certified", text, re.MULTILINE)


def test_the_positive_region_is_nearly_a_cube_of_side_two(tmp_path: Path) -> None:
    """The paper's remark on figure 5: true to a per cent, and not exactly."""
    figures, text = _figures_and_text("paper_figures", tmp_path)
    assert len(figures) == FIGURES["paper_figures"]
    reach = [float(number) for number in text.partition("= [")[2].partition("]")[0].split()]
    assert reach == pytest.approx([2, 2, 2], rel=0.05)


def test_a_figure_made_without_pyplot_knows_its_picture() -> None:
    figure = NotebookFigure(figsize=(1, 1))
    assert figure._repr_png_().startswith(PNG)  # pyright: ignore[reportPrivateUsage]
