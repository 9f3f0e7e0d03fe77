"""Friction that the model lacks is found, named, and its slope is what the certificate holds."""

from dataclasses import dataclass, replace
from math import pi, sin
from typing import Any

import numpy as np
import pytest

from identification import Hardware, SlopeRange, Trajectory, identify, load_device
from tests.outside_axis import Axis, Drive, play
from tests.simulated.catalogue.motions import multisine
from tests.thinned import thinned

STEP, COUNT, PEAK = 1e-3, 6e-6, 28.0
HARDWARE = Hardware.model_validate(
    {
        "motion": "linear",
        "sample_time": STEP,
        "delay": STEP,
        "encoder_resolution": COUNT,
        "force_limit": {"continuous": 14.0, "peak": PEAK},
    }
)
#: What makes about 8 % of the force, and what it is found to be; part by which damping varies.
UNEVEN = 0.34
FRICTION: dict[str, tuple[dict[str, Any], str]] = {
    "plain": ({}, ""),
    "drag": ({"drag": 12.0}, "drag"),
    "static": ({"static": 0.63, "stribeck": 0.03}, "falling"),
    "uneven": ({"grade": lambda x: 1 + UNEVEN * sin(2 * pi * x / 0.05)}, "place"),
    "bristle": ({"bristle_stiffness": 500.0}, "memory"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """A log of a device, the slopes of its friction over the speeds seen, falling part left out."""

    trajectory: Trajectory
    axis: Axis
    slopes: tuple[float, float]
    share: float  # rms of what the model lacks over the rms of the force


def record(kind: str, seed: int, *, servo: bool) -> Recorded:
    """6 s of a device near HomeRehab's, whose friction is of a kind."""
    mass, damping, coulomb = np.random.default_rng((seed, 77)).uniform(0.7, 1.3, 3).tolist()
    axis = Axis(mass=3 * mass, damping=10 * damping, coulomb=0.8 * coulomb, **FRICTION[kind][0])
    time = STEP * np.arange(6000, dtype=np.float64)
    course = multisine(time, 0.2, 4.0, seed).scaled(0.1)
    plan = 3 * course.acceleration + 10 * course.velocity + 0.8 * np.sign(course.velocity)
    drive = Drive(
        sample_time=STEP,
        plan=course.position if servo else plan,
        delay=STEP,
        count=COUNT,
        servo=(3000.0, 90.0) if servo else None,
        limit=PEAK,
    )
    played = play(axis, drive, np.random.default_rng(seed))
    beyond = played.further + played.dry - axis.coulomb * np.sign(np.gradient(played.reading))
    part = UNEVEN * axis.damping if axis.grade else 0.0
    return Recorded(
        trajectory=Trajectory(time=time, force=played.command, position=played.reading),
        axis=axis,
        slopes=(axis.damping - part, axis.damping + part + 2 * axis.drag * played.fastest),
        share=float(np.std(beyond) / np.std(played.command)),
    )


@pytest.mark.parametrize(
    ("kind", "servo"),
    thinned([("bristle", True), ("drag", False), ("uneven", False), ("static", True)], 1),
)
def test_each_kind_is_named_and_mass_and_slope_are_right_beside_it(kind: str, servo: bool) -> None:
    log = record(kind, 5, servo=servo)
    curve = identify(log.trajectory, hardware=HARDWARE).logs[0].curve
    assert curve is not None
    assert curve.found[0].kind == FRICTION[kind][1]
    assert 0.3 * log.share < curve.found[0].share < 1.7 * log.share
    least, greatest = log.slopes
    assert 0.8 * least < curve.slope.low <= least
    assert greatest <= curve.slope.high
    assert abs(curve.mass / log.axis.mass - 1) < 0.01
    held, stiffness = curve.presliding, log.axis.bristle_stiffness
    assert (held is None) == (not stiffness)
    if held is not None:
        # Where it turns, a bristle is up to twice as stiff as at rest.
        assert stiffness <= held.high <= 3 * stiffness
        assert 0 < held.low < held.high


@pytest.mark.parametrize("seed", thinned(range(2), 1))
@pytest.mark.parametrize("servo", [False, True])
def test_plain_friction_shows_no_curve(seed: int, servo: bool) -> None:
    log = record("plain", seed, servo=servo).trajectory
    assert identify(log, hardware=HARDWARE).logs[0].curve is None


def test_drag_is_told_and_the_box_holds_its_slopes() -> None:
    log = record("drag", 0, servo=False)
    found = identify(log.trajectory, hardware=HARDWARE)
    assert [each.code for each in found.findings] == ["unmodelled-force"]
    assert "drag that grows faster than speed" in found.findings[0].seen
    device = found.device
    assert device.damping_slope is not None
    box = device.simultaneous_box()
    assert box.damping == (device.damping_slope.low, device.damping_slope.high)
    assert device.damping.low > log.slopes[0], "damping alone would be certified away"
    assert device.logs[0].unmodelled_forces[0].kind == "drag"


def test_the_box_takes_the_wider_of_interval_and_slopes() -> None:
    device = load_device("homerehab")
    plain = device.simultaneous_box()
    inside = device.model_copy(update={"damping_slope": SlopeRange(low=9.99, high=10.01)})
    assert inside.simultaneous_box() == plain
    wider = device.model_copy(update={"damping_slope": SlopeRange(low=4.0, high=10.01)})
    assert wider.simultaneous_box() == replace(plain, damping=(4.0, plain.damping[1]))
