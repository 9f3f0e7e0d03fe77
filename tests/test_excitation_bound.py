"""The bound of a planned force and its slope, against finite differences of the simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from datasets_synthetic import Rig, simulate
from identification import (
    ExcitationSpec,
)
from identification.planning.information import NORMAL_95, DesignCriterion, Friction, predict
from identification.planning.stick_slip import Guess, Response, sensitivities, simulate_stick_slip
from tests.excitation_plans import STEP, Array, rig_of, spec, wave


def test_stick_slip_is_the_simulator() -> None:
    """Two ways: pieces in closed form here, Runge-Kutta there; the device sticks now and then."""
    force = wave(3000)
    guess = Guess(mass=3.0, damping=10.0, coulomb_friction=3.0, force_offset=0.4)
    motion = simulate_stick_slip(force, guess, STEP)
    assert 100 < np.sum(motion.velocity == 0) < 2000
    truth = simulate(
        Rig(mass=3.0, damping=10.0, coulomb_friction=3.0, force_offset=0.4, sample_time=STEP),
        np.append(force, 0.0),
    ).position[0]
    np.testing.assert_allclose(motion.position, truth, atol=1e-9 * np.abs(truth).max())


def test_sensitivities_with_friction_are_those_of_the_simulator() -> None:
    """Turns and standstills move with the parameters."""
    force = np.append(wave(1500), 0.0)
    truth: dict[str, Any] = {
        "mass": 3.0,
        "damping": 10.0,
        "coulomb_friction": 3.0,
        "force_offset": 0.4,
    }
    got = sensitivities(force[:-1], Guess(**truth), STEP)
    for column, (name, value) in enumerate(truth.items()):
        sides = [
            simulate(Rig(sample_time=STEP, **(truth | {name: value + side})), force).position[0]
            for side in (1e-5, -1e-5)
        ]
        slope = (sides[0] - sides[1]) / 2e-5
        np.testing.assert_allclose(got[:, column], slope, atol=1e-5 * np.abs(slope).max())
    assert not np.any(got[:, 4])  # it sticks at first


def jacobian(plan: ExcitationSpec, force: Array, *, delay: bool) -> Array:
    """Position by mass, damping, offset, start and velocity (and delay), from the simulator."""
    mass, damping = plan.mass.value, plan.damping.value
    late = 0.3 * STEP  # a fraction, so that the delay can be moved either way

    def position(start: float = 0.0, velocity: float = 0.0, **others: float) -> Array:
        rig = rig_of(plan, **({"delay": late} | others))
        moved = simulate(rig, np.append(force, 0.0), position=start, velocity=velocity)
        return moved.position[0]

    def slope(name: str, value: float, size: float) -> Array:
        ahead, behind = (position(**{name: value + side * size}) for side in (1, -1))
        return (ahead - behind) / (2 * size)

    columns = [
        slope("mass", mass, 1e-3 * mass),
        slope("damping", damping, 1e-3 * damping),
        slope("force_offset", 0.0, 1e-2),
        slope("start", 0.0, 1e-2),
        slope("velocity", 0.0, 1e-2),
    ]
    if delay:
        columns.append(slope("delay", late, 0.1 * STEP))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("delay_known", [True, False])
def test_bound_is_that_of_finite_differences_of_the_simulator(delay_known: bool) -> None:
    plan = spec()
    force = wave(2000)
    table = jacobian(plan, force, delay=not delay_known) / plan.reading_noise
    truth = np.linalg.inv(table.T @ table)[:2, :2]
    shifted = force * 0.7 + 0.3 * np.concatenate(([0.0], force[:-1]))  # held 0.3 samples later
    got = predict(
        shifted,
        Guess(mass=3.0, damping=10.0),
        step=STEP,
        noise=plan.reading_noise,
        delay_known=delay_known,
    )
    # Differences over 1e-3 leave 1e-6; the averaged force is late by 0.3 samples only on average.
    np.testing.assert_allclose(got.covariance, truth, rtol=1e-3)
    assert got.mass == pytest.approx(NORMAL_95 * np.sqrt(truth[0, 0]), rel=1e-3)


def test_bound_with_unknown_force_is_that_of_the_dense_covariance() -> None:
    plan = spec()
    samples, unknown = 600, 0.05
    force = wave(samples)
    table = jacobian(plan, force, delay=False)
    kick = np.zeros(samples + 1)
    kick[0] = unknown
    answer_to_one = simulate(rig_of(plan), kick).position[0]
    lag = np.subtract.outer(np.arange(samples + 1), np.arange(samples))
    spread = np.where(lag >= 0, answer_to_one[np.maximum(lag, 0)], 0.0)
    noise = plan.reading_noise**2 * np.eye(samples + 1) + spread @ spread.T
    truth = np.linalg.inv(table.T @ np.linalg.solve(noise, table))[:2, :2]
    got = predict(
        force * 0.7 + 0.3 * np.concatenate(([0.0], force[:-1])),
        Guess(mass=3.0, damping=10.0),
        step=STEP,
        noise=plan.reading_noise,
        force_noise=unknown,
    )
    # The Kalman filter is taken as settled from the first sample on: a few samples of 600.
    np.testing.assert_allclose(got.covariance, truth, rtol=0.02)
    assert (
        got.mass
        > 5
        * predict(force, Guess(mass=3.0, damping=10.0), step=STEP, noise=plan.reading_noise).mass
    )


@pytest.mark.parametrize(
    "friction", [None, Friction(grip=0.3, blur=1e-4, speed=0.5, acceleration=4)]
)
@pytest.mark.parametrize("delay_known", [True, False])
@pytest.mark.parametrize("unknown", [0.0, 0.05])
def test_gradient_of_the_merit(
    friction: Friction | None, delay_known: bool, unknown: float
) -> None:
    response = Response(rate=3.3, step=0.01, count=400, noise=1e-6, acceleration_noise=unknown)
    merit = DesignCriterion(
        response=response,
        unknowns=response.unknowns(),
        friction=friction,
        delay_known=delay_known,
    )
    time = np.arange(400) * 0.01
    pull: Array = 4 * np.sin(2 * np.pi * 1.3 * time) + np.cos(2 * np.pi * 0.4 * time)
    along: Array = np.convolve(
        np.random.default_rng(0).standard_normal(400), np.ones(9) / 9, "same"
    )
    size = 1e-4
    slope = (merit(pull + size * along)[0] - merit(pull - size * along)[0]) / (2 * size)
    assert merit(pull)[1] @ along == pytest.approx(slope, rel=1e-5)
