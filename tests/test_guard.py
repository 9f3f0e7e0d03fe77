"""The C guard, compiled: the certified law to its last digits, and no force without it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from datasets_synthetic import Calls, Controller, VirtualElement
from datasets_synthetic.law import ControlLaw
from tests.entered_scenes import made
from tests.exported import FADE, LOOPS, STEP, Array, changed, poles
from tests.guard import built, enter, push
from tests.unlimited import BOUNDLESS
from tune import SafeProfile, export

WALL, CUP = 1, 2


def movement(samples: int = 400) -> Array:
    """A hand that enters 5 mm deep and trembles, read by an encoder of 6 µm."""
    time = np.arange(samples) * STEP
    smooth = 0.005 * np.sin(2 * np.pi * 1.7 * time) + 2e-4 * np.sin(2 * np.pi * 31 * time)
    return np.round((0.004 + smooth) / 6e-6) * 6e-6


def forces(profile: SafeProfile, name: str, place: Array, rest: float) -> Array:
    """Force of one element from transfer functions, starting from rest at the first reading."""
    loop, element = profile.loop, profile.elements[name]
    ratio, span = loop.filter_damping_ratio, loop.velocity_window_samples or 1
    before = np.concatenate([np.full(span, place[0]), place])
    slow = (place - before[: place.size]) / (span * STEP)
    slope = np.diff(place, prepend=place[0]) / STEP

    def low_pass(below: Array, values: Array) -> Array:
        return np.asarray(lfilter([below.sum()], below, values))

    velocity = low_pass(poles(loop.velocity_filter_hz, loop.velocity_filter_order, ratio), slow)
    acceleration = low_pass(
        poles(loop.acceleration_filter_hz, loop.acceleration_filter_order, ratio),
        np.diff(slope, prepend=0.0) / STEP,
    )
    return -(
        element.stiffness * (place - rest)
        + element.damping * velocity
        + element.mass * acceleration
    )


@pytest.mark.parametrize("name", LOOPS)
def test_the_guard_runs_the_certified_law(tmp_path: Path, name: str) -> None:
    profile = unlimited(changed(**LOOPS[name]))
    guard = built(export(profile, "c"), tmp_path)
    place = movement()
    both = WALL | CUP
    calls = [enter(both), *(push(both, k, float(x)) for k, x in enumerate(place))]
    replies = guard.run(calls)[1:]
    assert {(reply.status, reply.missed, reply.clamped) for reply in replies} == {("OK", 0, False)}
    found = np.array([reply.force for reply in replies])

    level = np.minimum(np.arange(1, place.size + 1) * STEP / FADE, 1)
    cup = forces(profile, "cup", place, 0.0)
    wanted = forces(profile, "wall", place, place[0]) + level * cup
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())

    law = ControlLaw(simulated(profile), np.array([STEP]))
    played = np.array([law.force(np.array([x]))[0] for x in place]) + 500.0 * place[0]
    full = level == 1
    np.testing.assert_allclose(found[full], played[full], rtol=0, atol=1e-12 * np.abs(wanted).max())


def unlimited(profile: SafeProfile) -> SafeProfile:
    """The profile of a device whose force nothing limits, so that no reading is too far either."""
    device = profile.device.model_copy(update={"force_limit": BOUNDLESS})
    wall = profile.elements["wall"].model_copy(update={"force_level": BOUNDLESS.peak})
    elements = {**profile.elements, "wall": wall}
    return profile.model_copy(update={"device": device, "elements": elements}).signed()


def simulated(profile: SafeProfile) -> Controller:
    """Wall and cup as the simulator plays them, about zero."""
    loop = profile.loop
    return Controller(
        stiffness=500.0,
        damping=10.0 + profile.elements["cup"].damping,
        mass=profile.elements["cup"].mass,
        velocity_filter_hz=loop.velocity_filter_hz or np.inf,
        acceleration_filter_hz=loop.acceleration_filter_hz or np.inf,
        velocity_filter_order=loop.velocity_filter_order,
        acceleration_filter_order=loop.acceleration_filter_order,
        filter_damping_ratio=loop.filter_damping_ratio,
        velocity_window_samples=loop.velocity_window_samples or 1,
    )


def test_the_simulator_plays_what_the_guard_plays(tmp_path: Path) -> None:
    """Rubber, water and a cup between two walls: met, entered and left at once."""
    scene = {
        "wall": (12_000.0, 70.0, 0.0),
        "wall 2": (9_000.0, 52.5, 0.0),
        "rubber": (1400.0, 10.0, 0.0),
        "water": (0.0, 10.0, 0.0),
        "cup": (0.0, 0.0, 1.475),
    }
    profile = made("homerehab", scene, together=(("rubber", "water", "cup"),), speed=4.0)
    faces = {"wall": (-1, 0.004), "wall 2": (1, -0.006)}
    beside = [
        VirtualElement(
            stiffness=element.stiffness,
            damping=element.damping,
            mass=element.mass,
            side=faces.get(name, (0, 0.0))[0],
            place=faces.get(name, (0, 0.0))[1],
            level=element.force_level or np.inf,
            fade_time=element.fade_time,
        )
        for name, element in profile.elements.items()
    ]
    controller = Controller(
        velocity_filter_hz=50.0,
        acceleration_filter_hz=30.0,
        filter_damping_ratio=profile.loop.filter_damping_ratio,
        beside=tuple(beside),
        calls=Calls(entrance=0.001, taps=7),
    )
    time = np.arange(1400) * STEP
    place = 0.006 * np.sin(2 * np.pi * 2.3 * time) + 0.001 * np.cos(2 * np.pi * 17 * time) - 0.0021
    simulator = ControlLaw(controller, np.array([STEP]))
    wanted = [float(simulator.force(np.array([x]))[0]) for x in place]
    calls = [enter(28)]
    calls += [enter(1 << k, face, side) for k, (side, face) in enumerate(faces.values())]
    calls += [push(31 if x > 0.001 else 3, k, x) for k, x in enumerate(place.tolist())]
    replies = built(export(profile, "c"), tmp_path).run(calls)[3:]
    assert {reply.status for reply in replies} == {"OK"}
    found = np.clip(wanted, -28, 28)
    np.testing.assert_allclose([reply.force for reply in replies], found, atol=1e-10)
    assert found.max() > 10
    assert found.min() < -10


def test_springs_are_cut_at_their_levels_and_the_sum_at_the_peak(tmp_path: Path) -> None:
    springs = {"rubber": (700.0, 0.0, 0.0), "band": (700.0, 0.0, 0.0)}
    profile = made("homerehab", springs, together=(("rubber", "band"),))
    elements = {
        name: element.model_copy(update={"force_level": 20.0})
        for name, element in profile.elements.items()
    }
    profile = profile.model_copy(update={"elements": elements}).signed()
    guard = built(export(profile, "c"), tmp_path)
    for side in (1, -1):
        for touched, most in ((1, 20.0), (3, 28.0)):
            way = side * 1e-7 * np.arange(800) ** 2
            calls = [enter(3), *(push(touched, k, x) for k, x in enumerate(way.tolist()))]
            replies = guard.run(calls)[1:]
            assert {reply.status for reply in replies} == {"OK"}
            assert [reply.clamped for reply in (replies[100], replies[-1])] == [False, True]
            assert side * replies[-1].force == -most
