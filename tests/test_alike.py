"""Elements that are alike play the same, however many there are; what is written of them holds."""

from typing import Any

import pytest

from identification import load_device, to_mapping
from tune import optimise
from tune.certificate.check import check_content
from tune.documents import CheckFailedError
from tune.documents.profile import SafeProfile
from tune.documents.scene import Scene

WALL = {"stiffness": "max", "damping": "max", "one_sided": True}
WATER, RUBBER = {"damping": 10.0}, {"stiffness": 800.0}
FIXED = {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0}


def tuned(elements: dict[str, Any], device: str = "homerehab", **more: Any) -> SafeProfile:
    more = {"loop": FIXED, **more}
    return optimise(load_device(device), Scene.model_validate({"elements": elements, **more}))


def test_a_maze_of_equal_walls_has_the_effects_of_one() -> None:
    """Half of the walls are not met with the spring, in which they differ from the others."""
    one = tuned({"a": WALL, "w": WATER, "b": WALL, "r": RUBBER}, apart=[["b", "r"]])
    walls = {f"{'ab'[k % 2]}{k}": WALL for k in range(4)}
    apart = [[name, "r"] for name in walls if name[0] == "b"]
    elements = {"a": WALL, "w2": WATER, **walls, "r": RUBBER, "w": WATER, "b": WALL}
    many = tuned(elements, apart=[*apart, ["b", "r"]])
    assert list(many.elements) == list(elements)
    assert all(many.elements[name] == one.elements[name[0]] for name in elements)
    assert len(many.combinations()) == 9 + 6 * 2 + 3
    assert {
        "a": "proved",
        "w2": "proved",
        "b1": "proved",
    }.items() <= many.certificate.interior.items()
    assert len(many.certificate.interior) == len(one.certificate.interior)
    content = to_mapping(many)
    assert len(check_content(content, "many").profile.elements) == 9
    assert many.certificate.cells == one.certificate.cells


def test_one_that_is_not_what_the_others_are_is_proved_by_itself() -> None:
    """An element changed after it was certified as another is refused."""
    content = to_mapping(tuned({f"w{k}": WATER for k in range(3)}))
    assert content["certificate"]["interior"] == {"w0": "proved"}
    content["elements"]["w2"]["damping"] = 2.0e3
    with pytest.raises(CheckFailedError, match="w2"):
        check_content(content, "changed")
    content = to_mapping(tuned({f"w{k}": WATER for k in range(3)}))
    content["elements"]["w2"]["limited_by"] = {"damping": "range"}
    with pytest.raises(CheckFailedError, match="does not say that w2 is proved"):
        check_content(content, "changed")


def test_what_is_told_of_one_is_told_of_all_that_are_alike() -> None:
    """Pairs that are kept apart, what is dropped, and what is less than was wanted."""
    one = {"water": {"damping": 8.0}, "wall": WALL, "dust": {"damping": 0.01}}
    loop = {"velocity_filter_hz": 400.0}
    few = tuned(one, "stylus", loop=loop)
    both = {f"{name}{k}": element for k in (1, 2) for name, element in one.items()}
    many = tuned(both, "stylus", loop=loop)
    assert few.apart == (("water", "wall"),)
    assert {frozenset(pair) for pair in many.apart} == {
        frozenset((f"wall{i}", f"water{j}")) for i in (1, 2) for j in (1, 2)
    }
    told = [note for note in few.notes if note.startswith("dust.damping dropped")]
    assert len(told) == 1
    for note in (told[0].replace("dust", f"dust{k}") for k in (1, 2)):
        assert note in many.notes
    assert sum(note.startswith("kept apart: ") for note in many.notes) == 4
    check_content(to_mapping(many), "many")
