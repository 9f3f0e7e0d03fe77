"""Vibration modes, current lag and a hand on the handle, against independent integration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from datasets_synthetic import (
    Clock,
    Controller,
    Faults,
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

FloatArray = NDArray[np.float64]

#: What the maps promise, 1.3e-13 of the motion a rate, with a margin for a few hundred samples.
MAP_ERROR = 1e-10

SOFT = Vibration(frequency_hz=35.0, damping_ratio=0.02, at_encoder=0.6, at_handle=-1.4)
STIFF = Vibration(frequency_hz=260.0, damping_ratio=0.01, at_encoder=-0.3, at_handle=0.5)
GRIP = Hand(mass=0.4, damping=6.0, stiffness=300.0, rest=0.002)


@pytest.mark.long
def test_modes_hand_lag_and_fractional_delay_match_an_adaptive_integrator() -> None:
    device = rig(
        delay=1.37 * T, current_lag=0.4 * T, force_offset=0.7, modes=(SOFT, STIFF), damping=4.0
    )
    force = np.random.default_rng(0).uniform(-5, 5, 250)
    expected, _ = integrated(device, GRIP, force, 0.001, 0.05)
    read = simulate(device, force, hand=GRIP, position=0.001, velocity=0.05).position[0]
    np.testing.assert_allclose(read, expected, rtol=0, atol=1e-9 * np.ptp(expected))


def test_stick_and_slip_of_a_vibrating_mechanism_match_an_adaptive_integrator() -> None:
    """The hand couples the mode to the rigid coordinate, which stops and breaks away by itself."""
    device = rig(mass=0.3, damping=1.0, coulomb_friction=0.8, modes=(SOFT,), delay=0.3 * T)
    force = np.repeat(np.random.default_rng(1).uniform(-2.5, 2.5, 15), 20)
    expected, speed = integrated(device, GRIP, force, 0.0, 0.1)
    read = simulate(device, force, hand=GRIP, velocity=0.1).position[0]
    assert 20 < np.count_nonzero(speed == 0) < 280
    assert np.min(speed) < 0 < np.max(speed)
    np.testing.assert_allclose(read, expected, rtol=0, atol=1e-7 * np.ptp(expected))


def test_two_bodies_on_a_spring_are_one_mode() -> None:
    """Motor m1 and handle m2, integrated as two bodies: e = √(m2/m1), h = -√(m1/m2)."""
    m1, m2, spring, loss = 0.5, 0.2, 900.0, 0.3
    reduced = m1 * m2 / (m1 + m2)
    w = np.sqrt(spring / reduced)
    ratio = loss / (2 * np.sqrt(spring * reduced))
    device = Rig(
        mass=m1 + m2,
        damping=0.0,
        sample_time=T,
        modes=(
            Vibration(
                frequency_hz=w / (2 * np.pi),
                damping_ratio=ratio,
                at_encoder=np.sqrt(m2 / m1),
                at_handle=-np.sqrt(m1 / m2),
            ),
        ),
    )
    hand = Hand(mass=0.1, damping=2.0, stiffness=50.0)

    def slope(_: float, s: FloatArray, force: float) -> list[float]:
        coupling = spring * (s[0] - s[1]) + loss * (s[2] - s[3])
        grip = 2.0 * s[3] + 50.0 * s[1]
        return [s[2], s[3], (force - coupling) / m1, (coupling - grip) / (m2 + 0.1)]

    force = np.random.default_rng(2).uniform(-1, 1, 150)
    state, motor, handle = np.zeros(4), np.empty(150), np.empty(150)
    for k, pull in enumerate(force):
        motor[k], handle[k] = state[0], state[1]
        found = solve_ivp(
            slope, (0.0, T), state, args=(float(pull),), method="DOP853", rtol=1e-12, atol=1e-16
        )
        state = np.array(found.y[:, -1])
    recording = simulate(device, force, hand=hand, watch=True)
    assert recording.truth is not None
    np.testing.assert_allclose(recording.position[0], motor, rtol=0, atol=1e-10 * np.ptp(motor))
    np.testing.assert_allclose(
        recording.truth.handle[0], handle, rtol=0, atol=1e-10 * np.ptp(handle)
    )


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


def test_batch_of_mechanisms_equals_singles() -> None:
    several = rig(
        mass=[3.0, 0.5],
        coulomb_friction=[0.8, 0.0],
        current_lag=[0.0, 0.3 * T],
        delay=[0.0, 1.3 * T],
        modes=(replace(SOFT, frequency_hz=np.array([35.0, 90.0])),),
    )
    hand = Hand(mass=np.array([0.2, 0.0]), stiffness=100.0)
    gains = Controller(stiffness=np.array([200.0, 50.0]), velocity_filter_hz=30.0, damping=2.0)
    together = simulate(several, np.zeros(400), controller=gains, hand=hand, velocity=0.1)
    for member in (0, 1):
        which = np.array([member])
        alone = simulate(
            several.members(which),
            np.zeros(400),
            controller=gains.members(which),
            hand=hand.members(which),
            velocity=0.1,
        )
        np.testing.assert_allclose(
            together.position[member], alone.position[0], rtol=0, atol=MAP_ERROR * 0.1
        )


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


def test_a_mode_that_nobody_feels_changes_nothing() -> None:
    """The mechanism's own path then is the rigid device, stick-slip, hand and jitter included."""
    silent = Vibration(frequency_hz=40.0, damping_ratio=0.1, at_encoder=0.0, at_handle=0.0)
    plain = rig(
        mass=[3.0, 0.4],
        coulomb_friction=[0.8, 0.0],
        coulomb_asymmetry=[0.2, 0.0],
        damping_asymmetry=[2.0, 0.5],
        stiffness=50.0,
        delay=[0.0004, 0.0017],
    )
    force = np.repeat(np.random.default_rng(3).uniform(-6, 6, (2, 20)), 20, axis=1)
    controller = Controller(stiffness=200.0, damping=3.0, velocity_filter_hz=50.0)
    for clock in (Clock(), Clock(jitter=2e-4)):
        one, other = (
            simulate(
                device,
                force,
                hand=replace(GRIP, tremor=0.1),
                controller=controller,
                faults=Faults(force_noise=0.05, position_noise=1e-6),
                clock=clock,
                seed=4,
                watch=True,
            )
            for device in (plain, replace(plain, modes=(silent,)))
        )
        size = np.ptp(one.position)
        np.testing.assert_allclose(other.position, one.position, rtol=0, atol=2e-8 * size)
        assert one.truth is not None
        assert other.truth is not None
        np.testing.assert_allclose(other.truth.energy, one.truth.energy, rtol=1e-6, atol=1e-12)


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
