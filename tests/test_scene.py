"""Scenes: what can be wanted, what the defaults are, what contradicts itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from identification import InvalidInputError
from tune.documents.perception import default_table, perception_of
from tune.documents.scene import LARGEST_GROUP, MARGINS, Motion, Scene, Wish, load_scene

WALL: dict[str, Any] = {"wall": {"stiffness": "max"}}


def _scene(**content: Any) -> Scene:
    return Scene.model_validate({"elements": WALL, **content})


def test_defaults_are_the_documented_ones() -> None:
    scene = _scene()
    assert (scene.hand, scene.margin, scene.perception) == ("none", "balanced", "default")
    assert scene.loop.velocity_filter_hz == scene.loop.acceleration_filter_hz == "free"
    assert scene.ripple_limit is None
    assert scene.elements["wall"].priority == 1
    assert {name: tuple(dict(margin).values()) for name, margin in MARGINS.items()} == {
        "conservative": (3.0, 2),
        "balanced": (2.0, 1),
        "firm": (1.5, 1),
    }


def test_motions_not_given_are_those_of_the_kind_of_axis() -> None:
    scene = _scene(elements={"wall": {"stiffness": "max", "speed": 0.5}})
    linear = Motion(penetration=0.01, speed=0.5, acceleration=2.0)
    rotary = Motion(penetration=0.1, speed=0.5, acceleration=20.0)
    assert scene.motion("wall", "linear") == linear
    assert scene.motion("wall", "rotary") == rotary


@pytest.mark.parametrize(
    ("effect", "written", "meant", "sign"),
    [
        ("stiffness", "max", Wish(kind="max"), 1),
        ("mass", "min", Wish(kind="min"), -1),
        ("damping", 10, Wish(kind="value", low=10, high=10), 1),
        ("damping", -2.5, Wish(kind="value", low=-2.5, high=-2.5), -1),
        ("stiffness", {"min": 200, "max": 1500}, Wish(kind="range", low=200, high=1500), 1),
        ("mass", {"min": 0, "max": 1}, Wish(kind="range", low=0, high=1), 1),
    ],
)
def test_wishes(effect: str, written: object, meant: Wish, sign: int) -> None:
    element = _scene(elements={"thing": {effect: written}}).elements["thing"]
    assert element.wishes() == {effect: meant}
    assert meant.sign == sign


#: what the refusal must say, an element
ELEMENTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("names no effect", {}),
    ("names no effect", {"stiffness": None, "speed": 1.0}),
    ("a negative stiffness is never stable", {"stiffness": "min"}),
    ("a negative stiffness is never stable", {"stiffness": -1.0}),
    ("0 asks for nothing", {"mass": 0}),
    ("give a number, max, min", {"mass": "maximum"}),
    ("give a number, max, min", {"mass": {"min": 1.0}}),
    ("give a number, max, min", {"mass": {"min": 1.0, "max": 2.0, "mean": 1.5}}),
    ("give a number, max, min", {"mass": [1.0, 2.0]}),
    ("min 2 exceeds max 1", {"mass": {"min": 2.0, "max": 1.0}}),
    ("starts at zero or above", {"mass": {"min": -1.0, "max": 1.0}}),
    ("beyond 1e-09 to 1e+09", {"mass": 1e-12}),
    ("true and false are no numbers", {"mass": True}),
    ("greater than or equal", {"mass": "max", "acceleration": 0}),
    ("greater than or equal", {"mass": "max", "priority": 0}),
    ("valid integer", {"mass": "max", "priority": 1.5}),
    ("Extra inputs", {"mass": "max", "weight": 1.0}),
)


@pytest.mark.parametrize(("words", "element"), ELEMENTS, ids=str)
def test_what_no_element_can_be(words: str, element: dict[str, Any]) -> None:
    with pytest.raises(ValidationError) as refused:
        _scene(elements={"thing": element})
    assert words in str(refused.value)


#: what the refusal must say, other keys of the scene
KEYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("at least 1", {"elements": {}}),
    ("free-to-rigid", {"hand": "soft"}),
    ("'conservative', 'balanced' or 'firm'", {"margin": "thin"}),
    ("a frequency in Hz, free or none", {"loop": {"velocity_filter_hz": "fast"}}),
    ("a frequency in Hz, free or none", {"loop": {"acceleration_filter_hz": [50]}}),
    ("must lie in", {"loop": {"velocity_filter_hz": 0.0}}),
    ("must lie in", {"loop": {"acceleration_filter_hz": -50}}),
    ("greater than or equal", {"ripple_limit": 0}),
    ("door, which is no element", {"together": [["wall", "door"]]}),
    ("two or more different", {"together": [["wall"]]}),
    ("two or more different", {"together": [["wall", "wall"]]}),
)


@pytest.mark.parametrize(("words", "keys"), KEYS, ids=str)
def test_what_no_scene_can_be(words: str, keys: dict[str, Any]) -> None:
    with pytest.raises(ValidationError) as refused:
        _scene(**keys)
    assert words in str(refused.value)


def test_subsets_are_every_sum_that_can_be_felt() -> None:
    elements = {name: {"damping": 1.0} for name in "abcd"}
    scene = _scene(elements=elements, together=[["c", "a", "b"], ["d", "a"]])
    expected = {("a",), ("b",), ("c",), ("d",)}
    expected |= {("a", "b"), ("a", "c"), ("b", "c"), ("a", "b", "c"), ("a", "d")}
    found = scene.subsets()
    assert set(found) == expected
    assert len(found) == len(expected)
    assert [len(subset) for subset in found] == sorted(len(subset) for subset in found)


def test_a_group_beyond_the_largest_is_refused() -> None:
    names = [f"e{k}" for k in range(LARGEST_GROUP + 1)]
    elements = {name: {"damping": 1.0} for name in names}
    scene = _scene(elements=elements, together=[names[1:]])
    assert len(scene.subsets()) == len(names) + 2**LARGEST_GROUP - 1 - LARGEST_GROUP
    with pytest.raises(ValidationError, match=f"more than {LARGEST_GROUP}"):
        _scene(elements=elements, together=[names])


def test_a_perception_table_is_found_beside_the_scene(tmp_path: Path) -> None:
    fraction = "{value: 0.5, source: mine}"
    names = ("stiffness", "damping", "mass", "force_threshold", "torque_threshold")
    table = "\n".join(f"{name}: {fraction}" for name in names)
    (tmp_path / "mine.yaml").write_text(table, encoding="utf-8")
    path = tmp_path / "scene.yaml"
    path.write_text("elements: {w: {stiffness: max}}\nperception: mine.yaml\n", encoding="utf-8")
    scene = load_scene(path)
    assert perception_of(scene, tmp_path).stiffness.value == 0.5
    assert perception_of(_scene(), tmp_path) == default_table()
    with pytest.raises(InvalidInputError, match=r"absent.yaml: cannot be read"):
        perception_of(_scene(perception="absent.yaml"), tmp_path)


def test_the_template_is_a_scene_and_shows_every_key(tmp_path: Path) -> None:
    from tests.commands import form

    path = tmp_path / "scene.yaml"
    path.write_text(form("scene"), encoding="utf-8")
    scene = load_scene(path)
    assert scene.model_fields_set == set(Scene.model_fields)
    shown = set[str]().union(*(element.model_fields_set for element in scene.elements.values()))
    # What binds or changes walls where it is stated is shown without stating it.
    for line in ("# penetration: 0.01", "# lead: 0.001", "# favour: both"):
        assert line in form("scene")
    shown |= {"penetration", "lead", "favour"}
    assert shown == set(type(scene.elements["wall"]).model_fields)
