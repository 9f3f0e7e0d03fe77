"""Wrong scene files end in one sentence that names the file, the key and what is allowed."""

from pathlib import Path

import pytest

from identification import InvalidInputError
from tune import load_scene

WALL = "elements: {wall: {stiffness: max}}\n"
#: what the sentence must say, and the file
FILES: tuple[tuple[tuple[str, ...], str], ...] = (
    (("elements",), "name: nothing\n"),
    (("elements", "give a mapping"), "elements: []"),
    (("elements.wall", "give a mapping of keys"), "elements: {wall: max}"),
    (("elements.wall.stiffnes", "did you mean stiffness"), "elements: {wall: {stiffnes: max}}"),
    (
        ("wall.stiffness", "give a number, max, min", "10 N/m"),
        "elements: {wall: {stiffness: 10 N/m}}",
    ),
    (("wall.stiffness", "0 asks for nothing"), "elements: {wall: {stiffness: -0.0}}"),
    (("duplicate key", "stiffness"), "elements: {wall: {stiffness: max, stiffness: 3.0}}"),
    (("wall.penetration", "less than"), "elements: {wall: {stiffness: max, penetration: 1e12}}"),
    (("cup", "one_sided is for walls"), "elements: {cup: {damping: 3.0, one_sided: true}}"),
    (
        ("wall", "only pushes", "an element of their own"),
        "elements: {wall: {stiffness: max, mass: max, one_sided: true}}",
    ),
    (
        ("wall", "fade_time 0.2 has nothing to fade", "leave it out"),
        "elements: {wall: {stiffness: max, damping: 3.0, fade_time: 0.2}}",
    ),
    (("cup.fade_time", "equal to 0.1"), "elements: {cup: {mass: max, fade_time: 0.001}}"),
    (("hand.damping: is missing", "hand.stiffness: is missing"), WALL + "hand: {mass: 1}"),
    (("hand", "must not be negative", "-1"), WALL + "hand: {mass: -1, damping: 1, stiffness: 1}"),
    (
        ("hand", "above zero over its interval", "0 to 2"),
        WALL + "hand: {mass: 1, damping: 1, stiffness: {value: 1, low: 0, high: 2}}",
    ),
    (("margin", "'balanced'", "Balanced"), WALL + "margin: Balanced"),
    (
        ("loop.velocity_filter", "did you mean velocity_filter_hz"),
        WALL + "loop: {velocity_filter: 50}",
    ),
    (("velocity_filter_hz", "in Hz, free or none"), WALL + "loop: {velocity_filter_hz: null}"),
    (("loop: velocity_filter_order", "1 or 2"), WALL + "loop: {velocity_filter_order: 3}"),
    (("loop.filter_damping_ratio", "equal to 1"), WALL + "loop: {filter_damping_ratio: 1.1}"),
    (("loop.velocity_window_samples", "to 20"), WALL + "loop: {velocity_window_samples: 21}"),
    (
        ("velocity_window_samples", "takes the place", "leave out velocity_filter_hz: 50"),
        WALL + "loop: {velocity_window_samples: 5, velocity_filter_hz: 50}",
    ),
    (("together", "'wall'"), WALL + "together: wall"),
    (("velocity_filter: give low-pass, tracking or free (",), WALL + "loop: {velocity_filter: b}"),
    (("hand.mass: give a number or",), WALL + "hand: {mass: [1, 2], damping: 1, stiffness: 1}"),
    (("elements has the key 1, no text: put it in quotes",), "elements: {1: {stiffness: max}}"),
    (("together needs two or more",), WALL + "together: [[]]"),
    (("two or more different elements, not [wall]",), WALL + "together: [[wall]]"),
    (("together names door, which is no element",), WALL + "together: [[wall, door]]"),
    (("apart needs two different elements",), WALL + "apart: [[wall, wall]]"),
    (
        ("wall and water are both together and apart",),
        "elements: {wall: {stiffness: max}, water: {damping: max}}\n"
        "together: [[wall, water]]\napart: [[wall, water]]",
    ),
    (("an element is named ' '", "give it a word"), "elements: {' ': {stiffness: max}}"),
    (("min 5 exceeds max 3",), "elements: {wall: {stiffness: {min: 5, max: 3}}}"),
    (("lead is for walls", "one_sided: true"), "elements: {wall: {stiffness: max, lead: 0.001}}"),
    (("hand", "give none, free-to-rigid"), WALL + "hand: firm"),
    (("schema is 'haptune/scene/2'", "'haptune/scene/1'"), "schema: haptune/scene/2\n" + WALL),
    (("colour", "no key known"), WALL + "colour: red"),
)


@pytest.mark.parametrize(("words", "text"), FILES, ids=lambda value: str(value)[-60:])
def test_a_wrong_scene_is_refused_in_a_sentence(
    words: tuple[str, ...], text: str, tmp_path: Path
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError) as refused:
        load_scene(path)
    sentence = str(refused.value)
    assert sentence.startswith(f"{path}: ")
    assert "\n" not in sentence
    for word in words:
        assert word in sentence


def test_every_mistake_of_a_file_is_named_at_once(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        "margin: thin\nripple_limit: 0\nelements: {wall: {stiffness: min, speed: 0}, cup: {}}\n",
        encoding="utf-8",
    )
    with pytest.raises(InvalidInputError) as refused:
        load_scene(path)
    for key in ("margin", "ripple_limit", "elements.wall.speed", "elements.cup"):
        assert f"{key}: " in str(refused.value)


def test_numbers_that_mean_the_same_are_read_alike(tmp_path: Path) -> None:
    """YAML 1.1 readers take 1e3 for text; written either way it is the same wish."""
    path = tmp_path / "scene.yaml"
    read: list[object] = []
    for number in ("1000", "1000.0", "1.0e+3", "1_000"):
        path.write_text(f"elements: {{wall: {{stiffness: {number}}}}}\n", encoding="utf-8")
        read.append(load_scene(path).elements["wall"].stiffness)
    assert all(wish == read[0] for wish in read)
