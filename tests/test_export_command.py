"""``haptune export``: what it writes where, and what it refuses."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import pytest

from identification import to_mapping, to_yaml
from tests.commands import digest_of, files, haptune
from tests.exported import tuned
from tune import export
from tune.exporters import TARGETS

ALL = {
    "haptune_guard.c",
    "haptune_guard.h",
    "haptune_chai3d.hpp",
    "haptune_law.py",
    "haptune_node.py",
    "haptune_params.yaml",
    "haptune_profile.json",
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("profile.yaml").write_text(tuned().to_yaml(), encoding="utf-8")
    return tmp_path


def test_several_targets_are_written_atomically_with_backup_and_difference(here: Path) -> None:
    ended = haptune("export", "profile.yaml", "--to", "ros2,c", "--to", "json", "--to", "chai3d")
    assert (ended.code, ended.err) == (0, "")
    assert files() == {"profile.yaml", *ALL}
    for target in TARGETS:
        for name, text in export(tuned(), target).items():
            assert Path(name).read_text(encoding="utf-8") == text
    Path("haptune_guard.c").write_text("int mine;\n", encoding="utf-8")
    ended = haptune("export", "profile.yaml", "--to", "c")
    assert "-int mine;" in ended.out
    assert Path("haptune_guard.c.bak").read_text(encoding="utf-8") == "int mine;\n"


def test_a_folder_and_json(here: Path) -> None:
    Path("there").mkdir()
    ended = haptune("export", "profile.yaml", "--to", "json", "-o", "there", "--json")
    assert ended.result["outputs"] == [str(Path("there") / "haptune_profile.json")]
    assert files() == {"profile.yaml", "there"}


def test_a_dry_run_shows_and_writes_nothing(here: Path) -> None:
    ended = haptune("export", "profile.yaml", "--to", "c", "--dry-run")
    assert ended.code == 0
    assert "double haptune_force(" in ended.out
    assert files() == {"profile.yaml"}


def _forged(where: str, value: Any) -> str:
    """A profile whose digest is right and whose certificate is not."""
    content = to_mapping(tuned())
    *above, last = where.split(".")
    functools.reduce(lambda part, key: part[key], above, content)[last] = value
    content["digest"] = digest_of(content)
    return to_yaml(content)


@pytest.mark.parametrize(
    ("code", "words", "arguments"),
    [
        (6, "was changed after it was certified", "changed.yaml --to c"),
        (6, "unstable", "forged.yaml --to c,json"),
        (2, "'matlab' is no target. Choose from ros2, c, chai3d, json", "profile.yaml --to matlab"),
        (2, "'' is no target", "profile.yaml --to c,"),
        (2, "--to", "profile.yaml"),
        (2, "PROFILE", "--to c"),
        (2, "one of the inputs", "haptune_profile.json --to json"),
        (3, "No such file", "missing.yaml --to c"),
        (3, "is not valid YAML", "torn.yaml --to c"),
        (7, "there is no folder", "profile.yaml --to c -o absent/deeper"),
        (7, "there is no folder", "profile.yaml --to c -o torn.yaml"),
        (7, "it is a folder", "profile.yaml --to ros2,json -o full"),
    ],
)
def test_a_refusal_has_its_code_and_writes_nothing(
    here: Path, code: int, words: str, arguments: str
) -> None:
    text = tuned().to_yaml()
    Path("haptune_profile.json").write_text(text, encoding="utf-8")
    changed_text = text.replace("stiffness: 500.0", "stiffness: 501.0", 1)
    Path("changed.yaml").write_text(changed_text, encoding="utf-8")
    forged = _forged("elements.wall.damping", -50.0)
    Path("forged.yaml").write_text(forged, encoding="utf-8")
    Path("torn.yaml").write_text("{", encoding="utf-8")
    (here / "full" / "haptune_profile.json").mkdir(parents=True)
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}
    ended = haptune("export", *arguments.split(), "--json")
    assert ended.code == code
    assert words.lower() in ended.err.lower()
    assert ended.result["outputs"] == []
    assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before


def test_a_folder_is_made_where_its_parent_stands_and_used_again(here: Path) -> None:
    for _ in range(2):
        ended = haptune("export", "profile.yaml", "--to", "c,ros2", "-o", "controller", "--json")
        assert ended.code == 0, ended.err
    made = {path.name for path in Path("controller").iterdir()}
    assert made == ALL - {"haptune_chai3d.hpp", "haptune_profile.json"}


@pytest.mark.parametrize("name", ["absent/deeper", "profile.yaml/below", "x" * 999])
def test_a_folder_that_cannot_be_made_is_said_so(here: Path, name: str) -> None:
    ended = haptune("export", "profile.yaml", "--to", "c", "-o", name)
    assert ended.code == 7, ended.err
    assert ended.err.count("\n") == 1
    assert files() == {"profile.yaml"}
