"""Filters of the simulated controller against scipy's, on readings that are noise alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter, tf2zpk

from datasets_synthetic import Controller, Faults, Rig, simulate
from tests.plain_rigs import B, M, T

FloatArray = NDArray[np.float64]

#: Held in place by friction, so that the reading is its noise.
FIXED = Rig(mass=3.0, damping=10.0, sample_time=T, coulomb_friction=1e12)


def heard(controller: Controller) -> tuple[FloatArray, FloatArray]:
    """Readings from rest at zero, and the force the controller answered with."""
    log = simulate(FIXED, np.zeros(400), controller=controller, faults=Faults(position_noise=1e-3))
    return log.position[0], log.force[0]


def through(reading: FloatArray, numerator: list[float], poles: list[complex]) -> FloatArray:
    """The filter (in powers of 1/z) with these poles, at rest at the first reading before."""
    moved = reading - reading[0]
    return np.asarray(lfilter(numerator, np.real(np.poly(poles)), moved))


def pair(cutoff: float, ratio: float) -> list[complex]:
    angle = ratio + 1j * np.sqrt(1 - ratio**2)
    return [complex(np.exp(-2 * np.pi * cutoff * T * turn)) for turn in (angle, np.conj(angle))]


@pytest.mark.parametrize("ratio", [1.0, 0.7071, 0.2])
def test_second_order_filters_have_the_stated_poles_and_gain_one(ratio: float) -> None:
    controller = Controller(
        damping=7.0,
        mass=0.3,
        velocity_filter_hz=40.0,
        acceleration_filter_hz=25.0,
        velocity_filter_order=2,
        filter_damping_ratio=ratio,
    )
    q, force = heard(controller)
    poles, others = pair(40.0, ratio), pair(25.0, ratio)
    gain, other = (float(np.real(np.prod([1 - p for p in some]))) for some in (poles, others))
    velocity = through(q, [gain / T, -gain / T], poles)
    acceleration = through(q, [other / T**2, -2 * other / T**2, other / T**2], others)
    expected = -(7.0 * velocity + 0.3 * acceleration)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-9 * np.ptp(expected))
    # At the printed damping ratio the poles are those of scipy's matched prototype.
    zeros, found, _ = tf2zpk([gain], np.real(np.poly(poles)))
    assert zeros.size == 0
    turn = np.log(found) / T
    np.testing.assert_allclose(np.abs(turn), 2 * np.pi * 40.0, rtol=1e-6)
    np.testing.assert_allclose(-turn.real / np.abs(turn), ratio, rtol=1e-6)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"velocity_filter_order": 3}, "velocity_filter_order must be 1 or 2, not 3"),
        (
            {"filter_damping_ratio": 0.0},
            "filter_damping_ratio must be above 0 and at most 1, not 0",
        ),
        ({"velocity_window_samples": 0}, "velocity_window_samples must be 1 sample or more, not 0"),
        ({"velocity_window_samples": 9, "velocity_filter_hz": 50.0}, "no velocity filter besides"),
    ],
)
def test_impossible_filters_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Controller(**wrong)


def test_filters_are_the_stated_difference_equations() -> None:
    """Held in place by friction, so that the reading is noise only and the forces can be redone."""
    fixed = Rig(mass=M, damping=B, sample_time=T, coulomb_friction=1e9)
    effects = Controller(
        stiffness=100.0, damping=7.0, mass=0.3, velocity_filter_hz=40.0, acceleration_filter_hz=25.0
    )
    log = simulate(fixed, np.full(300, 0.5), controller=effects, faults=Faults(position_noise=1e-3))
    q = log.position[0]
    pole, other = np.exp(-2 * np.pi * 40.0 * T), np.exp(-2 * np.pi * 25.0 * T)
    velocity = slope = acceleration = 0.0
    expected = [0.5 - 100.0 * q[0]]
    for k in range(1, 300):
        change = (q[k] - q[k - 1]) / T
        velocity = pole * velocity + (1 - pole) * change
        last, slope = slope, other * slope + (1 - other) * change
        acceleration = other * acceleration + (1 - other) * (slope - last) / T
        expected.append(0.5 - 100.0 * q[k] - 7.0 * velocity - 0.3 * acceleration)
    np.testing.assert_allclose(log.force[0], expected, rtol=1e-9, atol=1e-9)
