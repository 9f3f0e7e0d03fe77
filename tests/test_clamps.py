"""Walls as one clamp round spring and damper: how stiff, proved how far."""

import re
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from identification import Device, load_device, quantity, to_mapping
from tests.devices import device_of, known
from tune import SafeProfile, Scene, optimise
from tune.certificate.check import check_content

WALL = {"stiffness": "max", "damping": "max", "one_sided": True}
#: N/m or N·m/rad that one wall reaches at least, both effects as large as can be.
STIFF = {"homerehab": 16_000.0, "stylus": 1_000.0, "knob": 1.3, "emps": 1.0e6}
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


#: As the half planes here know it, and soon chosen.
LOW_PASS = {"velocity_filter": "low-pass", "acceleration_filter": "low-pass"}


def scene(*, hertz: float | None = None, **elements: object) -> Scene:
    """Low-pass filters, of a velocity cut-off that is stated or chosen."""
    loop = LOW_PASS | ({"velocity_filter_hz": hertz} if hertz else {})
    return Scene.model_validate({"elements": elements, "loop": loop})


def tuned(device: str | Device, wanted: Scene) -> SafeProfile:
    return optimise(load_device(device) if isinstance(device, str) else device, wanted)


@cache
def wall_alone(device: str) -> SafeProfile:
    return tuned(device, scene(wall=WALL))


def response(mass: float, damping: float, step: float, samples: float, theta: Array) -> Complex:
    """Position over a held force: the step response t/b - (m/b²)(1 - e^(-bt/m)), sampled late."""
    whole = int(np.floor(samples))
    late = samples - whole
    z, pole = np.exp(1j * theta), np.exp(-damping * step / mass)

    def moved(time: float) -> Complex:
        """Σ over k of the step response at (k + 1)T - time, times z^-(k+1), times (1 - 1/z)."""
        first = step - time
        ramp = (first + step / (z - 1)) / damping
        decay = mass / damping**2 * np.exp(-damping * first / mass)
        rest = -mass / damping**2 + decay * (z - 1) / (z - pole)
        return (ramp + rest) / z

    return moved(late * step) * z ** -float(whole)


def law(
    stiffness: float, damping: float, hertz: float | None, step: float, theta: Array
) -> Complex:
    z = np.exp(1j * theta)
    pole = 0.0 if hertz is None else np.exp(-2 * np.pi * hertz * step)
    return np.asarray(stiffness + damping * (1 - pole) * (z - 1) / (step * (z - pole)), complex)


def half_plane(loops: list[Complex], theta: Array) -> bool:
    """Whether one FIR multiplier makes Re{M·(1 + H)} positive in all loops: a linear program."""
    ladder = np.array([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 20, 30])
    taps = 1 - np.exp(-1j * np.outer(theta, ladder))
    rows = np.concatenate([(taps * (1 + loop)[:, None]).real for loop in loops])
    rows /= np.abs(rows).mean(axis=1, keepdims=True)
    found = linprog(
        np.append(np.zeros(ladder.size), -1.0),
        A_ub=np.hstack([-rows, np.ones((len(rows), 1))]),
        b_ub=np.zeros(len(rows)),
        A_eq=np.append(np.ones(ladder.size), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0, None)] * ladder.size + [(None, None)],
    )
    return found.x is not None and bool(found.success and found.x[-1] > 0)


def corner_loops(profile: SafeProfile, gain: float, theta: Array) -> list[Complex]:
    seal, wall = profile.certificate, profile.elements["wall"]
    step, extra = profile.loop.sample_time, seal.extra_delay_samples
    spoken = law(wall.stiffness, wall.damping, profile.loop.velocity_filter_hz, step, theta)
    return [
        gain * spoken * response(mass, damping, step, samples, theta)
        for mass, damping, samples in product(
            seal.mass, seal.damping, (seal.delay_samples[0], seal.delay_samples[1] + extra)
        )
    ]


@pytest.mark.parametrize("name", STIFF)
def test_walls_are_as_stiff_as_makers_render_them(name: str) -> None:
    """And a linear program of its own over 2 000 frequencies says of the corners what is proved."""
    profile = wall_alone(name)
    wall = profile.elements["wall"]
    assert wall.stiffness >= STIFF[name]
    assert (profile.certificate.gain, profile.certificate.extra_delay_samples) == (2.0, 1.0)
    assert wall.margins.gain <= (wall.margins.absolute_gain or 0.0)
    assert wall.limited_by["stiffness"] in {"delay-margin", "ripple"}
    slowest = 0.03 * profile.certificate.damping[0] * profile.loop.sample_time
    theta = np.geomspace(slowest / profile.certificate.mass[1], np.pi, 2000)
    assert half_plane(corner_loops(profile, 2.0, theta), theta)
    if wall.limited_by["stiffness"] == "delay-margin":
        assert not half_plane(corner_loops(profile, 2.04, theta), theta)


def test_what_a_wall_meets_costs_it_only_what_it_must() -> None:
    """Beside all the elements of the demo on a device that is known to 1 and 6 per cent."""
    others: dict[str, object] = {
        "water": {"damping": 10.0},
        "cup": {"mass": 1.0, "damping": 30.0},
        "rubber": {"stiffness": {"min": 200.0, "max": 1500.0}},
        "feather": {"mass": "min", "damping": 20.0},
    }
    loop = LOW_PASS | {"velocity_filter_hz": 150.0, "acceleration_filter_hz": 32.0}
    wanted = {"elements": {"wall": WALL, **others}, "loop": loop}
    profile = tuned("homerehab", Scene.model_validate(wanted))
    assert profile.elements["wall"].stiffness > 15_000
    assert profile.elements["cup"].mass > 0.9
    proved = profile.certificate.absolute_stability or {}
    assert {f"wall + {name}" for name in others} == set(proved)
    assert [c.name for c in getattr(proved["wall + rubber"].free, "channels", ())] == [
        "wall",
        "rubber",
    ]
    # Levels of springs that may push at once sum to the peak force.
    wall, rubber = profile.elements["wall"], profile.elements["rubber"]
    assert wall.force_level + rubber.force_level == pytest.approx(28.0)


def test_pairs_that_are_apart_are_not_proved_and_cost_nothing() -> None:
    wanted = scene(wall=WALL, oil={"damping": 60.0}, hertz=75.0)
    beside, apart = (
        tuned("homerehab", wanted.model_copy(update={"ripple_limit": 0.3, "apart": pairs}))
        for pairs in ([], [["wall", "oil"]])
    )
    assert apart.elements["wall"].stiffness > STIFF["homerehab"]
    assert apart.elements["wall"].stiffness > 1.2 * beside.elements["wall"].stiffness
    assert ("wall", "oil") in beside.combinations()
    assert ("wall", "oil") not in apart.combinations()


@pytest.mark.parametrize(
    ("device", "elements", "more"),
    [
        # What leaves room for a wall is stopped by the proof of that, if not to the last tenth.
        (
            "homerehab",
            {"wall": WALL, "feather": {"damping": "min"}, "spring": {"stiffness": "max"}},
            {"loop": {"velocity_filter_hz": 50.0}},
        ),
        # A damper that gives less than is asked for acts as far before its face as was asked for.
        (
            "homerehab",
            {"wall": {"stiffness": 900.0, "damping": 40.0, "one_sided": True}},
            {"ripple_limit": 0.02, "loop": {"velocity_filter_hz": 50.0}},
        ),
    ],
    ids=["room", "lead"],
)
def test_what_is_written_of_walls_is_what_check_reads(
    device: str, elements: dict[str, Any], more: dict[str, Any]
) -> None:
    wanted = Scene.model_validate({"elements": elements, **more})
    content = to_mapping(optimise(load_device(device), wanted))
    assert check_content(content, "as tuned").profile.elements.keys() == elements.keys()


def test_a_limit_of_a_whole_combination_binds_what_hardly_moves_it() -> None:
    """A wall of a step beside one three hundred times as stiff, which takes all of the margin."""
    mass, damping = (1.06e-3, 1.05e-3, 1.07e-3), (6.77e-4, 6.72e-4, 6.82e-4)
    device = device_of(
        mass, damping, step=5e-4, delay=2.5e-4, count=1.13e-5, force=0.054, motion="rotary"
    )
    walls = {"hard": WALL | {"favour": "both"}, "soft": WALL | {"priority": 2, "favour": "both"}}
    wanted = {"together": [["hard", "soft"]], "loop": {"velocity_filter_hz": "none"}}
    profile = tuned(device, Scene.model_validate({"elements": walls, **wanted}))
    hard, soft = (profile.elements[name] for name in walls)
    assert hard.stiffness > 300 * soft.stiffness
    assert soft.limited_by["stiffness"] == "delay-margin"
    assert check_content(to_mapping(profile), "as tuned").profile.elements.keys() == walls.keys()


def test_what_no_wall_can_meet_is_kept_apart_and_said_so() -> None:
    """Water that takes most of the damping there can be on a light device."""
    profile = tuned("stylus", scene(water={"damping": 8.0}, wall=WALL, hertz=400.0))
    assert profile.apart == (("water", "wall"),)
    assert any(note.startswith("kept apart: water and wall") for note in profile.notes)
    assert profile.elements["wall"].stiffness > STIFF["stylus"]


def test_a_block_whose_damper_lags_far_longer_than_a_walls_is_met_with_it() -> None:
    """Two clamps of unlike signals need a multiplier about as long as the longer B/K."""
    block = {"stiffness": "max", "damping": "max", "mass": "max"}
    profile = tuned("homerehab", scene(block=block, wall=WALL))
    assert not profile.apart
    assert profile.elements["wall"].stiffness > STIFF["homerehab"]
    block_met = profile.elements["block"]
    assert block_met.damping > 0.015 * block_met.stiffness


@pytest.mark.parametrize(
    ("other", "least", "softest", "together"),
    [
        ({"stiffness": "max"}, 10.0, 1000.0, False),
        ({"damping": 6.0}, 6.0, 400.0, False),
        ({"stiffness": 30.0, "damping": "max"}, 30.0, 1000.0, True),
    ],
    ids=["rubber", "water", "gel, asked for together"],
)
def test_a_wall_and_what_it_meets_leave_room_for_each_other(
    other: dict[str, object], least: float, softest: float, *, together: bool
) -> None:
    """On a light device either would take all there is, and a hand in it would feel no wall."""
    groups = [["wall", "other"]] * together
    wanted = scene(wall=WALL, other=other).model_copy(update={"together": groups})
    profile = tuned("stylus", wanted)
    assert not profile.apart
    met, wall = profile.elements["other"], profile.elements["wall"]
    assert max(met.stiffness, met.damping) >= least
    assert wall.stiffness > softest
    most = wall_alone("stylus").elements["wall"].stiffness
    found = (
        re.search(r"above all other, about (\S+) N/m by itself", note) for note in profile.notes
    )
    told = [float(each[1]) for each in found if each]
    assert told == ([pytest.approx(most, rel=0.01)] if most > 2 * wall.stiffness else [])


def test_a_wall_that_comes_second_is_left_some_room_by_what_it_is_asked_together_with() -> None:
    """Or goes with what to ask for instead, and what left it room gets all of it back."""
    wanted = {"together": [["wall", "other"]], "loop": {"velocity_filter_hz": 60.0}}
    met: dict[str, SafeProfile] = {}
    for effect in ("stiffness", "damping"):
        elements = {"wall": WALL | {"priority": 2}, "other": {effect: "max"}}
        met[effect] = tuned("stylus", Scene.model_validate({"elements": elements, **wanted}))
    assert met["stiffness"].elements["wall"].stiffness > 500
    assert met["stiffness"].elements["other"].perceived_steps["stiffness"] > 1
    alone = tuned(
        "stylus",
        Scene.model_validate({"elements": {"other": {"damping": "max"}}, "loop": wanted["loop"]}),
    )
    assert met["damping"].elements["other"].damping == alone.elements["other"].damping
    assert "the same priority, to leave it room" in met["damping"].notes[0]


def test_what_a_wall_meets_leaves_room_where_it_could_be_proved_as_next_to_nothing() -> None:
    """A damper as large as can be would leave 193 N/m of the 3 840 that a light device has."""
    mass, damping = (0.765, 0.75, 0.78), (2.43, 1.7, 3.17)
    drive: dict[str, Any] = {"count": 1.5e-5, "force": 5.2, "peak": 15.5, "friction": 0.036}
    device = device_of(mass, damping, step=1e-3, delay=2e-3, **drive)
    elements = {"wall": WALL, "honey": {"damping": "max"}}
    wanted = {"elements": elements, "margin": "conservative", "loop": {"velocity_filter_hz": 110.0}}
    profile = tuned(device, Scene.model_validate(wanted))
    assert profile.elements["wall"].stiffness > 1500
    assert profile.elements["honey"].damping > 10


def test_taps_that_hold_a_whole_exponential_cost_a_wall_little_beside_rubber() -> None:
    """A lightly damped device at 4 kHz, whose wall lags by 25 samples: few cost it a third."""
    known = {"mass": quantity(2.0), "damping": quantity(2.0), "sample_time": quantity(2.5e-4)}
    device = load_device("homerehab").model_copy(update=known)
    loop = {"margin": "firm", "loop": {"velocity_filter_hz": 15.0}}
    alone = tuned(device, Scene.model_validate({"elements": {"wall": WALL}, **loop}))
    both = {"wall": WALL, "rubber": {"stiffness": "max"}}
    met = tuned(device, Scene.model_validate({"elements": both, **loop}))
    assert met.elements["rubber"].stiffness > 400
    assert met.elements["wall"].stiffness > 0.95 * alone.elements["wall"].stiffness


def test_a_wall_that_can_be_proved_beside_an_element_is_not_kept_apart_from_it() -> None:
    """It gives way, though what the proof is short of shrinks slowly, and still is many steps."""
    drive: dict[str, Any] = {"count": 2.06e-6, "force": 9.52, "friction": 0.267}
    device = device_of(known(0.479, 0.01), known(0.8662, 0.02), step=2e-3, delay=0.0, **drive)
    loop = {"velocity_filter_hz": 25.0, "acceleration_filter_hz": 15.0}
    beside = {"damping": "max", "mass": "max"}
    wanted = {"elements": {"wall": WALL, "other": beside}, "loop": loop}
    profile = tuned(device, Scene.model_validate(wanted))
    assert profile.apart == ()
    assert ("wall", "other") in profile.combinations()
    assert profile.elements["wall"].perceived_steps["stiffness"] > 5


def test_an_element_without_effects_is_not_kept_apart() -> None:
    """A mass that is dropped after its proof beside the wall failed leaves nothing to prove."""
    drive: dict[str, Any] = {"count": 2e-6, "force": 5.0, "friction": 0.1}
    light = device_of((0.4, 0.2, 0.6), (1.5, 0.9, 2.1), step=5e-4, delay=1e-3, **drive)
    wanted = Scene.model_validate(
        {
            "margin": "firm",
            "loop": {"velocity_filter_hz": 600.0, "acceleration_filter_hz": 200.0},
            "elements": {
                "wall": WALL,
                "mud": {"damping": "max", "stiffness": {"min": 1.0, "max": 300.0}},
                "ball": {"mass": "max", "acceleration": 2.0, "fade_time": 0.1},
            },
            "together": [["mud", "ball"]],
        }
    )
    profile = tuned(light, wanted)
    assert any(note.startswith("ball.mass dropped") for note in profile.notes)
    assert profile.apart == (("wall", "mud"),)
    assert ("wall", "ball") in profile.combinations()
    assert [note for note in profile.notes if "wall and ball" in note] == []
    assert check_content(to_mapping(profile), "as tuned").profile.apart == profile.apart


def test_no_cut_off_that_is_stated_gives_a_wall_and_what_it_meets_two_percent_more() -> None:
    """Linear limits alone would have a lower one, at which the proof leaves less of both."""
    poles = {"velocity_filter_order": 2, "filter_damping_ratio": 0.5}

    def worth(**loop: object) -> float:
        wanted = scene(wall=WALL, honey={"damping": "max"})
        kinds = wanted.loop.model_copy(update=poles | loop)
        played = tuned("homerehab", wanted.model_copy(update={"loop": kinds})).elements
        wall, honey = (played[name].perceived_steps for name in ("wall", "honey"))
        return honey["damping"] * wall["stiffness"] * wall["damping"] ** 0.1

    assert worth(velocity_filter_hz=110.0) <= 1.02 * worth()


def test_what_a_proof_held_back_is_raised_as_far_as_the_proof_goes() -> None:
    """Stepped back together, a spring and its damper are proved as 1.738 and 0.01619."""
    loop = {"velocity_filter": "low-pass", "velocity_filter_hz": 300.0}
    gel = {"gel": {"stiffness": "max", "damping": "max"}}
    wanted = Scene.model_validate({"margin": "firm", "loop": loop, "elements": gel})
    played = tuned("knob", wanted).elements["gel"]
    assert played.stiffness * played.damping > 1.03 * 1.738 * 0.01619
    assert played.limited_by == {"stiffness": "saturation", "damping": "saturation"}


def test_clamps_of_one_signal_may_part_on_the_way_to_their_proof() -> None:
    gel = {"stiffness": "max", "damping": "max"}
    elements = {"elements": {"gel": gel, "goo": gel}, "together": [["gel", "goo"]]}
    wanted = Scene.model_validate(elements | {"loop": {"velocity_filter_hz": 100.0}})
    assert all(each.stiffness > 0.42 for each in tuned("knob", wanted).elements.values())


@pytest.mark.long
def test_a_wall_beside_what_is_heavy_is_no_less_because_its_proof_is_long() -> None:
    """Effects are not cut by 5 % each time a proof of 140 000 cells is given up halfway."""
    block = dict.fromkeys(("stiffness", "damping", "mass"), "max")
    wanted = Scene.model_validate({"elements": {"block": block, "wall": WALL}})
    profile = tuned("homerehab", wanted)
    assert profile.apart == ()
    assert profile.elements["wall"].stiffness > 15_000
    assert profile.certificate.cells > 100_000
