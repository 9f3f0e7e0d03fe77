"""``import haptune``: six verbs and their documents, and no other project's tune in their place."""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import haptune

ROOT = Path(__file__).parents[1]
VERBS = ("identify", "optimise", "audit", "check", "verify", "export")


@pytest.mark.parametrize("name", VERBS)
def test_verbs_are_typed_functions(name: str) -> None:
    verb = getattr(haptune, name)
    assert inspect.isfunction(verb)
    signature = inspect.signature(verb)
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty
    assert verb.__doc__


def test_every_public_name_is_there() -> None:
    assert dir(haptune) == sorted(haptune.__all__)
    assert set(VERBS) <= set(haptune.__all__)
    for name in haptune.__all__:
        assert getattr(haptune, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'solve'"):
        _ = haptune.solve  # type: ignore[attr-defined]


def test_importing_it_loads_nothing() -> None:
    code = "import haptune, sys; assert not {'numpy', 'tune', 'identification'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_a_tune_of_another_project_is_told(tmp_path: Path) -> None:
    """Its __init__ stands in the place of ours, as two installations in one folder leave it."""
    (tmp_path / "tune").mkdir()
    (tmp_path / "tune" / "__init__.py").write_text("best = 1\n", encoding="utf-8")
    shutil.copytree(ROOT / "tune" / "cli", tmp_path / "tune" / "cli")
    for code in ("from tune.cli import main; main()", "from haptune import optimise"):
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        )
        assert done.returncode == 1
        assert "belongs to another project" in done.stderr
        assert "virtual environment of its own" in done.stderr
