"""Estimators on exact logs, their speed, and covariances under colour and with instruments."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from identification import Trajectory
from identification.estimators import ESTIMATORS
from identification.estimators.estimate import Model, spread
from tests.estimates import estimate_by
from tests.exact_axis import Axis, counted, multisine, positions
from tests.thinned import thinned

Array = NDArray[np.float64]
STEP = 1e-3


def log(force: Array, position: Array) -> Trajectory:
    time: Array = np.arange(force.size) * np.float64(STEP)
    return Trajectory(time=time, force=force, position=position)


def excited(axis: Axis, samples: int) -> Array:
    plain = Axis(mass=axis.mass, damping=axis.damping)
    return multisine(np.random.default_rng(0), samples=samples, runs=1, axis=plain)


@cache
def noise_free(damping: float, delay: float, *, uneven: bool) -> Trajectory:
    """3 kg under a force less 0.4 N, from one change of the force or stamp to the next."""
    force = excited(Axis(damping=damping), samples=3000)[:, 0]
    steps = np.full(force.size - 1, STEP)
    if uneven:
        steps *= np.random.default_rng(1).choice([0.7, 1.0, 1.1, 1.4], steps.size)
    time = np.concatenate(([0.0], np.cumsum(steps)))
    events = np.unique(np.concatenate((time, time[1:] + delay)))
    spans = np.diff(events)
    acting = np.searchsorted(time + delay, events[:-1] + spans / 2, side="right") - 1
    push = (force[np.maximum(acting, 0)] - 0.4) / 3.0
    rate, place, speed, places = damping / 3.0, 0.0, 0.0, [0.0]
    for span, gain in zip(spans.tolist(), push.tolist(), strict=True):
        area = -np.expm1(-rate * span) / rate if rate else span
        ramp = (span - area) / rate if rate else span**2 / 2
        place, speed = place + area * speed + gain * ramp, speed + area * (gain - rate * speed)
        places.append(place)
    position = np.array(places)[np.searchsorted(events, time)]
    return Trajectory(time=time, force=force, position=position)


@pytest.mark.parametrize("method", ESTIMATORS)
@pytest.mark.parametrize("damping", thinned([2.0, 0.0, 300.0], 1))
@pytest.mark.parametrize("delay", [0.0, 0.4 * STEP, STEP, 3.4 * STEP])
@pytest.mark.parametrize("uneven", [False, True])
def test_noise_free_logs_give_the_truth(
    method: str, damping: float, delay: float, uneven: bool
) -> None:
    found = estimate_by(
        method, noise_free(damping, delay, uneven=uneven), Model(coulomb=False), delay
    )
    # Rows of the others differentiate the positions numerically.
    exact = 1e-10 if method in {"output-error", "innovations"} else 1e-5
    assert found.value("mass") == pytest.approx(3.0, rel=exact)
    assert found.value("damping") == pytest.approx(damping, rel=exact, abs=3.0 * exact)
    assert found.value("force_offset") == pytest.approx(0.4, abs=exact)
    assert found.value("coulomb_friction") == found.deviation("coulomb_friction") == 0.0
    assert found.explained == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("coulomb", thinned([3.0, 0.8], 1))
def test_friction_with_stick_and_slip(coulomb: float) -> None:
    """Standing a tenth of the time at 3 N of 14 N: the turning points still come out."""
    axis = Axis(coulomb=coulomb, offset=-0.3, delay=STEP)
    force = excited(axis, samples=12000)
    place = counted(positions(axis, force), 6e-6)[:, 0]
    found = estimate_by("least-squares", log(force[:, 0], place), Model(), STEP)
    assert found.value("mass") == pytest.approx(3.0, rel=2e-3)
    assert found.value("damping") == pytest.approx(10.0, rel=1e-2)
    assert found.value("coulomb_friction") == pytest.approx(coulomb, rel=5e-3)
    assert found.value("force_offset") == pytest.approx(-0.3, abs=5e-3)


def test_the_covariance_survives_colour() -> None:
    """Mean of a coloured series: variance (1+a)/(1-a)/n, forty times the ordinary one."""
    runs, samples, memory = 200, 6000, 0.95
    generator = np.random.default_rng(11)
    series = np.asarray(lfilter([1], [1, -memory], generator.standard_normal((runs, samples))))
    ones, silent = np.ones((1, samples)), np.zeros(samples)
    variances = [
        spread(ones, row - row.mean(), 1, signal=silent).covariance[0, 0] for row in series
    ]
    assert np.sqrt(np.mean(variances)) == pytest.approx(series.mean(axis=1).std(), rel=0.2)


def test_with_instruments_the_covariance_is_without_bias() -> None:
    """One block of thirty tells most of the second column: leaving it out is twice too wide."""
    told, rows = np.array([2.0, -0.1]), 1200
    loud = np.where(np.arange(rows) < rows // 30, 200.0, 5.0)
    errors, variances = np.empty((2, 300, 2))
    for seed in range(300):
        generator = np.random.default_rng([5, seed])
        tests = generator.standard_normal((2, rows)) * np.stack((np.ones(rows), loud))
        columns = tests + 0.3 * generator.standard_normal((2, rows))
        target = told @ columns + generator.standard_normal(rows)
        values = np.linalg.solve(tests @ columns.T, tests @ target)
        residual = target - values @ columns
        found = spread(columns, residual, 2, signal=np.zeros(rows), instruments=tests)
        errors[seed], variances[seed] = values - told, np.diag(found.covariance)
    # 300 squares know their mean to 8 %.
    np.testing.assert_allclose(np.mean(np.square(errors), 0), np.mean(variances, 0), rtol=0.25)
