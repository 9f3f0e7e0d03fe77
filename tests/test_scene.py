"""Scenes: what can be wanted, what the defaults are, what contradicts itself."""

import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from tune import Scene, load_scene
from tune.documents.scene import Motion

WALL: dict[str, Any] = {"wall": {"stiffness": "max"}}


def _scene(**content: Any) -> Scene:
    return Scene.model_validate({"elements": WALL, **content})


def test_defaults_are_the_documented_ones() -> None:
    scene = _scene()
    assert (scene.hand, scene.margin, scene.perception) == ("none", "balanced", "default")
    assert scene.loop.velocity_filter_hz == scene.loop.acceleration_filter_hz == "free"
    assert scene.ripple_limit is None
    assert scene.elements["wall"].priority == 1


def test_motions_not_given_are_those_of_the_kind_of_axis() -> None:
    scene = _scene(elements={"wall": {"stiffness": "max", "speed": 0.5}})
    linear = Motion(penetration=0.01, speed=0.5, acceleration=2.0)
    rotary = Motion(penetration=0.1, speed=0.5, acceleration=20.0)
    assert scene.motion("wall", "linear") == linear
    assert scene.motion("wall", "rotary") == rotary


def test_subsets_are_every_sum_that_can_be_felt() -> None:
    elements = {name: {"damping": 1.0} for name in "abcd"}
    scene = _scene(elements=elements, together=[["c", "a", "b"], ["d", "a"]])
    expected = {("a",), ("b",), ("c",), ("d",)}
    expected |= {("a", "b"), ("a", "c"), ("b", "c"), ("a", "b", "c"), ("a", "d")}
    found = scene.combinations()
    assert set(found) == expected
    assert len(found) == len(expected)
    assert [len(subset) for subset in found] == sorted(len(subset) for subset in found)


def test_a_group_beyond_the_largest_is_refused() -> None:
    names = [f"e{k}" for k in range(11)]
    elements = {name: {"damping": 1.0} for name in names}
    scene = _scene(elements=elements, together=[names[1:]])
    assert len(scene.combinations()) == len(names) + 1013
    with pytest.raises(ValidationError, match="more than 10"):
        _scene(elements=elements, together=[names])


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


@pytest.mark.parametrize("device", [None, "homerehab", "knob"])
def test_each_optional_line_of_the_form_may_be_uncommented(
    device: str | None, tmp_path: Path
) -> None:
    from tests.commands import form

    path = tmp_path / "scene.yaml"
    text = form("scene", *([] if device is None else ["--device", device]))
    lines = text.splitlines()
    optional = [k for k, line in enumerate(lines) if re.match(r" *# \w+: ", line)]
    assert len(optional) == 8 + (device is not None)
    for k in optional:
        with_it = [*lines[:k], lines[k].replace("# ", "", 1), *lines[k + 1 :]]
        path.write_text("\n".join(with_it), encoding="utf-8")
        load_scene(path)
    lead = r"# lead: 0.01 +# how far before its face \(rad\)"
    assert bool(re.search(lead, text)) == (device == "knob")
