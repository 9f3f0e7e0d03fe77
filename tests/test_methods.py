"""Every method on independent simulations, under changes of unit, clock, sign and origin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from datasets_synthetic import Clock, Faults, Rig, fit_to_limits, multisine, simulate
from identification import Trajectory
from identification.estimators import ESTIMATORS
from identification.estimators.estimate import Estimate, Model
from tests.estimates import estimate_by
from tests.simulated.families import family_named
from tests.thinned import thinned

COUNT = 2e-5
STEP = 1e-3
RIG = Rig(
    mass=3.0,
    damping=10.0,
    force_offset=0.3,
    sample_time=STEP,
    delay=0.4 * STEP,
    encoder_resolution=COUNT,
    force_limit=28.0,
    name="tested",
)
CLOCKS = {
    "even": Clock(),
    "jittered": Clock(jitter=0.1e-3),
}
SEEDS = (1, 2, 3)
#: Sigmas of a method's own that a value may be off: with Student's t of 8 to 60 blocks, chance
#: alone exceeds them in one of a thousand.
SIGMAS = 5.0


@lru_cache(maxsize=32)
def logs(clock: str, delay: float, coulomb: float = 0.0) -> tuple[Trajectory, ...]:
    """Open-loop logs of 3 s with noise of one count."""
    rig = replace(RIG, delay=delay, coulomb_friction=coulomb)
    played = fit_to_limits(rig, multisine(rig, 3000), travel=0.02, force=rig.force_limit)
    recording = simulate(
        rig,
        played.force,
        faults=Faults(position_noise=COUNT),
        clock=CLOCKS[clock],
        seed=SEEDS,
        position=played.start,
    )
    return tuple(recording.trajectory(member) for member in range(recording.batch))


def check(found: Sequence[Estimate], truth: dict[str, float], part: float) -> None:
    """Every value within SIGMAS of its own, and within ``part`` of the truth (of 1 at least)."""
    for each in found:
        for name, value in truth.items():
            off = abs(each.value(name) - value)
            assert off < SIGMAS * each.deviation(name), f"{name} {each.value(name)}"
            assert off < part * max(abs(value), 1.0), f"{name} {each.value(name)}"


@pytest.mark.parametrize("method", ESTIMATORS)
@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("delay", thinned([0.4 * STEP, 2.3 * STEP], 1))
def test_known_devices_are_recovered(method: str, clock: str, delay: float) -> None:
    found = [estimate_by(method, log, Model(coulomb=False), delay) for log in logs(clock, delay)]
    check(found, {"mass": 3.0, "damping": 10.0, "force_offset": 0.3}, 0.02)


@pytest.mark.parametrize("method", ESTIMATORS)
@pytest.mark.parametrize("clock", thinned(["jittered", "even"], 1))
def test_friction_is_recovered(method: str, clock: str) -> None:
    found = [estimate_by(method, log, Model(), STEP) for log in logs(clock, STEP, coulomb=0.8)]
    truth = {"mass": 3.0, "damping": 10.0, "coulomb_friction": 0.8, "force_offset": 0.3}
    check(found, truth, 0.06)


@pytest.mark.parametrize("method", ["instruments", "output-error", "innovations"])
def test_a_delay_nobody_states_is_fitted(method: str) -> None:
    for log in logs("even", 2.3 * STEP):
        found = estimate_by(method, log, Model(coulomb=False), None)
        assert found.delay_deviation is not None
        assert abs(found.delay - 2.3 * STEP) < SIGMAS * found.delay_deviation
        assert found.delay_deviation < 0.2 * STEP
        check([found], {"mass": 3.0, "damping": 10.0}, 0.02)


@pytest.mark.parametrize("method", thinned(ESTIMATORS, 2))
def test_gravity_is_recovered(method: str) -> None:
    family = family_named("offset-gravity")
    found = [
        estimate_by(method, log, Model(coulomb=False, gravity="pendulum"), family.truth["delay"])
        for log in family.logs(SEEDS)
    ]
    names = ("mass", "damping", "force_offset", "gravity_sine", "gravity_cosine")
    check(found, {name: family.truth[name] for name in names}, 0.01)


@pytest.mark.parametrize("method", thinned(reversed(ESTIMATORS), 1))
def test_friction_by_direction_is_recovered(method: str) -> None:
    family = family_named("directional-friction")
    for log in family.logs(SEEDS):
        found = estimate_by(method, log, Model(directional=True), family.truth["delay"])
        truth = {name: family.truth[name] for name in ("mass", "damping", "coulomb_friction")}
        check([found], truth | {"damping_asymmetry": family.truth["damping_asymmetry"]}, 0.1)
        # Coulomb friction by direction is Fc ± (f0 - a·s).
        sides = found.combined(force_offset=1.0, damping_asymmetry=-found.mean_speed)
        asymmetry = family.truth["coulomb_asymmetry"] + family.truth["force_offset"]
        assert abs(sides[0] - asymmetry) < SIGMAS * sides[1]


CHANGES: dict[str, dict[str, float]] = {
    "time": {"time": 3.7},
    "force unit": {"force": 1e-3},
    "position unit": {"position": 57.3},
    "sign": {"force": -1.0, "position": -1.0},
    "origin": {"shift": 12.5},
    "start of the clock": {"start": 1e4},
}


@pytest.mark.parametrize("method", ESTIMATORS)
@pytest.mark.parametrize("clock", thinned(["jittered", "even"], 1))
@pytest.mark.parametrize("change", CHANGES)
def test_units_clock_sign_and_origin_do_not_matter(method: str, clock: str, change: str) -> None:
    log = logs(clock, 0.4 * STEP)[0]
    time, force, position = (CHANGES[change].get(key, 1.0) for key in ("time", "force", "position"))
    moved = Trajectory(
        time=log.time * time + CHANGES[change].get("start", 0.0),
        force=log.force * force,
        position=log.position * position + CHANGES[change].get("shift", 0.0),
    )
    model = Model(coulomb=False)
    plain = estimate_by(method, log, model, 0.4 * STEP)
    other = estimate_by(method, moved, model, 0.4 * STEP * time)
    scale = np.array([force / position * time**2, force / position * time, force])
    # Stamps and positions lose digits where a number is added; the searches end within a hundredth
    # of a deviation either way.
    off = np.abs(other.values / scale - plain.values)
    assert np.all(off < 0.02 * np.sqrt(np.diag(plain.covariance)))
    deviations = np.sqrt(np.diag(other.covariance)) / np.abs(scale)
    np.testing.assert_allclose(deviations, np.sqrt(np.diag(plain.covariance)), rtol=0.02)


def test_a_reference_frees_from_noise_that_the_force_carries() -> None:
    """In closed loop unlogged force biases least squares; instruments from the reference do not."""
    family = family_named("closed-loop-force-noise")
    family = replace(family, faults=replace(family.faults, force_noise=3.0))
    model, truth = Model(coulomb=False), family.truth
    found: dict[str, list[float]] = {"least-squares": [], "instruments": []}
    for log in family.logs(range(40)):
        for method, masses in found.items():
            estimate = estimate_by(method, log, model, truth["delay"])
            masses.append(estimate.value("mass") / truth["mass"] - 1)
            if method == "instruments":
                assert estimate.notes[0] == "instruments from the logged reference"
    error = np.std(found["instruments"]) / np.sqrt(40)
    assert np.mean(found["least-squares"]) < -3 * error
    assert abs(np.mean(found["instruments"])) < 2 * error


def test_without_a_moving_reference_instruments_are_simulated() -> None:
    log = logs("even", 0.4 * STEP)[0]
    for reference in (None, np.full(len(log), 0.1)):
        found = estimate_by(
            "instruments", replace(log, reference=reference), Model(coulomb=False), 0.4 * STEP
        )
        assert "simulated" in found.notes[0]
        assert "open loop" in found.notes[0]
