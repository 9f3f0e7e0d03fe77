"""Vibration modes, current lag and a hand on the handle, against independent integration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from datasets_synthetic import (
    Hand,
    Rig,
    Vibration,
    named_rig,
    rig_of,
    simulate,
)
from identification import Device
from tests.integrated_mechanism import integrated
from tests.plain_rigs import M, T, rig

SOFT = Vibration(frequency_hz=35.0, damping_ratio=0.02, at_encoder=0.6, at_handle=-1.4)
GRIP = Hand(mass=0.4, damping=6.0, stiffness=300.0, rest=0.002)


def test_stick_and_slip_of_a_vibrating_mechanism_match_an_adaptive_integrator() -> None:
    """The hand couples the mode to the rigid coordinate, which stops and breaks away by itself."""
    device = rig(mass=0.3, damping=1.0, coulomb_friction=0.8, modes=(SOFT,), delay=0.3 * T)
    force = np.repeat(np.random.default_rng(1).uniform(-2.5, 2.5, 15), 20)
    expected, speed = integrated(device, GRIP, force, 0.0, 0.1)
    read = simulate(device, force, hand=GRIP, velocity=0.1).position[0]
    assert 20 < np.count_nonzero(speed == 0) < 280
    assert np.min(speed) < 0 < np.max(speed)
    np.testing.assert_allclose(read, expected, rtol=0, atol=1e-7 * np.ptp(expected))


@pytest.mark.parametrize("turn", [0.05, 1.0, 10.0])
def test_a_mode_of_any_speed_rings_as_the_closed_form_says(turn: float) -> None:
    """ωT up to 10 rad a sample, released by a step of force; e·F/(m·w²)·(1 - e^(-zwt)·(..))."""
    w, z, e = turn / T, 0.02, 0.7
    mode = Vibration(frequency_hz=w / (2 * np.pi), damping_ratio=z, at_encoder=e, at_handle=e)
    samples = 60
    read = simulate(rig(damping=0.0, modes=(mode,)), np.full(samples, 2.0)).position[0]
    time = T * np.arange(samples)
    ring = w * np.sqrt(1 - z * z)
    shape = np.cos(ring * time) + z * w / ring * np.sin(ring * time)
    exact = e * e * 2.0 / (M * w * w) * (1 - np.exp(-z * w * time) * shape)
    rigid = 2.0 / M * time**2 / 2
    np.testing.assert_allclose(read - rigid, exact, rtol=0, atol=1e-9 * np.max(np.abs(exact)))


def test_current_lag_is_an_exponential() -> None:
    lag, samples = 0.8 * T, 40
    free = Rig(mass=1.0, damping=0.0, sample_time=T, current_lag=lag)
    time = T * np.arange(samples)
    exact = time**2 / 2 - lag * time - lag**2 * np.expm1(-time / lag)
    read = simulate(free, np.ones(samples)).position[0]
    np.testing.assert_allclose(read, exact, rtol=1e-11, atol=1e-18)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: replace(SOFT, frequency_hz=0.0), "frequency_hz of a mode must be positive, not 0"),
        (lambda: replace(SOFT, damping_ratio=-0.1), "damping_ratio must not be negative"),
        (lambda: rig(current_lag=-1e-3), "current_lag must be finite and not negative"),
        (
            lambda: rig(modes=(replace(SOFT, at_handle=np.ones(3)),), mass=[1.0, 2.0]),
            r"modes must be of 2 devices or of 1, not \{3\}",
        ),
        (
            lambda: simulate(rig(gravity_sine=1.0, modes=(SOFT,)), np.zeros(5)),
            "only one of the two is simulated",
        ),
        (lambda: simulate(rig(), np.zeros(5), push=np.zeros(4)), "push has 4 samples, force 5"),
    ],
)
def test_impossible_mechanisms_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_a_device_with_modes_becomes_a_rig_with_modes() -> None:
    device = Device.model_validate(
        {
            "sample_time": T,
            "mass": 1.0,
            "damping": 2.0,
            "current_lag": 2e-4,
            "modes": [{"frequency_hz": 60.0, "damping_ratio": 0.03, "at_encoder": 0.4}],
        }
    )
    made = rig_of(device)
    assert made.current_lag[0] == 2e-4
    assert made.modes[0] == Vibration(
        frequency_hz=60.0, damping_ratio=0.03, at_encoder=0.4, at_handle=0.4
    )
    assert named_rig("homerehab").modes == ()
