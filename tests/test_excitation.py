"""Planned forces: limits kept by simulated devices, intervals against sweeps and estimates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from datasets_synthetic import Faults, Rig, simulate
from identification import (
    ExcitationSpec,
    plan_excitation,
)
from identification.estimators.estimate import Model
from identification.planning.information import NORMAL_95, predict
from identification.planning.limits import Guess
from tests.estimates import estimate_by
from tests.excitation_plans import (
    FRICTION,
    LIMITS,
    RANGES,
    STEP,
    Array,
    planned,
    rig_of,
    spec,
    wave,
)
from tests.thinned import thinned


@pytest.mark.parametrize(
    "name",
    [
        name if name == "homerehab" else pytest.param(name, marks=pytest.mark.long)
        for name in LIMITS
    ],
)
def test_the_simulated_device_keeps_the_limits_and_comes_back_to_rest(name: str) -> None:
    plan = planned(name)
    limits = plan.spec
    force = plan.best.force
    assert force.size == limits.samples + 1
    assert force[0] == force[-1] == 0
    assert np.max(np.abs(force)) <= limits.force
    assert np.max(np.abs(force[:30])) < 0.1 * limits.force  # a tenth of the ramp
    position = simulate(rig_of(limits), force).position[0]
    speed = np.diff(position) / STEP
    assert 0.97 * limits.travel < np.max(np.abs(position)) <= limits.travel
    assert limits.speed is not None
    assert np.max(np.abs(speed)) <= limits.speed
    assert abs(position[-1]) < 1e-3 * limits.travel
    assert abs(speed[-1]) < 1e-3 * limits.speed


@pytest.mark.long
@pytest.mark.parametrize("friction", thinned([0.8, 0.0], 1))
def test_every_device_between_the_guesses_keeps_the_limits(friction: float) -> None:
    ranges: dict[str, Any] = {
        name: {"value": value, "low": 0.7 * value, "high": 1.3 * value}
        for name, value in (("mass", 3.0), ("damping", 10.0), ("coulomb_friction", friction))
    }
    ranges["force_offset"] = {"value": 0.0, "low": -0.05, "high": 0.05}
    plan = plan_excitation(spec(duration=2.0, **ranges))
    generator = np.random.default_rng(5)
    many = [generator.choice([0.7, 0.85, 1.0, 1.15, 1.3], 200) for _ in range(3)]
    rig = Rig(
        mass=3.0 * many[0],
        damping=10.0 * many[1],
        coulomb_friction=friction * many[2],
        force_offset=generator.uniform(-0.05, 0.05, 200),
        sample_time=STEP,
    )
    position = simulate(rig, plan.best.force).position
    assert np.max(np.abs(position)) <= plan.spec.travel
    assert plan.spec.speed is not None
    assert np.max(np.abs(np.diff(position))) / STEP <= plan.spec.speed
    assert np.max(np.abs(position)) > 0.8 * plan.spec.travel
    assert np.max(np.abs(plan.best.force)) <= plan.spec.force


def sweeps(plan: ExcitationSpec) -> Array:
    """Ten swept sines, each from two phases, at the same limits and with the same ramps, (20, n).

    The device is taken to start where the motion is then centred. The planned force has to stay
    within its travel from the middle: the sweeps have it easier.
    """
    time = np.arange(plan.samples) * plan.sample_time
    nearer = np.minimum(time, plan.duration - time) / plan.ramp
    fade = np.sin(np.pi / 2 * np.minimum(nearer, 1.0)) ** 2
    shapes: list[Array] = []
    for first, last in RANGES:
        ratio = np.log(last / first)
        for cycles in (
            first * time + (last - first) * time**2 / (2 * plan.duration),
            first * plan.duration / ratio * np.expm1(ratio * time / plan.duration),
        ):
            shapes += [np.sin(2 * np.pi * (cycles + phase)) * fade for phase in (0.0, 0.25)]
    shape = np.stack(shapes)
    low, high = np.zeros(len(shapes)), np.full(len(shapes), plan.force)
    for _ in range(12):
        middle = (low + high) / 2
        fits = _load(plan, middle[:, None] * shape) <= 1
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        if plan.coulomb_friction.value == 0:  # then the load is in proportion
            break
    if plan.coulomb_friction.value == 0:
        low = plan.force / np.maximum(_load(plan, plan.force * shape), 1.0)
    return low[:, None] * shape


def _load(plan: ExcitationSpec, force: Array) -> Array:
    """The largest part of a limit that each force uses, shape (batch,)."""
    assert plan.speed is not None
    rest = np.zeros((force.shape[0], 1))
    position = simulate(rig_of(plan), np.concatenate((force, rest), axis=1)).position
    speed = np.max(np.abs(np.diff(position)), axis=1) / plan.sample_time
    travel = np.ptp(position, axis=1) / 2
    return np.maximum(np.maximum(travel / plan.travel, speed / plan.speed), 0.0)


@pytest.mark.parametrize("name", thinned(LIMITS, 1))
def test_intervals_are_30_percent_narrower_than_the_best_of_ten_sweeps(name: str) -> None:
    """Each against the sweep that is best for it, so no single sweep is as good as the ten."""
    plan = planned(name)
    limits = plan.spec
    guess = Guess(mass=limits.mass.value, damping=limits.damping.value)
    found = [
        predict(force, guess, step=STEP, noise=limits.reading_noise) for force in sweeps(limits)
    ]
    assert plan.mass < 0.7 * min(each.mass for each in found)
    assert plan.damping < 0.7 * min(each.damping for each in found)


def obtained(plan: ExcitationSpec, force: Array, logs: int, seed: int = 1000) -> Array:
    """Half-widths of 95 % of the estimates of mass and damping from simulated logs, shape (2,)."""
    rig = rig_of(plan, encoder_resolution=plan.encoder_resolution)
    faults = Faults(position_noise=plan.position_noise)
    recording = simulate(rig, force, faults=faults, seed=list(range(seed, seed + logs)))
    model = Model(coulomb=plan.coulomb_friction.value > 0, offset=True)
    values = [
        estimate_by("output-error", recording.trajectory(log), model, 0.0).values[:2]
        for log in range(logs)
    ]
    return NORMAL_95 * np.std(values, axis=0, ddof=1)


@pytest.mark.long
def test_predicted_and_obtained_intervals_agree() -> None:
    plan = planned("homerehab")
    got = obtained(plan.spec, plan.best.force, logs=250)
    # 250 logs know a spread to 4.5 %.
    np.testing.assert_allclose([plan.mass, plan.damping], got, rtol=0.10)


@pytest.mark.long
@pytest.mark.parametrize("name", LIMITS)
def test_predicted_and_obtained_intervals_agree_for_all(name: str) -> None:
    plan = planned(name, 10.0)
    got = obtained(plan.spec, plan.best.force, logs=400)
    np.testing.assert_allclose([plan.mass, plan.damping], got, rtol=0.10)


@pytest.mark.long
@pytest.mark.parametrize("name", LIMITS)
def test_with_friction_intervals_agree_and_sweeps_are_beaten(name: str) -> None:
    plan = planned(name, 10.0, FRICTION[name])
    got = obtained(plan.spec, plan.best.force, logs=400)
    np.testing.assert_allclose([plan.mass, plan.damping], got, rtol=0.10)
    limits = plan.spec
    guess = Guess(
        mass=limits.mass.value,
        damping=limits.damping.value,
        coulomb_friction=limits.coulomb_friction.value,
    )
    found = [
        predict(force, guess, step=STEP, noise=limits.reading_noise) for force in sweeps(limits)
    ]
    assert plan.mass < 0.7 * min(each.mass for each in found)
    assert plan.damping < 0.7 * min(each.damping for each in found)


def test_families_are_compared_and_the_best_is_played() -> None:
    limits = spec(duration=2.0, coulomb_friction=0.8)
    seen: list[str] = []
    plan = plan_excitation(limits, progress=seen.append)
    assert seen == [
        "designing a multisine",
        "designing a swept sine",
        "designing a binary sequence",
        "looking for the devices that go farthest",
    ]
    assert {each.family for each in plan.candidates} == {"multisine", "swept-sine", "binary"}
    products = [each.prediction.mass * each.prediction.damping for each in plan.candidates]
    assert products == sorted(products)
    assert (plan.mass, plan.damping) == (plan.best.prediction.mass, plan.best.prediction.damping)


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
