"""Planned forces: limits kept by simulated devices, intervals against sweeps and estimates."""

from __future__ import annotations

import numpy as np
import pytest

from datasets_synthetic import Faults, simulate
from identification import (
    ExcitationSpec,
    plan_excitation,
)
from identification.estimators.estimate import Model
from identification.planning.information import NORMAL_95, predict
from identification.planning.limits import Guess
from tests.estimates import estimate_by
from tests.excitation_plans import (
    LIMITS,
    RANGES,
    STEP,
    Array,
    planned,
    rig_of,
    spec,
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


def sweeps(plan: ExcitationSpec) -> Array:
    """Ten swept sines, each from two phases, at the same limits and with the same ramps."""
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
