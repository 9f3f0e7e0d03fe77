"""The shipped JSON Schemas are those of the models, and say what the models say."""

import copy
import json
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from pydantic import ValidationError

from identification import (
    Device,
    Document,
    ExcitationSpec,
    Hardware,
    load_device,
    named_devices,
    to_mapping,
)
from tests.commands import SCHEMAS, form
from tune import PerceptionTable, SafeProfile, Scene, optimise
from tune.schemas.__main__ import generate

MODELS: dict[str, type[Document]] = {
    "hardware": Hardware,
    "device": Device,
    "scene": Scene,
    "excitation": ExcitationSpec,
    "perception": PerceptionTable,
    "profile": SafeProfile,
}


def _validator(name: str) -> Draft202012Validator:
    return Draft202012Validator(json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8")))


def _parsed(text: str) -> Any:
    from ruamel.yaml import YAML

    reader: Any = YAML(typ="safe", pure=True)
    return reader.load(text)


def test_shipped_schemas_are_up_to_date() -> None:
    """If not: python -m tune.schemas."""
    assert {f"{name}.json" for name in (*MODELS, "export", "manifest", "result")} == set(generate())
    assert set(generate()) == {path.name for path in SCHEMAS.glob("*.json")}
    for name, text in generate().items():
        assert json.loads((SCHEMAS / name).read_text(encoding="utf-8")) == json.loads(text), name
    for name in MODELS:
        schema: Any = _validator(name).schema
        Draft202012Validator.check_schema(schema)
        assert schema["properties"]["schema"]["const"] == f"haptune/{name}/1"
        assert schema["additionalProperties"] is False


def test_what_haptune_writes_and_ships_is_valid() -> None:
    _validator("scene").validate(_parsed(form("scene")))
    _validator("hardware").validate(_parsed(form("hardware")))
    for name in named_devices():
        _validator("excitation").validate(_parsed(form("excitation", "--device", name)))
    text = (files("tune") / "data" / "homerehab_study.yaml").read_text(encoding="utf-8")
    _validator("perception").validate(_parsed(text))
    for name in named_devices():
        _validator("hardware").validate(_parsed(form("hardware", "--device", name)))
        _validator("scene").validate(_parsed(form("scene", "--device", name)))
        _validator("device").validate(to_mapping(load_device(name)))
    profile = optimise(
        load_device("homerehab"), Scene.model_validate({"elements": {"w": {"stiffness": "max"}}})
    )
    _validator("profile").validate(_parsed(profile.to_yaml()))


SCENE: dict[str, Any] = {
    "elements": {"wall": {"stiffness": "max", "speed": 0.2}, "cup": {"mass": {"min": 1, "max": 2}}},
    "together": [["wall", "cup"]],
    "loop": {"velocity_filter_hz": "free"},
}
DEVICE: dict[str, Any] = {
    "sample_time": 0.001,
    "mass": {"value": 3.0, "low": 2.7, "high": 3.3, "source": "log"},
    "damping": 10,
    "force_limit": {"continuous": 1.0, "peak": 2.0},
    "covariance": {"parameters": ["coulomb_friction"], "matrix": [[1.0]], "degrees_of_freedom": 9},
}
HARDWARE: dict[str, Any] = {"sample_time": {"value": 0.001}, "delay": 0}


def _put(where: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(content: dict[str, Any]) -> None:
        *above, last = where.split("/")
        for key in above:
            content = content[key]
        if value is ...:
            del content[last]
        else:
            content[last] = value

    return change


PAIRS = ({"forward": 9, "backward": {"value": 11, "low": 10, "high": 12}}, None)
NO_PAIRS = ({"forward": 9}, {"forward": 9, "backward": 11, "up": 1}, 9, [9, 11])

#: file, place, value (... takes the key away), whether it is allowed
CASES: tuple[tuple[str, str, Any, bool], ...] = (
    *(("scene", "elements/wall/stiffness", wish, True) for wish in ("max", 5, 0.5)),
    *(("scene", "elements/wall/stiffness", wish, False) for wish in ("min", 0, -5, True, {}, ...)),
    ("scene", "elements/cup/mass", {"min": -1, "max": 2}, False),
    ("scene", "elements/cup/mass", {"min": 0, "max": 2, "mean": 1}, False),
    ("scene", "elements/wall/sped", 1, False),
    ("scene", "elements", {}, False),
    ("scene", "margin", "thin", False),
    ("scene", "hand", {"mass": 1}, False),
    ("scene", "schema", "haptune/scene/2", False),
    *(("scene", "loop/velocity_filter_hz", f, True) for f in ("none", "free", 49.5)),
    *(("scene", "loop/velocity_filter_hz", f, False) for f in ("fast", 0, True, [50])),
    *(("device", "mass", q, True) for q in (3, 3.5, {"value": 3})),
    *(("device", "mass", {"value": 3, end: 3}, False) for end in ("low", "high")),
    *(("device", "mass", q, False) for q in ("3", True, None, {}, {"low": 2}, [3])),
    ("device", "delay", 0, True),
    ("device", "force_limit/peak", ..., False),
    ("device", "covariance/degrees_of_freedom", 0, False),
    ("device", "encoder_resolution", {"value": 0}, False),
    *((("device", "damping_by_direction", both, True)) for both in PAIRS),
    *((("device", "damping_by_direction", one, False)) for one in NO_PAIRS),
    ("device", "gravity", {"sine": 1.5}, False),
    ("hardware", "sample_time", ..., True),
    ("hardware", "encoder_resolution", {"value": 1e-6, "low": -9e-7, "high": 1e-6}, False),
    ("hardware", "mass", 3, False),
)


@pytest.mark.parametrize(("name", "where", "value", "allowed"), CASES, ids=str)
def test_schema_and_model_say_the_same(name: str, where: str, value: Any, allowed: bool) -> None:
    start = {"scene": SCENE, "device": DEVICE, "hardware": HARDWARE}[name]
    content = copy.deepcopy(start)
    assert _validator(name).is_valid(content)
    _put(where, value)(content)
    assert _validator(name).is_valid(content) is allowed
    if allowed:
        MODELS[name].model_validate(content)
    else:
        with pytest.raises(ValidationError):
            MODELS[name].model_validate(content)
