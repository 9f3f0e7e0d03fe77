"""The simulator against closed forms written out here, and against its own stated error."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Rig, simulate
from tests.plain_rigs import B, M, T, clock, rig, step_response

FloatArray = NDArray[np.float64]


def test_constant_force_matches_the_closed_form() -> None:
    position = simulate(rig(), np.full(2000, 5.0)).position[0]
    np.testing.assert_allclose(position, 5.0 * step_response(clock(2000)), rtol=1e-9, atol=1e-15)


def test_sine_matches_the_closed_form() -> None:
    """m·q̈ + b·q̇ = A·sin(ωt) from rest."""
    omega, amplitude = 2 * np.pi * 2.0, 6.0

    def held(step: float) -> FloatArray:
        time = clock(round(2.0 / step), step)
        device = Rig(mass=M, damping=B, sample_time=step)
        return simulate(device, amplitude * np.sin(omega * (time + step / 2))).position[0]

    coarse, fine = held(4e-4), held(2e-4)[::2]
    time = clock(coarse.size, 4e-4)
    square = B**2 + (M * omega) ** 2
    steady = -amplitude * (M * omega * np.sin(omega * time) + B * np.cos(omega * time))
    steady /= omega * square
    transient = -amplitude * M**2 * omega / (B * square) * np.exp(-B / M * time)
    exact = steady + transient + amplitude / (B * omega)
    size = np.ptp(exact)
    np.testing.assert_allclose((4 * fine - coarse) / 3, exact, rtol=0, atol=1e-10 * size)
    assert np.max(np.abs(fine - exact)) < (omega * 2e-4) ** 2 * size


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0, 1.37, 2.0, 3.999])
def test_delay_shifts_the_force_by_any_fraction_of_a_sample(delay: float) -> None:
    force = np.random.default_rng(0).uniform(-5, 5, 150)
    position = simulate(rig(delay=delay * T), force).position[0]
    time = clock(150)
    changes = np.diff(force, prepend=0.0)
    expected = sum(
        change * step_response(time - k * T - delay * T) for k, change in enumerate(changes)
    )
    np.testing.assert_allclose(position, expected, rtol=0, atol=1e-9 * np.ptp(position))


def test_coulomb_friction_alone_stops_after_the_known_distance() -> None:
    """Constant deceleration Fc/m: distance v0²·m/(2Fc), wherever in a sample it ends."""
    speeds = np.array([0.05, 0.1, 0.1234567, -0.2])
    position = simulate(
        Rig(mass=M, damping=0.0, sample_time=T, coulomb_friction=0.8),
        np.zeros(1000),
        velocity=speeds,
    ).position
    distance = np.sign(speeds) * speeds**2 * M / (2 * 0.8)
    np.testing.assert_allclose(position[:, -1], distance, rtol=1e-12)
    stopping = np.abs(speeds) * M / 0.8
    time = clock(1000)[None, :]
    gone = np.minimum(time, stopping[:, None])
    decelerating = np.sign(speeds)[:, None] * (
        np.abs(speeds)[:, None] * gone - 0.8 / M * gone**2 / 2
    )
    np.testing.assert_allclose(position, decelerating, rtol=1e-11, atol=1e-15)


def test_force_turns_a_moving_device_round_inside_a_sample() -> None:
    """Against the motion Fc adds to the force, after the reversal it is taken off."""
    against, back = (2.0 + 0.8) / M, (2.0 - 0.8) / M
    speed = 0.01234
    time = clock(400)
    position = simulate(
        Rig(mass=M, damping=0.0, sample_time=T, coulomb_friction=0.8),
        np.full(400, -2.0),
        velocity=speed,
    ).position[0]
    turn = speed / against
    assert (turn / T) % 1 > 0.1
    before = speed * time - against * time**2 / 2
    after = speed * turn / 2 - back * (time - turn) ** 2 / 2
    np.testing.assert_allclose(
        position, np.where(time < turn, before, after), rtol=1e-11, atol=1e-15
    )
