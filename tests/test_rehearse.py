"""What the commands rehearse of a profile: every combination as played, on devices it may be."""

from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from datasets_synthetic import Calls, Controller, Rehearsal, Rig, VirtualElement, rehearse
from identification import SlopeRange, as_stored, load_device, quantity
from tests.commands import Ended, haptune
from tests.devices import device_of
from tests.entered_scenes import made
from tests.exported import FADE, tuned
from tune import CheckFailedError, SafeProfile, Scene, check, load_profile, optimise
from tune.cli.preparation import RestlessError, refuse_restless


def rehearsed(profile: SafeProfile) -> tuple[Rig, Controller, dict[str, Any]]:
    """What the simulator is asked to play."""
    settled = Rehearsal(trials=())
    with mock.patch(
        "datasets_synthetic.rehearse", side_effect=lambda _, law, **__: [settled] * law.size()
    ) as played:
        refuse_restless(profile, lambda _: None)
    played.assert_called_once()
    return *played.call_args.args, dict(played.call_args.kwargs)


def profile_with(**device: Any) -> SafeProfile:
    """Wall, cup and rubber, the wall one-sided, on HomeRehab with these facts."""
    elements = dict(tuned().elements)
    elements["wall"] = elements["wall"].model_copy(update={"one_sided": True})
    changed = tuned().device.model_copy(update=device)
    return tuned().model_copy(update={"elements": elements, "device": changed})


def rows(law: Controller, combination: int) -> list[dict[str, float]]:
    """What each element of a combination plays, as far as it plays anything."""
    columns = law.rows(np.array([combination]))
    count = len(columns["stiffness"])
    parts = [{name: float(row[k, 0]) for name, row in columns.items()} for k in range(count)]
    return [part for part in parts if part["stiffness"] or part["damping"] or part["mass"]]


def test_every_combination_is_played_with_its_walls_and_its_fades() -> None:
    """Wall, cup, rubber, and the wall with either."""
    profile = profile_with()
    _, law, _ = rehearsed(profile)
    level = profile.elements["wall"].force_level
    wall = {"stiffness": 500.0, "damping": 10.0, "mass": 0.0, "side": -1.0, "level": level}
    cup = {"mass": profile.elements["cup"].mass, "level": np.inf, "side": 0.0}
    cup |= {"stiffness": 0.0, "damping": 30.0, "fade_time": FADE}
    rubber = {"stiffness": 700.0, "damping": 0.0, "mass": 0.0, "side": 0.0}
    rubber["level"] = profile.elements["rubber"].force_level
    played = [[wall], [cup], [rubber], [wall, cup], [wall, rubber]]
    assert law.size() == len(profile.combinations()) == len(played)
    for combination, parts in enumerate(played):
        plain = {"fade_time": 0.0, "place": 0.0}
        assert rows(law, combination) == [plain | part for part in parts]
    assert law.calls is not None
    assert law.calls.taps == profile.certificate.longest_tap


def test_walls_are_met_with_one_on_the_other_side_as_near_as_it_may_stand() -> None:
    """None that is apart from what is met with it; alike ones touch, others leave both leads."""
    sizes = {
        "wall": (2000.0, 20.0, 0.0),
        "wall 2": (1000.0, 20.0, 0.0),
        "wall 3": (500.0, 10.0, 0.0),
        "cup": (0.0, 0.0, 1.0),
    }
    apart = (("wall 2", "cup"), ("wall", "wall 2"))
    profile = made("homerehab", sizes, apart=apart, speed=0.3)
    _, law, _ = rehearsed(profile)
    facing = {
        combination: [
            (part["stiffness"], part["place"]) for part in rows(law, k) if part["side"] > 0
        ]
        for k, combination in enumerate(profile.combinations())
    }
    assert facing.pop(("wall",)) == [(500.0, pytest.approx(-0.3 * (0.01 + 0.02)))]
    assert facing.pop(("wall 2",)) == [(500.0, 0.0)]
    assert facing.pop(("wall 3",)) == [(2000.0, pytest.approx(-0.009))]
    assert facing.pop(("wall", "cup")) == [(500.0, pytest.approx(-0.009))]
    assert facing.pop(("wall 3", "cup")) == [(2000.0, pytest.approx(-0.009))]
    assert facing == {("cup",): []}


def test_corners_of_the_box_are_played_with_the_extra_delay() -> None:
    profile = profile_with()
    box = profile.device.simultaneous_box()
    rig, _, options = rehearsed(profile)
    assert (rig.mass[0], rig.damping[0], rig.delay[0]) == (3.0, 10.0, 0.001)
    corners = [(each.mass[0], each.damping[0], each.delay[0]) for each in options["others"]]
    late = pytest.approx(0.002)
    (light, heavy), (least, most) = box.mass, box.damping
    assert corners == [(light, least, late), (heavy, least, late), (light, most, late)]


def test_slopes_of_friction_and_its_stiffness_are_among_the_devices_played() -> None:
    profile = profile_with(
        damping_slope=SlopeRange(low=4.0, high=30.0),
        presliding_stiffness=SlopeRange(low=10.0, high=200.0),
        damping=quantity(10.0),
    )
    _, _, options = rehearsed(profile)
    assert [each.damping[0] for each in options["others"]] == [4.0, 4.0, 30.0, 10.0]
    assert [each.stiffness[0] for each in options["others"]] == [0, 0, 0, 200.0]


def test_an_element_without_effect_is_played_in_no_combination() -> None:
    """A wall that could not be had would let a push carry the device away for ever."""
    elements = dict(profile_with().elements)
    elements["wall"] = elements["wall"].model_copy(update={"stiffness": 0.0, "damping": 0.0})
    _, law, _ = rehearsed(profile_with().model_copy(update={"elements": elements}))
    assert law.size() == 2
    assert [part["mass"] > 0 for k in range(2) for part in rows(law, k)] == [True, False]


def test_a_wall_that_could_not_be_had_faces_no_other() -> None:
    sizes = {"wall": (2000.0, 20.0, 0.0), "wall 2": (0.0, 0.0, 0.0)}
    _, law, _ = rehearsed(made("homerehab", sizes))
    assert [(part["stiffness"], part["side"]) for part in rows(law, 0)] == [(2000.0, -1)]


def shakes(*elements: str) -> RestlessError:
    return RestlessError({elements: "shakes."})


def tune(
    folder: Path, scene: str, answers: Any, device: str = "homerehab", hertz: object = 100.0
) -> Ended:
    """The command on a scene, its rehearsals answered so; it writes profile.yaml."""
    path = folder / "scene.yaml"
    path.write_text(f"loop: {{velocity_filter_hz: {hertz}}}\nelements: {{{scene}}}\n")
    with mock.patch("tune.cli.settling.refuse_restless", side_effect=answers):
        return haptune("tune", device, str(path), "-o", str(folder / "profile.yaml"))


def test_what_does_not_settle_is_no_feasible_effect(tmp_path: Path) -> None:
    """Exit 5 names the element; 6 is for a profile that exists."""
    ended = tune(tmp_path, "water: {damping: 10.0}", shakes("water"))
    assert ended.code == 5
    assert "water: rehearsal: shakes. Ask for less of it" in " ".join(ended.err.split())
    assert not (tmp_path / "profile.yaml").exists()


@pytest.mark.parametrize("wish", ["max", "min"])
def test_less_is_asked_for_of_what_does_not_settle(tmp_path: Path, wish: str) -> None:
    path, found = tmp_path / "profile.yaml", list[float]()
    for answers in ([None], [shakes("water"), None]):
        ended = tune(tmp_path, f"water: {{damping: {wish}}}", answers)
        assert ended.code == 0
        assert ("shakes; tuned again with less of it" in ended.err) == (answers != [None])
        profile = check(path).profile
        found.append(profile.elements["water"].damping)
    assert found[1] == pytest.approx(0.7 * found[0], rel=1e-5)
    assert profile.elements["water"].limited_by == {"damping": "stability"}
    (note,) = profile.notes
    assert note.startswith("rehearsal: water.damping is less than other limits allow, so that it")
    path.write_text(profile.model_copy(update={"notes": ()}).signed().to_yaml(), encoding="utf-8")
    with pytest.raises(CheckFailedError, match="limited by stability, which would allow 10% more"):
        check(path)


WALL = "wall: {stiffness: max, damping: max, one_sided: true}"
MIST = "mist: {damping: {min: 0.5, max: 3}}"


@pytest.mark.parametrize("alone", [True, False])
def test_nothing_is_less_for_the_sake_of_what_is_not_felt_so(tmp_path: Path, alone: bool) -> None:
    """Mist of 0.7 times as much is no step; a wall that settles without it is whole again."""
    path = tmp_path / "profile.yaml"
    assert tune(tmp_path, WALL, None).code == 0
    whole = load_profile(path).elements["wall"].damping

    def shaking(design: SafeProfile, _: Any) -> None:
        if design.elements["mist"].damping:
            raise shakes("wall", "mist")
        if not alone and design.elements["wall"].damping > 0.9 * whole:
            raise shakes("wall")

    ended = tune(tmp_path, f"{WALL}, {MIST}", shaking)
    assert ended.code == 0, ended.err
    said, profile = " ".join(ended.err.split()), check(path).profile
    part = 1 if alone else 0.7
    assert profile.elements["wall"].damping == pytest.approx(part * whole, rel=0.02)
    assert "wall + mist: rehearsal: shakes; tuned again" in said
    assert ("wall: rehearsal: shakes; tuned again" in said) is not alone
    note = next(each for each in profile.notes if each.startswith("mist.damping dropped: "))
    assert "range" not in note
    assert "with more of it wall + mist did not settle in simulation; 2.1 would be" in note
    assert note.endswith(". Keep it apart (apart:, not together:) from wall, or leave it out")


def test_what_is_not_felt_where_it_settles_is_refused_with_the_rehearsal(tmp_path: Path) -> None:
    ended = tune(tmp_path, MIST, shakes("mist"))
    assert ended.code == 5
    said = " ".join(ended.err.split())
    assert "mist.damping: with more of it mist did not settle in simulation; 2.1 would be" in said
    assert said.endswith("which is 2.68. Leave it out")
    assert "range" not in said


def test_what_was_told_apart_stays_so_where_less_is_asked_for(tmp_path: Path) -> None:
    """Less of the water is not to cost the wall that is never met with it, nor minutes."""
    elements = WALL.replace("true", "true, priority: 2") + ", water: {damping: {min: 0.5, max: 8}}"
    assert tune(tmp_path, elements, [shakes("water"), None], "stylus", "none").code == 0
    profile = check(tmp_path / "profile.yaml").profile
    assert profile.elements["water"].damping == pytest.approx(5.6)
    assert profile.elements["wall"].stiffness > 1300
    assert profile.apart == (("wall", "water"),)
    assert sum(note.startswith("kept apart: wall and water") for note in profile.notes) == 1


def test_a_device_without_an_effect_beside_another_is_tuned() -> None:
    """A wall too faint to be felt on a device that hardly damps, beside water and a cup."""
    mass, damping = (0.0929, 0.0928, 0.0930), (0.00179, 0.001788, 0.001792)
    drive: dict[str, Any] = {"count": 2.27e-7, "force": 1.81, "friction": 0.007}
    device = as_stored(device_of(mass, damping, step=0.005, delay=0.005, **drive))
    loop = {"velocity_filter_hz": "none", "acceleration_filter_hz": "none"}
    wall = {"stiffness": "max", "damping": "max", "one_sided": True}
    elements = {"water": {"damping": "max"}, "wall": wall}
    scene = {"margin": "conservative", "loop": loop, "ripple_limit": 0.0212, "elements": elements}
    profile = optimise(device, Scene.model_validate(scene))
    assert profile.elements["wall"].stiffness == 0
    assert profile.elements["water"].damping > 0.5
    refuse_restless(profile, lambda _: None)


def bounced(damping: float, *, mass: float = 0.2, late: int = 4, seconds: float = 40.0) -> float:
    """Speed that a frictionless handle keeps at a cut wall it fell into from 0.1 m, m/s."""
    step, queue, place, speed, heights = 1e-3, [0.0] * (late + 1), -0.1, 0.0, [0.0]
    for _ in range(round(seconds / step)):
        pull = 1000.0 * place + damping * (place - heights[-1]) / step
        heights.append(place)
        queue.append(min(max(pull, 0.0), 10.0))
        speed += (2.5 - queue.pop(0) - 0.1 * speed) / mass * step
        place += speed * step
    return float(np.max(np.abs(np.diff(heights[-4000:]))) / step)


def test_what_is_pushed_through_a_wall_that_is_cut_comes_to_rest_within_a_trial() -> None:
    """A device that hardly damps bounces long if it is pushed far: off a good wall it settles.

    A heavy one has not had bounces enough to tell by the time a light one is at rest.
    """
    settles: list[bool] = []
    cases = ((2.0, 0.2, 4), (5.3, 0.2, 4), (8.0, 1.0, 1))
    for damping, mass, late in cases:
        rig = Rig(
            mass=mass,
            damping=0.1,
            sample_time=1e-3,
            delay=late * 1e-3,
            encoder_resolution=1e-5,
            force_limit=10.0,
        )
        wall = VirtualElement(stiffness=1000.0, damping=damping, level=10.0, side=-1, place=0.0)
        law = Controller(beside=(wall,), calls=Calls(taps=1), velocity_filter_hz=float("inf"))
        (played,) = rehearse(rig, law, duration=1.0)
        settles.append(played.settles)
    assert settles == [bounced(each, mass=m, late=n) < 0.01 for each, m, n in cases]
    assert settles == [False, True, True]


def test_beside_a_wall_the_encoder_may_move_a_device_by_the_ripple_of_both() -> None:
    """A wall and a cup that are each just not felt; 0.53 N lasts within a count of 6 µm."""
    known = {"mass": quantity(3.0, 2.9996, 3.0003), "damping": quantity(10.0, 9.982, 10.016)}
    elements = {
        "wall": {"stiffness": "max", "damping": "max", "one_sided": True},
        "cup": {"mass": "max", "damping": 30.0, "acceleration": 2.0, "fade_time": 0.1},
    }
    loop = {"velocity_filter_hz": 77.87, "velocity_filter_order": 2, "filter_damping_ratio": 0.5}
    loop |= {"acceleration_filter_hz": 29.35}
    wanted = Scene.model_validate({"elements": elements, "loop": loop, "ripple_limit": 0.1})
    profile = optimise(load_device("homerehab").model_copy(update=known), wanted)
    ripples = [each.ripple or 0.0 for each in profile.elements.values()]
    assert 1.5 * profile.ripple_limit < sum(ripples)
    refuse_restless(profile, print)
    alone = profile.model_copy(update={"ripple_limit": profile.ripple_limit / 2})
    with pytest.raises(CheckFailedError, match=r"cup: rehearsal: .* keeps oscillating"):
        refuse_restless(alone, print)
