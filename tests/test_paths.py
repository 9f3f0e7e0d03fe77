"""A file is named by text or by any path object, wherever a public function takes one."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import identification
import tune
from identification import InvalidInputError, Replaced
from tests.commands import FLUID, form, log_text


@dataclass(frozen=True)
class Named:
    """A path object that is no Path."""

    text: str

    def __fspath__(self) -> str:
        return self.text


REPLACED = Replaced(content=b"before", backup=Path("difference_of.yaml.bak"))

#: Every public function that reads or writes a file, called on one that stands there.
CALLS: dict[str, Callable[[Any], object]] = {
    "check": tune.check,
    "difference_of": lambda path: identification.difference_of(path, REPLACED, "after"),
    "load_device": identification.load_device,
    "load_document": lambda path: identification.load_document(tune.Scene, path),
    "load_excitation": identification.load_excitation,
    "load_mapping": identification.load_mapping,
    "load_profile": tune.load_profile,
    "load_scene": tune.load_scene,
    "load_trajectory": identification.load_trajectory,
    "write_bytes": lambda path: identification.write_bytes(path, b"written"),
    "write_files": lambda path: identification.write_files({Path(path): b"written"}),
    "write_text": lambda path: identification.write_text(path, "written"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A file to be read by each function, and none for those that write."""
    device = identification.load_device("homerehab")
    scene = tune.Scene.model_validate({"elements": {"water": {"damping": 10.0}}})
    profile = tune.optimise(device, scene).to_yaml()
    texts = {
        "check": profile,
        "load_device": identification.to_yaml(identification.to_mapping(device)),
        "load_document": FLUID,
        "load_excitation": form("excitation", "--device", "homerehab"),
        "load_mapping": FLUID,
        "load_profile": profile,
        "load_scene": FLUID,
        "load_trajectory": log_text(),
    }
    for name, text in texts.items():
        (tmp_path / _file(name)).write_text(text, encoding="utf-8")
    return tmp_path


def _file(name: str) -> str:
    return name + (".csv" if name == "load_trajectory" else ".yaml")


def test_text_and_path_objects_name_the_same_file(folder: Path) -> None:
    for name, call in CALLS.items():
        path = folder / _file(name)
        for given in (str(path), path, Named(str(path))):
            call(given)
    assert identification.load_device(Named("homerehab")).name == "homerehab"


def test_every_public_function_that_takes_a_path_is_called_here() -> None:
    public = [getattr(home, name) for home in (identification, tune) for name in home.__all__]
    taking = {
        each.__name__
        for each in public
        if inspect.isfunction(each)
        and any("Path" in str(kind) for kind in each.__annotations__.values())
    }
    # This one is given the content; the name is for its messages.
    assert taking - {"parse_document"} == set(CALLS)


@pytest.mark.parametrize("given", ["missing.yaml", Path("missing.yaml"), Named("missing.yaml")])
def test_messages_name_the_file_as_it_was_given(given: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"^missing.yaml: cannot be read"):
        tune.load_scene(given)
