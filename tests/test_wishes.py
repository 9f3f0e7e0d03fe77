"""Wishes: none is granted above the largest there is, and what is not met is said with numbers."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import Device, load_device, to_mapping, to_yaml
from tests.commands import haptune
from tests.devices import device_of, known
from tune import NoFeasibleEffectError, SafeProfile, Scene, load_scene, optimise

#: Written values have six digits; of cut-offs that do nearly as well the least filtering is taken.
DIGITS, NEARLY = 1e-5, 0.01
FILTERS: dict[str, Any] = {"velocity_filter_hz": 60.0, "acceleration_filter_hz": 30.0}
LOW_PASS = {"acceleration_filter": "low-pass"}
LOW = LOW_PASS | {"velocity_filter": "low-pass"}


def _tuned(elements: dict[str, Any], device: str = "homerehab", **scene: Any) -> SafeProfile:
    return optimise(load_device(device), Scene.model_validate({"elements": elements, **scene}))


def _size(effect: str, wish: object, device: str, **scene: Any) -> float:
    """What is granted of one effect; 0 where it is refused."""
    try:
        played = _tuned({"it": {effect: wish}}, device, **scene).elements["it"]
    except NoFeasibleEffectError:
        return 0.0
    return getattr(played, effect)


@pytest.mark.parametrize("wanted", [1.0, 3.0, "max"])
def test_a_mass_that_is_felt_as_damping_is_refused_for_that_and_told_as_what(
    wanted: object,
) -> None:
    """Two low-pass poles turn a part of it into damping, at 5 Hz half of the device's own."""
    with pytest.raises(NoFeasibleEffectError) as caught:
        _tuned({"it": {"mass": wanted}}, loop=LOW_PASS)
    told = str(caught.value)
    assert "limited by rendering" in told
    found = re.search(r"with (\S+) kg a hand would feel .* and \S+ to (\S+) N·s/m of damp", told)
    assert found
    mass, damping = map(float, found.groups())
    assert mass == (wanted if wanted != "max" else pytest.approx(3.0 * 0.225, rel=0.01))
    # A step of the 10 N·s/m that the device has is 27 %.
    assert damping > 0.27 * 10.0
    assert "for damping beside it" in told


def test_a_spring_that_takes_too_much_damping_away_is_as_stiff_as_the_stiffest() -> None:
    most = _tuned({"it": {"stiffness": "max"}}).elements["it"].stiffness
    profile = _tuned({"it": {"stiffness": 3000.0}})
    assert profile.elements["it"].stiffness == most
    (note,) = profile.notes
    # A delay of a sample, and half a sample of the hold: 1.5 ms.
    assert note.startswith(f"it.stiffness: 3000 N/m is asked for, {most:.4g} N/m is played")
    assert "with 3000 N/m a hand would feel -4.5 to -4.5 N·s/m of damping" in note


@pytest.mark.parametrize(
    "spring",
    [{"stiffness": "max"}, {"stiffness": "max", "one_sided": True}, {"stiffness": 9000.0}],
    ids=lambda spring: " ".join(map(str, spring.values())),
)
def test_a_spring_that_only_the_device_holds_is_told_to_ask_for_damping_which_helps(
    spring: dict[str, Any],
) -> None:
    alone = _tuned({"it": spring})
    (note,) = alone.notes
    assert f"{alone.elements['it'].stiffness:.4g} N/m" in note
    assert re.search("or for damping|Ask for damping in the same element", note)
    beside = _tuned({"it": spring | {"damping": "max"}}, loop={"velocity_filter_hz": 100.0})
    assert beside.elements["it"].stiffness > 2 * alone.elements["it"].stiffness
    assert not any("Ask for damping" in each for each in beside.notes)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("device", ["homerehab", "stylus", "knob"])
def test_the_first_scene_of_a_device_asks_for_what_a_hand_can_tell(device: str) -> None:
    assert haptune("new", "scene", "--device", device).code == 0
    wanted = load_scene("scene.yaml").elements
    asked = {name: {"damping": wanted[name].damping} for name in ("water", "cup")}
    profile = _tuned(asked | {"rubber": wanted["rubber"]}, device, loop=FILTERS)
    assert not any("not-as-wanted" in note or "dropped" in note for note in profile.notes)
    for name in ("water", "cup", "rubber"):
        element = profile.elements[name]
        assert max(element.perceived_steps.values()) > 1.9, name  # two, by a value of two digits
        assert element.damping == pytest.approx(getattr(wanted[name].damping, "high", 0.0))


@pytest.mark.parametrize("effect", ["stiffness", "damping", "mass"])
@pytest.mark.parametrize("device", ["homerehab", "knob"])
def test_no_wish_is_granted_above_the_largest(device: str, effect: str) -> None:
    scene = {"loop": FILTERS | {"acceleration_filter": "tracking"}, "margin": "firm"}
    most = _size(effect, "max", device, **scene)
    for part in (0.9, 1.001, 10.0):
        granted = _size(effect, part * (most or 1.0), device, **scene)
        assert granted <= most * (1 + DIGITS)
        assert part > 1 or granted == pytest.approx(part * most, rel=DIGITS)


@pytest.mark.long
def test_none_of_300_random_wishes_is_granted_above_the_largest() -> None:
    """Free cut-offs and stated ones; beside a damper or alone."""
    rng = np.random.default_rng(32)
    for number in range(300):
        device = str(rng.choice(["homerehab", "stylus", "knob"]))
        own = load_device(device)
        effect = str(rng.choice(["stiffness", "damping", "mass"]))
        scene: dict[str, Any] = {"margin": str(rng.choice(["conservative", "balanced", "firm"]))}
        free = bool(rng.integers(2))
        if not free:
            cutoffs = np.exp(rng.uniform(np.log(10), np.log(200), 2))
            scene["loop"] = dict(zip(FILTERS, map(float, cutoffs), strict=True))
        beside = {}
        if effect != "damping" and rng.integers(2):
            beside = {"damping": float(own.damping.value * rng.uniform(0.5, 4))}
        usual = {"stiffness": 1e3, "damping": own.damping.value, "mass": own.mass.value}[effect]
        usual *= own.mass.value / 3 if effect == "stiffness" else 1
        wish = float(usual * np.exp(rng.uniform(np.log(0.1), np.log(30))))
        try:
            it = _tuned({"it": {effect: wish, **beside}}, device, **scene).elements["it"]
        except NoFeasibleEffectError:
            continue
        granted = getattr(it, effect)
        if granted < wish * (1 - DIGITS) or (beside and it.damping < beside["damping"]):
            continue  # less than was wished, or something else gave way
        most = _tuned({"it": {effect: "max", **beside}}, device, **scene).elements["it"]
        room = NEARLY if free else DIGITS
        told = (number, device, effect, wish, beside, scene, granted, most.sizes())
        assert granted <= getattr(most, effect) * (1 + room), told


def test_a_range_that_cannot_be_met_leaves_the_other_elements_tuned() -> None:
    wanted = {"water": {"damping": 10.0}, "rock": {"stiffness": {"min": 1e6, "max": 2e6}}}
    profile = _tuned(wanted | {"mud": {"damping": "max"}}, together=[["rock", "mud"]])
    assert profile.elements["water"].damping == 10.0
    assert profile.elements["mud"].perceived_steps["damping"] > 1
    assert profile.elements["rock"].stiffness == 0
    (note,) = profile.notes
    assert note.startswith("rock.stiffness dropped: its range starts at 1e+06, ")


def test_a_range_out_of_reach_is_told_with_what_is_in_reach() -> None:
    gel = {"stiffness": {"min": 1900.0, "max": 1e4}, "penetration": 0.001}
    met = {"gel": gel, "mud": {"damping": 5.0}}
    profile = _tuned(met, together=[["gel", "mud"]], loop=FILTERS)
    most = _tuned({"gel": gel | {"stiffness": "max"}}, loop=FILTERS).elements["gel"].stiffness
    (note,) = profile.notes
    assert f"at most {most:.4g} is kept even without the other elements, limited by " in note
    assert "Ask for damping in the same element" in note


def test_of_what_cannot_be_kept_together_only_what_is_left_out_is_told() -> None:
    profile = _tuned({"load": {"stiffness": "max", "mass": "max"}}, loop=FILTERS)
    assert profile.elements["load"].acting == {"stiffness"}
    (note,) = profile.notes
    assert note.startswith("load.mass dropped: ")


def test_an_element_that_misses_a_range_is_left_out_as_a_whole() -> None:
    rock = {"stiffness": {"min": 1000.0, "max": 2000.0}, "mass": {"min": 90.0, "max": 99.0}}
    profile = _tuned({"water": {"damping": 10.0}, "rock": rock}, loop=FILTERS)
    assert not profile.elements["rock"].acting
    assert {note.partition(" dropped: ")[0] for note in profile.notes} == {
        "rock.stiffness",
        "rock.mass",
    }
    assert any("its range starts at 90" in note for note in profile.notes)


SCENE = "loop: {velocity_filter_hz: 70.0}\nelements: {it: {damping: 10000.0}}\n"


@pytest.mark.usefixtures("here", "unrehearsed")
def test_a_wanted_value_that_is_not_met_is_said_even_quietly() -> None:
    """28 N at 0.2 m/s are 140 N·s/m."""
    Path("scene.yaml").write_text(SCENE, encoding="utf-8")
    quiet = haptune("tune", "homerehab", "scene.yaml", "--quiet")
    assert (quiet.code, quiet.out) == (0, "")
    told = "it.damping: 10000 N·s/m is asked for, 140 N·s/m is played, limited by force"
    assert told in " ".join(quiet.err.split())
    (finding,) = haptune("tune", "homerehab", "scene.yaml", "--json").result["findings"]
    assert finding == {
        "code": "not-as-wanted",
        "severity": "warning",
        "source": "it.damping",
        "seen": told,
        "needed": "10000 N·s/m",
        "remedy": "Ask for at most 140 N·s/m",
        "at": [],
    }
    plain = haptune("tune", "homerehab", "scene.yaml")
    assert "asked for" not in plain.out
    assert told in " ".join(plain.err.split())
    haptune("report", "profile.yaml", "-o", "page.html")
    assert told in Path("page.html").read_text(encoding="utf-8")


def test_more_damping_taken_away_than_a_device_may_lose_is_told_as_unmet() -> None:
    least = load_device("homerehab").simultaneous_box().damping[0]
    profile = _tuned({"it": {"damping": -30.0}})
    it = profile.elements["it"]
    assert it.damping == pytest.approx(-least / 2.0, rel=0.01)  # at twice the gain
    assert it.limited_by["damping"] == "gain-margin"
    (note,) = profile.notes
    assert note.startswith("it.damping: -30 N·s/m is asked for, -3.97")
    assert "limited by gain-margin" in note
    found = _tuned({"it": {"damping": it.damping}})
    assert (found.elements["it"].limited_by["damping"], found.notes) == ("wanted", ())


@pytest.mark.parametrize("wanted", [1e-4, 2.0, -2.0])
def test_a_wanted_value_of_less_than_a_step_is_told_how_much_one_is(wanted: float) -> None:
    with pytest.raises(NoFeasibleEffectError, match="of a step a hand can tell") as caught:
        _tuned({"it": {"damping": wanted}}, loop=FILTERS)
    assert str(caught.value).endswith("limited by wanted")
    found = re.search(r"which is (\S+),", str(caught.value))
    assert found
    step = float(found[1])
    played = _tuned({"it": {"damping": step}}, loop=FILTERS).elements["it"]
    assert played.damping == step
    assert played.perceived_steps["damping"] == pytest.approx(1.0, abs=0.01)


def test_a_mass_that_no_low_pass_keeps_is_played_by_another_filter_unless_one_is_stated() -> None:
    """As by kinds that are free; what is lost for want of damping in the device changes nothing."""
    elements = {"cup": {"mass": "max"}, "feather": {"damping": -0.01}}
    profile = _tuned(elements)
    assert profile.elements["cup"].mass > 1.1
    assert profile.loop.acceleration_filter == "tracking"
    free = _tuned(elements, loop={"acceleration_filter": "free"})
    assert (profile.loop, profile.elements) == (free.loop, free.elements)


def test_a_mass_that_no_filter_keeps_leaves_that_of_another_element() -> None:
    beside = {"stiffness": 400.0, "mass": 1.0, "damping": "max"}
    profile = _tuned({"lone": {"mass": "max"}, "held": beside}, loop=LOW_PASS)
    alone = _tuned({"held": beside}, loop=LOW_PASS)
    assert profile.elements["lone"].mass == 0
    assert profile.elements["held"] == alone.elements["held"]
    assert profile.elements["held"].mass > 0.9


def test_what_would_be_felt_is_told_beside_what_is_played() -> None:
    """Not beside nothing, and not beside a mass of 50 kg of which there is less."""
    filters = {"velocity_filter_hz": 60.0, "acceleration_filter_hz": 4.0}
    profile = _tuned({"it": {"mass": "max", "damping": "max"}}, loop=filters)
    damping = profile.elements["it"].damping
    assert damping > 100
    found = re.search(r"of mass and (\S+) to \S+ N·s/m of damping", profile.notes[0])
    assert found
    assert float(found[1]) == pytest.approx(damping, rel=0.05)
    filters = {"velocity_filter_hz": 100.0, "acceleration_filter_hz": 36.0}
    heavy = _tuned({"it": {"mass": 50.0, "damping": 30.0}}, loop=filters)
    assert 0.8 < heavy.elements["it"].mass < 1.0
    (note,) = (each for each in heavy.notes if each.startswith("it.damping"))
    assert "limited by rendering" in note
    assert "kg" not in note


def test_what_helps_is_told_once_and_fits() -> None:
    """Not less of what is a step at least, nor at most of what is negative, nor the same twice."""
    with pytest.raises(NoFeasibleEffectError) as caught:
        _tuned({"it": {"damping": {"min": 200.0, "max": 300.0}}})
    assert str(caught.value).count("Ask for") == 1
    (note,) = _tuned({"it": {"damping": -5.0}}).notes
    assert re.search(r"\. Ask for -3\.97\d N·s/m or closer to zero$", note)
    with pytest.raises(NoFeasibleEffectError, match=r"damping\. Ask for damping beside it$"):
        _tuned({"it": {"mass": "max"}}, loop=LOW_PASS)
    filters = {"velocity_filter_hz": "none", "acceleration_filter_hz": 64.3}
    held = _tuned({"it": {"mass": -20.0, "damping": 80.0}}, loop=filters)
    assert held.notes[0].endswith("or closer to zero, or for more damping beside it")


def test_the_margin_of_a_range_that_is_not_met_is_the_one_of_the_scene() -> None:
    wall = {"stiffness": {"min": 5e4, "max": 6e4}, "one_sided": True}
    with pytest.raises(NoFeasibleEffectError, match="margin of 2 and 1 extra sample of delay"):
        _tuned({"it": wall})


@pytest.mark.long
def test_ten_elements_are_tuned_together() -> None:
    elements = {f"e{k}": {"damping": 5.0 + k} for k in range(10)}
    profile = _tuned(elements, together=[list(elements)], loop=FILTERS)
    assert [each.damping for each in profile.elements.values()] == [5.0 + k for k in range(10)]
    assert len(profile.combinations()) == 1023


def test_what_no_fade_keeps_from_being_pumped_is_left_out_and_the_rest_tuned() -> None:
    """A light device with next to no damping, whose wall takes the cup's mass about."""
    light = device_of(
        known(0.0639, 2e-4), known(0.019, 0.025), step=5e-4, delay=0.0, count=1e-15, force=1e8
    )
    cup = {"cup": {"mass": "max"}}
    scene: dict[str, Any] = {
        "elements": {"wall": {"stiffness": "max", "damping": "max"}, **cup},
        "together": [["wall", "cup"]],
        "margin": "firm",
        "loop": {"velocity_filter_hz": 60.0, "acceleration_filter_hz": 40.0},
        "ripple_limit": 1e6,
    }
    profile = optimise(light, Scene.model_validate(scene))
    assert profile.elements["wall"].stiffness > 4000
    assert profile.elements["cup"].mass == 0
    (note,) = profile.notes
    assert note.startswith("cup.mass dropped: however slowly it fades, a hand that enters")
    assert "keep it apart" in note
    apart = optimise(light, Scene.model_validate({**scene, "together": []}))
    assert apart.elements["wall"].stiffness > 4000
    assert apart.elements["cup"].mass > 0.01


def test_filters_are_chosen_for_what_is_left_once_something_could_be_pumped() -> None:
    """The spring of a block whose mass cannot fade is as stiff as if no mass had been asked for."""
    mass, damping = (0.392, 0.3516, 0.4323), (0.00832, 0.00756, 0.00909)
    delay = (0.006, 0.0048, 0.0072)
    device = device_of(mass, damping, step=0.004, delay=delay, count=6.15e-7, force=20.9)
    block: dict[str, object] = {"stiffness": "max", "damping": "max", "speed": 0.157}
    beside, alone = (
        optimise(device, Scene.model_validate({"elements": {"block": block | mass}, "loop": LOW}))
        for mass in ({"mass": "max"}, {})
    )
    assert beside.notes[0].startswith("block.mass dropped: however slowly it fades")
    assert beside.elements["block"].stiffness == alone.elements["block"].stiffness


def _well_known() -> Device:
    """2 kg and 6 N·s/m, known to parts in a thousand."""
    drive: dict[str, Any] = {"count": 6e-6, "force": 10.0, "friction": 0.5}
    return device_of(known(2.0, 2e-4), known(6.0, 5e-4), step=1e-3, delay=1e-3, **drive)


def test_what_is_left_out_for_its_fade_holds_nothing_else_down_and_is_told_what_helps() -> None:
    gum = {"gum": {"stiffness": "max", "damping": 5.0}}

    def found(**light: object) -> SafeProfile:
        loop = {"velocity_filter_hz": 60.0}
        scene: dict[str, Any] = {"elements": gum | light, "margin": "firm", "loop": loop}
        scene |= {"together": [["gum", *light]]} if light else {}
        return optimise(_well_known(), Scene.model_validate(scene))

    alone, beside = found(), found(light={"damping": "min"})
    assert beside.elements["light"].damping == 0
    assert beside.elements["gum"].stiffness == alone.elements["gum"].stiffness
    (note,) = beside.notes
    told = re.search(r"Ask for (\S+) or closer to zero, or keep it apart from gum$", note)
    assert told
    assert not re.search("spring|ask for damping", note)
    less = found(light={"damping": float(told[1])}).elements["light"]
    assert less.damping == float(told[1]) < -1.5


WALL_BESIDE_RUBBER = """\
schema: haptune/scene/1
name: shared
margin: balanced
loop: {velocity_filter_hz: 60.0}
elements:
  wall: {stiffness: 500.0, one_sided: true}
  rubber: {stiffness: 1000.0, damping: 20.0}
"""


@pytest.mark.usefixtures("here", "unrehearsed")
def test_a_wall_that_is_pushed_through_is_told_with_what_takes_its_force() -> None:
    """Of 14 N rubber takes K·10 mm and half of the rest; each remedy gives the wall a third."""
    drive: dict[str, Any] = {"count": 6e-6, "force": 14.0, "peak": 14.0, "friction": 0.5}
    device = device_of(known(2.0, 0.1), known(8.0, 0.25), step=1e-3, delay=1e-3, **drive)
    Path("device.yaml").write_text(to_yaml(to_mapping(device)), encoding="utf-8")
    scene = Path("scene.yaml")
    for text, level, weak in (
        (WALL_BESIDE_RUBBER, 2.0, True),
        (WALL_BESIDE_RUBBER + "apart: [[wall, rubber]]\n", 14.0, False),
        (WALL_BESIDE_RUBBER.replace("20.0}", "20.0, penetration: 0.003}"), 5.5, False),
    ):
        scene.write_text(text, encoding="utf-8")
        ended = haptune("tune", "device.yaml", "scene.yaml", "--verbose")
        assert ended.code == 0, ended.err
        said = " ".join(ended.out.split())
        assert "wall: gives back" in said
        assert f"cut at {level:g} N, {level / 500:.3g} m deep" in said
        told = (
            "wall is pushed through with 2 N, of 14 N that the device can hold: beside it rubber "
            "has 12 N of the peak of 14 N. Keep it from what it need not be met with (apart:, or "
            "out of together:), or state a smaller penetration for rubber"
        )
        assert (told in said) == weak
        assert ("pushed through" in said) == weak
        # What a clamp does not let pass is not told as if it did.
        assert "all of the continuous force" not in said


def test_of_ranges_that_only_exclude_each_other_the_last_is_left_out() -> None:
    springs = {name: {"stiffness": {"min": 900.0, "max": 2000.0}} for name in ("first", "last")}
    profile = _tuned(springs, together=[[*springs]])
    assert profile.elements["first"].stiffness > 1300
    assert profile.elements["last"].stiffness == 0
    (note,) = profile.notes
    assert "last.stiffness dropped: its range starts at 900, which no setting" in note
