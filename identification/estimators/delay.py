"""The delay from command to force, if nobody states it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.drive import MOST_SAMPLES
from identification.estimators.intervals import spread
from identification.estimators.linear import unit_columns
from identification.estimators.regression import Regression, prepare
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Steps of the scan per sample time, ...
_STEPS_PER_SAMPLE = 2
#: ... and the finer steps about the best, samples, each with a parabola through the best three.
_FINER = (0.25, 0.05, 0.01)
#: Standard deviation of a delay nothing is known about but that it lies within the scan.
_IGNORANCE = MOST_SAMPLES / np.sqrt(12)
#: Scans: the direction of motion is refined at the delay of the scan before.
_ROUNDS = 2
#: Samples of the rough scan, from the middle of the log.
_ROUGH = 1 << 13


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """A delay read from a log.

    Attributes:
        value: s.
        deviation: standard deviation, s.
        residuals: root mean square of the filtered residual at 0, 1, ... whole samples, N.
    """

    value: float
    deviation: float
    residuals: tuple[float, ...]


def find_delay(trajectory: Trajectory, table: Regression) -> Delay:
    """The delay, 0 to MOST_SAMPLES samples, at which least squares leaves the smallest residual.

    Delaying a force and adding damping look alike in a log of a single frequency; then the
    deviation is large, and so becomes the interval of the damping (prepared.py).

    Args:
        trajectory: the log.
        table: its regression, with as many known intervals as the longest delay needs.
    """
    step = table.signals.step
    grid = np.arange(MOST_SAMPLES * _STEPS_PER_SAMPLE + 1) / _STEPS_PER_SAMPLE
    # The rough scan needs no more than a part of a long log.
    first = max(0, (len(trajectory) - _ROUGH) // 2)
    part = table
    if len(trajectory) > _ROUGH:
        middle = trajectory.part(slice(first, first + _ROUGH))
        most = MOST_SAMPLES * middle.sample_time
        part = prepare(middle, table.model, most, refine=False)
    costs, best = np.empty(0), 0.0
    for _ in range(_ROUNDS):
        costs = _costs(part, _basis(part), grid)
        best = _lowest(grid, costs)
        before, part = part, part.refined(best * step)
        if part is before:
            break
    if len(trajectory) <= _ROUGH:
        table = part
    basis = np.empty(0)
    for finer in _FINER:
        before, table = table, table.refined(best * step)
        if table is not before or not basis.size:
            basis = _basis(table)
        near = np.clip(best + finer * np.array([-1.0, 0.0, 1.0]), 0.0, MOST_SAMPLES)
        best = _lowest(near, _costs(table, basis, near))
    force = table.force(best * step)
    residual = force - table.solve(best * step) @ table.columns
    # F(t - d) changes with d by its slope; beside the other columns that tells how well d is known.
    low, high = max(best - 0.5, 0.0), min(best + 0.5, float(MOST_SAMPLES))
    slope = (table.force(high * step) - table.force(low * step)) / ((high - low) * step)
    around = spread(np.vstack((-slope, table.columns)), residual, 1, signal=force)
    variance = max(float(around.covariance[0, 0]), 0.0)
    deviation = min(float(np.sqrt(variance)), float(_IGNORANCE) * step)
    whole = costs[::_STEPS_PER_SAMPLE]
    return Delay(
        value=best * step,
        deviation=deviation,
        residuals=tuple(float(np.sqrt(max(cost, 0.0) / force.size)) for cost in whole),
    )


def _basis(table: Regression) -> FloatArray:
    """Orthonormal columns that span those of the regression, shape (rows, p)."""
    return np.linalg.qr(unit_columns(table.columns.T)[0])[0]


def _costs(table: Regression, basis: FloatArray, samples: FloatArray) -> FloatArray:
    """Sum of squared residuals of the best fit at each delay, in samples."""
    step = table.signals.step
    forces = table.forces([float(each) * step for each in samples])
    return np.sum((forces - forces @ basis @ basis.T) ** 2, axis=1)


def _lowest(grid: FloatArray, costs: FloatArray) -> float:
    """The minimum of a parabola through the lowest cost and its neighbours."""
    index = int(np.argmin(costs))
    if index in {0, grid.size - 1} or grid[index - 1] == grid[index + 1]:
        return float(grid[index])
    left, middle, right = costs[index - 1 : index + 2]
    bend = left - 2 * middle + right
    shift = (left - right) / (2 * bend) if bend > 0 else 0.0
    return float(grid[index] + np.clip(shift, -1, 1) * (grid[index + 1] - grid[index]))
