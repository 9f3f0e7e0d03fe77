"""The folder that an export goes to is made where its parent stands."""

from __future__ import annotations

from pathlib import Path

import pytest

from identification import load_device
from tests.commands import FLUID, files, haptune
from tune import Scene, optimise


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scene = Scene.model_validate({"elements": {"water": {"damping": 10.0}}})
    text = optimise(load_device("homerehab"), scene).to_yaml()
    Path("profile.yaml").write_text(text, encoding="utf-8")
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")


def test_a_new_folder_is_made_and_used_again() -> None:
    for _ in range(2):
        ended = haptune("export", "profile.yaml", "--to", "c,ros2", "-o", "controller", "--json")
        assert ended.code == 0, ended.err
    made = {path.name for path in Path("controller").iterdir()}
    assert made == {
        f"haptune_{name}" for name in ("guard.h", "guard.c", "params.yaml", "law.py", "node.py")
    }


def test_a_dry_run_makes_no_folder() -> None:
    ended = haptune("export", "profile.yaml", "--to", "c", "-o", "controller", "--dry-run")
    assert ended.code == 0, ended.err
    assert "haptune_guard.h would be written" in ended.out
    assert files() == {"profile.yaml", "scene.yaml"}


def test_a_profile_that_is_refused_makes_no_folder() -> None:
    ended = haptune("export", "scene.yaml", "--to", "c", "-o", "controller")
    assert ended.code == 3
    assert files() == {"profile.yaml", "scene.yaml"}


@pytest.mark.parametrize("name", ["absent/deeper", "scene.yaml/below", "x" * 999])
def test_a_folder_that_cannot_be_made_is_said_so(name: str) -> None:
    ended = haptune("export", "profile.yaml", "--to", "c", "-o", name)
    assert ended.code == 7, ended.err
    assert ended.err.count("\n") == 1
    assert files() == {"profile.yaml", "scene.yaml"}
