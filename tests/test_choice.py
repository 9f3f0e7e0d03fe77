"""Which estimate is believed: Hausman's test, regions, instruments, and the judge of the mass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identification import Hardware, Trajectory, quantity
from identification.estimators.estimate import Estimate
from identification.findings.excitation import contradicting_delays
from identification.findings.force_balance import balance_of
from identification.findings.forces import cut_off_sensitivity, inertia, inertia_of
from identification.fitting import distinguishable_terms, fit_log
from identification.fitting.choice import (
    CONTRADICTED,
    PreparedLog,
    choose,
    contradiction,
    noise_explains,
    region,
    statistic,
)
from tests.bare_servo import INERTIA, path, servo_log
from tests.simulated.families import FAMILIES

LATE = quantity(1e-3)


@cache
def noisy_motor(*, seed: int = 7, told: bool = False) -> Trajectory:
    """Friction that saturates with speed, and readings so noisy that innovations lose sight."""
    return servo_log(
        path(8.0, 0.54, seed),
        coulomb=3.7e-3,
        viscous=6e-5,
        bent=3e-3,
        over=15.0,
        saturating=True,
        stiffness=6.3e-3,
        noise=2.7e-3,
        push=4e-4,
        told=told,
    )


@cache
def quick_motor() -> Trajectory:
    """Stribeck friction, and inertia that is most of the torque."""
    return servo_log(
        path(8.0, 1.5, 3),
        coulomb=2e-3,
        viscous=3e-5,
        bent=1e-3,
        over=3.0,
        saturating=False,
        stiffness=0.05,
        noise=1e-4,
    )


def estimate(mass: float, damping: float, doubt: float, damping_doubt: float) -> Estimate:
    """An estimate without friction, deviations as parts of the values."""
    return Estimate(
        method="least-squares",
        model=replace(distinguishable_terms(quick_motor()), coulomb=False, offset=False),
        delay=0.0,
        values=np.array([mass, damping]),
        covariance=np.diag([(doubt * mass) ** 2, (damping_doubt * damping) ** 2]),
        degrees_of_freedom=59.0,
        residual=np.zeros(100),
        residual_unit="force",
        explained=1.0,
        condition=1.0,
        inflation=np.ones(2),
    )


@pytest.mark.parametrize("seed", [7, 17])
def test_an_answer_far_less_certain_does_not_win(seed: int) -> None:
    """The larger deviation of the two would let innovations of 35 % win over 5 %."""
    log = noisy_motor(seed=seed)
    prepared = PreparedLog.of(log, distinguishable_terms(log), LATE)
    regression, predicted = prepared.fit("least-squares"), prepared.fit("innovations")
    widest = [max(regression.deviation(n), predicted.deviation(n)) for n in ("mass", "damping")]
    assert np.all(np.abs(predicted.values[:2] - regression.values[:2]) < 3 * np.array(widest))
    assert region(predicted) > 20 * region(regression)
    chosen, reason = choose(prepared, "auto", noise_explains(prepared))
    assert chosen.method == "least-squares"
    assert "less well" in reason
    assert chosen.value("mass") == pytest.approx(INERTIA, rel=0.1)
    assert predicted.value("mass") > 1.5 * INERTIA


def test_a_wide_answer_does_not_confirm_a_narrow_wrong_one() -> None:
    """Least squares of 17 % agree with 1.4 times the inertia; rows at equal velocity do not."""
    log = quick_motor()
    prepared = PreparedLog.of(log, distinguishable_terms(log), LATE)
    right, wrong = 1.0 * INERTIA, 1.4 * INERTIA
    shaped = prepared.fit("least-squares"), prepared.fit("innovations")
    for method, found, mass, doubt in zip(
        ("least-squares", "innovations"), shaped, (1.1 * right, wrong), (0.17, 0.02), strict=True
    ):
        values = found.values.copy()
        values[0] = mass
        scale = np.diag(np.sqrt(np.diag(found.covariance)))
        scale[0, 0] = doubt * mass
        prepared.made[method] = replace(found, values=values, covariance=scale @ scale)
    assert not contradiction(prepared.made["innovations"], prepared.made["least-squares"])
    prepared.made["output-error"] = replace(
        prepared.made["innovations"],
        method="output-error",
        residual=np.cumsum(np.random.default_rng(0).normal(size=4000)),
    )
    chosen, reason = choose(prepared, "auto", noise_explains(prepared))
    assert chosen.method == "least-squares"
    assert "equal velocity" in reason


@pytest.mark.parametrize("log", [quick_motor, noisy_motor])
def test_rows_at_equal_velocity_hold_the_inertia_whatever_the_friction(
    log: Callable[[], Trajectory],
) -> None:
    trajectory = log()
    balance = balance_of(trajectory, replace(estimate(INERTIA, 1e-4, 0.1, 0.1), delay=1e-3))
    judge = inertia_of(balance)
    if judge is None:  # too noisy to judge, and it says so
        assert log is noisy_motor
        return
    assert judge.least - 4 * judge.deviation <= INERTIA <= judge.most + 4 * judge.deviation
    assert judge.deviation < 0.05 * INERTIA
    heavy = replace(estimate(1.5 * INERTIA, 1e-4, 0.02, 0.1), delay=1e-3)
    found = tuple(inertia(trajectory, balance, heavy))
    assert [each.code for each in found] == ["heldout-misfit"]
    assert found[0].severity == "refusal"
    light = replace(heavy, values=np.array([INERTIA, 1e-4]))
    assert not tuple(inertia(trajectory, balance, light))


@pytest.mark.parametrize("name", ["encoder-only", "closed-loop-force-noise", "coulomb"])
def test_rows_at_equal_velocity_hold_the_mass_of_the_families(name: str) -> None:
    family = FAMILIES[name]
    fit = fit_log(family.logs([4])[0], family.hardware, "auto")
    judge = inertia_of(balance_of(fit.trajectory, fit.estimate))
    assert judge is not None
    assert judge.least == pytest.approx(family.truth["mass"], rel=0.02)
    assert judge.most == pytest.approx(family.truth["mass"], rel=0.02)


def test_instruments_are_asked_wherever_a_reference_is_logged() -> None:
    hardware = Hardware(motion="rotary", delay=LATE)
    for told in (False, True):
        fit = fit_log(noisy_motor(told=told), hardware, "auto")
        asked = {each.method for each in (fit.estimate, *fit.others)}
        assert ("instruments" in asked) == told
    family = FAMILIES["closed-loop-measurement-noise"]
    fit = fit_log(family.logs([0])[0], None, "auto")
    assert fit.method == "output-error"
    assert "instruments" in {each.method for each in fit.others}


def test_the_variance_of_the_difference_is_the_difference_of_variances() -> None:
    """Sample means of all and of some of a normal sample, the textbook case."""
    generator = np.random.default_rng(2)
    sums: list[float] = []
    for _ in range(4000):
        sample = generator.normal(5.0, 1.0, (100, 2))
        whole = replace(estimate(5.0, 5.0, 0.02, 0.02), values=sample.mean(axis=0))
        some = replace(
            estimate(5.0, 5.0, 0.2 / np.sqrt(30), 0.2 / np.sqrt(30)),
            values=sample[:30].mean(axis=0),
        )
        sums.append(statistic(whole, some))
    # χ² of two degrees: mean 2, and 5 % above 5.99; 4000 draws know them to 0.03 and 0.4 %.
    assert np.mean(sums) == pytest.approx(2.0, abs=0.13)
    assert np.mean(np.array(sums) > 5.991) == pytest.approx(0.05, abs=0.014)


def test_what_is_as_sharp_contradicts_sooner_than_what_is_wide() -> None:
    robust = estimate(1.0, 1.0, 0.1, 0.1)
    sharp, dull = (estimate(1.25, 1.0, each, each) for each in (0.05, 0.12))
    assert statistic(sharp, robust) > 0.25**2 / 0.1**2
    assert statistic(dull, robust) < 0.25**2 / 0.1**2
    # Nothing is known of what a dull one shares: even the largest variance may be exceeded.
    assert contradiction(estimate(4.0, 1.0, 0.12, 0.12), robust)
    assert not contradiction(robust, robust)


@settings(max_examples=30, deadline=None)
@given(
    mass=st.floats(-3, 3), damping=st.floats(-3, 3), tilt=st.floats(-0.9, 0.9), off=st.floats(0, 1)
)
def test_units_do_not_matter_to_the_test(
    mass: float, damping: float, tilt: float, off: float
) -> None:
    robust = estimate(1.0, 1.0, 0.1, 0.2)
    tilted = np.array([[0.01, tilt * 0.02], [tilt * 0.02, 0.04]])
    robust = replace(robust, covariance=tilted)
    other = estimate(1.0 + off, 1.0 - off, 0.04, 0.3)
    units = np.array([10.0**mass, 10.0**damping])
    scaled = [
        replace(
            each, values=each.values * units, covariance=each.covariance * np.outer(units, units)
        )
        for each in (other, robust)
    ]
    assert statistic(*scaled) == pytest.approx(statistic(other, robust), rel=1e-6, abs=1e-9)
    assert pytest.approx(-2 * np.log(0.0027), abs=5e-3) == CONTRADICTED


def test_delays_that_exclude_each_other_are_a_finding() -> None:
    log = quick_motor()
    first = replace(estimate(1.0, 1.0, 0.1, 0.1), delay=1e-3, delay_deviation=5e-5)
    other = replace(first, method="instruments", delay=1.6e-3)
    found = tuple(contradicting_delays(log, first, [other]))
    assert [(each.code, each.severity) for each in found] == [("delay-unknown", "warning")]
    assert "1.00" in found[0].seen
    assert "1.60" in found[0].seen
    # Not known well enough, not far enough, not fitted.
    assert not tuple(contradicting_delays(log, first, [replace(other, delay_deviation=2e-4)]))
    near = replace(first, delay=1.2e-3, delay_deviation=1e-6)
    assert not tuple(contradicting_delays(log, replace(first, delay_deviation=1e-6), [near]))
    assert not tuple(contradicting_delays(log, first, [replace(other, delay_deviation=None)]))


def test_a_move_with_the_cut_off_beyond_the_interval_is_a_finding() -> None:
    log = quick_motor()
    alone = estimate(1.0, 1.0, 0.01, 0.05)
    for move, expected in ((0.05, ["heldout-misfit"]), (0.01, [])):
        leaning = np.array([move, 0.01])
        covariance = alone.covariance + np.outer(leaning, leaning)
        leant = replace(alone, leaning=leaning, covariance=covariance)
        found = tuple(cut_off_sensitivity(log, leant))
        assert [each.code for each in found] == expected
    assert not tuple(cut_off_sensitivity(log, alone))
