"""Friction by direction, fields, hands and unlogged forces against independent integration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import welch
from scipy.special import ellipk

from datasets_synthetic import Faults, Hand, Recording, Rig, simulate
from tests.plain_rigs import T, rig

FloatArray = NDArray[np.float64]

#: Relative error of one integration step, |h·p|⁴/120 at the default 0.02, with a margin of ten for
#: what adds up over a few hundred samples.
STEP_ERROR = 1e-8


def resisting(truth: dict[str, Any], q: float) -> float:
    """Force of position and offset, N."""
    gravity = truth["gravity_sine"] * np.sin(q) + truth["gravity_cosine"] * np.cos(q)
    return truth["force_offset"] + truth["stiffness"] * q + gravity


def slide(
    truth: dict[str, Any], state: tuple[float, float], pull: float, way: float, left: float
) -> tuple[float, float, float]:
    """Position, speed and time spent until ``left`` s have passed or the device is at rest."""
    damping = truth["damping"] + way * truth["damping_asymmetry"]
    grip = truth["coulomb_friction"] + way * truth["coulomb_asymmetry"]

    def motion(_: float, now: FloatArray) -> list[float]:
        friction = damping * now[1] + way * grip
        return [now[1], (pull - friction - resisting(truth, now[0])) / truth["mass"]]

    def at_rest(time: float, now: FloatArray) -> float:
        return way * now[1] if time > 0 else 1.0  # the start from rest is no stop

    setattr(at_rest, "terminal", True)  # noqa: B010 what solve_ivp looks for
    found = solve_ivp(
        motion, (0.0, left), state, events=at_rest, method="DOP853", rtol=1e-11, atol=1e-14
    )
    q, v = (float(value) for value in found.y[:, -1])
    return q, 0.0 if found.status == 1 else v, float(found.t[-1])


def integrated(truth: dict[str, Any], force: FloatArray, start: float) -> FloatArray:
    """The law by an adaptive eighth-order method that stops at every instant of rest."""
    forward = truth["coulomb_friction"] + truth["coulomb_asymmetry"]
    backward = truth["coulomb_friction"] - truth["coulomb_asymmetry"]
    q, v, positions = start, 0.0, np.empty(force.size)
    for k, pull in enumerate(force):
        positions[k] = q
        left = T
        while left > 0:
            way = float(np.sign(v))
            if v == 0:
                net = pull - resisting(truth, q)
                way = 1.0 if net > forward else -1.0 if net < -backward else 0.0
            if way == 0:
                break
            q, v, spent = slide(truth, (q, v), float(pull), way, left)
            left -= spent
    return positions


def test_everything_at_once_matches_an_adaptive_integrator() -> None:
    """Stick and slip, both directions and a curved field: 600 samples of random force."""
    truth: dict[str, Any] = {
        "mass": 0.05,
        "damping": 0.3,
        "damping_asymmetry": 0.1,
        "coulomb_friction": 0.5,
        "coulomb_asymmetry": -0.15,
        "force_offset": 0.1,
        "stiffness": 0.8,
        "gravity_sine": 1.5,
        "gravity_cosine": -0.4,
    }
    force = np.repeat(np.random.default_rng(2).uniform(-1.5, 1.5, 20), 30)
    expected = integrated(truth, force, 0.3)
    position = simulate(Rig(**truth, sample_time=T), force, position=0.3).position[0]
    held = np.count_nonzero(np.diff(expected) == 0)
    assert 50 < held < 550  # it does both stick and move
    assert np.min(np.diff(expected)) < 0 < np.max(np.diff(expected))
    np.testing.assert_allclose(position, expected, rtol=0, atol=STEP_ERROR * np.ptp(expected))


def test_a_pendulum_swings_with_the_period_of_the_elliptic_integral() -> None:
    """Without damping it is back where it started after a period, which depends on the swing."""
    starts = np.array([0.1, 1.0, 2.5])
    rate = np.sqrt(1.5 / 0.05)
    period = 4 / rate * ellipk(np.sin(starts / 2) ** 2)
    for start, turn in zip(starts, period, strict=True):
        arm = Rig(mass=0.05, damping=0.0, gravity_sine=1.5, sample_time=turn / 1000)
        position = simulate(arm, np.zeros(1001), position=start).position[0]
        assert position[1000] == pytest.approx(start, rel=1e-9)
        assert position[500] == pytest.approx(-start, rel=1e-7)
        assert abs(position[250]) < 1e-6 * start


def felt(recording: Recording, mass: float) -> FloatArray:
    """Unlogged force on a free mass, mean of neighbouring samples: m·(second difference)/T²."""
    assert not np.any(recording.force)
    return mass * np.diff(recording.position, n=2, axis=1) / T**2


def test_tremor_is_between_8_and_12_hz_and_of_the_stated_size() -> None:
    free = Rig(mass=1.0, damping=0.0, sample_time=T)
    force = felt(simulate(free, np.zeros((40, 10_000)), hand=Hand(tremor=0.4), seed=4), 1.0)
    # 400 s of a band of 4 Hz hold 3 200 independent values: the sampling error of the rms is
    # 1.3 %, that of the kurtosis 0.09.
    assert np.std(force) == pytest.approx(0.4, rel=0.04)
    frequency, power = welch(force, fs=1 / T, nperseg=5000)
    power = np.mean(power, axis=0)
    inside = (frequency > 7.5) & (frequency < 12.5)
    assert np.sum(power[inside]) > 0.995 * np.sum(power)
    quarters = [np.sum(power[(frequency > f) & (frequency <= f + 1)]) for f in (8, 9, 10, 11)]
    assert min(quarters) > 0.7 * max(quarters)  # a band, not a line
    assert np.mean(force**4) / np.mean(force**2) ** 2 == pytest.approx(3.0, abs=0.3)
    together = np.asarray(np.corrcoef(force)) - np.eye(40)
    assert np.max(np.abs(together)) < 0.6  # 80 values each: 5 sigma


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: rig(coulomb_friction=0.5, coulomb_asymmetry=0.6),
            r"coulomb_asymmetry must not exceed coulomb_friction, 0\.5, not 0\.6",
        ),
        (lambda: rig(stiffness=np.nan), "stiffness must be finite, not nan"),
        (lambda: Faults(correlation_time=0.0), "correlation_time must be positive, not 0"),
    ],
)
def test_impossible_forces_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
