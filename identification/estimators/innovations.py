"""Prediction-error method: innovations form with position noise and unlogged forces.

An ARMAX model whose A is the device (the steady Kalman filter: Ljung, System Identification, 1999,
section 4.3; docs/theory.md, 7). Without unlogged force it is output error, with nothing else least
squares; it is consistent in closed loop.
"""

from __future__ import annotations

from cmath import exp, sqrt
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from identification.estimators.estimate import (
    UNSETTLED,
    Estimate,
    PointEstimate,
    Solution,
    physical,
    solve,
    solve_separable,
    spread,
)
from identification.estimators.filters import causal, is_coloured, recursive, whitener
from identification.estimators.least_squares import (
    CUT_OFF_RANGE,
    REFINEMENTS,
    Drive,
    Regression,
    complete_estimate,
)
from identification.estimators.signals import HeldResponse
from identification.trajectory import FloatArray

#: Ratios of unlogged force to position noise tried as starts, as the corner frequency above which
#: position noise rules, in parts of the sampling rate.
_CORNERS = (0.3, 0.1, 0.03, 0.01, 0.003)
#: Rows, the first of a log, that tell the best of them.
_BEGUN = 1 << 13
#: Places of the moving average in θ.
_NOISE = (1, 2)
#: Coefficients stay this far inside of what has a stable inverse.
_INSIDE = 1e-6
#: Times the filter for what is left coloured is made anew.
_ROUNDS = 3
#: The direction of motion has settled when one more step turns less than this of all intervals
#: together. Innovations see each reversal, which least squares has filtered: where its friction
#: has settled an interval is still to turn, and mass and damping move by a quarter of the
#: half-width with the last digits of the log; here by less than a thousandth.
_SETTLED = 1e-2


@dataclass(frozen=True, slots=True, kw_only=True)
class _Problem:
    """Innovations of one log as a separable model in θ = (p, C(1), C(-1)), or with the delay.

    C(z) = 1 + c1/z + c2/z²: in its values at z = ±1 two sides of Jury's triangle are bounds.
    """

    drive: Drive  # inputs
    moved: FloatArray  # the measured motion as a gain: distances alone, shape (2, n - 1)
    known: int  # first row that feels only logged forces
    shape: FloatArray  # taps of a filter that whitens what C leaves coloured, leading 1

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        most = 4 * (1 - _INSIDE)
        return self.drive.bounds((0.0, most), (0.0, most))

    def allowed(self, theta: FloatArray) -> bool:
        """The moving average has a stable inverse: the third side of Jury's triangle."""
        return bool(_coefficients(theta)[1] < 1 - _INSIDE)

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        columns, target = self.rows(theta)
        return self.whitened(columns, theta), self.whitened(target, theta)

    def rows(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and target before the noise model, which do not depend on c1 and c2."""
        device = HeldResponse.at(float(theta[0]), self.drive.steps)
        inputs = self.drive.inputs(self.drive.delay_of(theta))
        columns = np.zeros((len(inputs) + 2, self.moved.shape[1] - 1 - self.known))
        for index, held in enumerate(inputs):
            columns[index] = self._scaled(device, _row(device, device.gain(held)))
        columns[-2, 0] = columns[-1, 1] = 1.0
        return columns, self._scaled(device, _row(device, self.moved))

    def slopes(self, theta: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
        device = HeldResponse.at(float(theta[0]), self.drive.steps)
        misfit = -_row(device, self.moved)
        slope = -_row_slope(device, self.moved, np.zeros_like(self.moved))
        inputs = self.drive.inputs(self.drive.delay_of(theta))
        for weight, held in zip(weights, inputs, strict=False):
            gain = device.gain(held)
            misfit += weight * _row(device, gain)
            slope += weight * _row_slope(device, gain, device.slope_by_rate(held))
        scale_slope = np.mean(device.full.speed_slope)
        by_rate = self._scaled(device, slope) + scale_slope * misfit[self.known :]
        # The innovations change with c1 and c2 by minus their own past through 1/C.
        past = self._averaged(residual, theta)
        first, second = np.zeros((2, past.size))
        first[1:], second[2:] = past[:-1], past[:-2]
        slopes = [self.whitened(by_rate, theta), (second + first) / 2, (second - first) / 2]
        if self.drive.delay is None:
            later = _row(device, self.drive.slope_by_delay(device, self.drive.delay_of(theta)))
            slopes.append(self.whitened(weights[0] * self._scaled(device, later), theta))
        return np.stack(slopes)

    def _scaled(self, device: HeldResponse, rows: FloatArray) -> FloatArray:
        """Rows of speed as rows of position: the weight of the newest reading does not lean on p.

        Otherwise a p that makes the rows smaller would seem to explain them better.
        """
        return float(np.mean(device.full.speed)) * rows[self.known :]

    def _averaged(self, rows: FloatArray, theta: FloatArray) -> FloatArray:
        """Rows through 1/C."""
        return recursive(rows, *_coefficients(theta))

    def whitened(self, rows: FloatArray, theta: FloatArray) -> FloatArray:
        """Rows through 1/C and the shape."""
        averaged = self._averaged(rows, theta)
        return averaged if self.shape.size == 1 else causal(averaged, self.shape)


def _coefficients(theta: FloatArray) -> tuple[float, float]:
    """c1 and c2 of the moving average."""
    ahead, back = float(theta[1]), float(theta[2])
    return (ahead - back) / 2, (ahead + back) / 2 - 1


def _earlier(of_intervals: FloatArray) -> FloatArray:
    """Value of the interval before each inner sample."""
    return of_intervals if of_intervals.ndim == 0 else of_intervals[:-1]


def _difference(column: FloatArray, decay: FloatArray) -> FloatArray:
    """Each interval less what the decay leaves of the one before."""
    return column[1:] - _earlier(decay) * column[:-1]


def _row(device: HeldResponse, gain: FloatArray) -> FloatArray:
    """What a column adds to the difference of speeds at inner samples, shape (n - 2,)."""
    return gain[0, :-1] + _difference(gain[1] / device.full.speed, device.full.decay)


def _row_slope(device: HeldResponse, gain: FloatArray, slope: FloatArray) -> FloatArray:
    """Derivative of a row by p."""
    full = device.full
    share = gain[1] / full.speed
    changed = slope[1] / full.speed - share * full.speed_slope / full.speed
    bent = _difference(changed, full.decay) - _earlier(full.decay_slope) * share[:-1]
    return slope[0, :-1] + bent


def point(table: Regression, delay: float, *, fits_delay: bool = False) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    table = _settled(table, delay)
    return _point(table, *_found(table, delay, fits_delay=fits_delay))


def fit(table: Regression, delay: float, *, fits_delay: bool = False) -> Estimate:
    """Mass, damping and friction by a Kalman innovations fit; the innovations are in m."""
    table = _settled(table, delay)
    problem, best = _found(table, delay, fits_delay=fits_delay)
    values, jacobian = physical(best, len(table.model.parameters))
    size = len(values)
    if fits_delay:  # the delay right after the parameters, before the noise model
        order = [*range(size), size + 2, size, size + 1, *range(size + 3, len(jacobian))]
        jacobian = jacobian[order]
    around = spread(jacobian, best.residual, size + fits_delay, signal=values[0] * jacobian[0])
    first, second = _coefficients(best.theta)
    notes = [
        f"moving average 1 {first:+.4f} {second:+.4f} "
        + ("" if problem.shape.size == 1 else "then whitened by the spectrum of the rest")
    ]
    notes += [] if best.converged else [UNSETTLED]
    return complete_estimate(
        "innovations",
        table,
        _point(table, problem, best),
        around,
        fitted=fits_delay,
        unit="position",
        notes=notes,
        choice_shift=_choice_shift(table, problem, best, delay),
    )


def _point(table: Regression, problem: _Problem, best: Solution) -> PointEstimate:
    return PointEstimate(
        values=physical(best, len(table.model.parameters))[0],
        delay=problem.drive.delay_of(best.theta),
        signal=best.target,
        residual=best.residual,
    )


def _found(table: Regression, delay: float, *, fits_delay: bool) -> tuple[_Problem, Solution]:
    """The best prediction, and the problem with the filter that it has for coloured forces."""
    distances = np.diff(table.signals.position - np.mean(table.signals.position))
    problem = _Problem(
        drive=Drive.of(table, None if fits_delay else delay),
        moved=np.stack((np.zeros_like(distances), distances)),
        known=table.known,
        shape=np.ones(1),
    )
    best = solve_separable(problem, _start(problem, table, delay), _NOISE)
    for _ in range(_ROUNDS):
        if not is_coloured(best.residual, either_side=True):
            break
        rows, target = replace(problem, shape=np.ones(1)).at(best.theta)
        problem = replace(problem, shape=whitener(target - best.weights @ rows))
        best = solve_separable(problem, best.theta, _NOISE)
    return problem, best


def _settled(table: Regression, delay: float) -> Regression:
    """With the direction of motion where refining it ends, wherever it began.

    Where noise moves turns by more than refining does, steps do not become shorter: there is no
    such place, and the first will do.
    """
    shortest = np.inf
    for _ in range(REFINEMENTS):
        before = table.motion.direction.mean()
        table = table.refined(delay)
        turned = float(np.sum(np.abs(table.motion.direction.mean() - before)))
        if turned <= _SETTLED or turned >= shortest:
            break
        shortest = turned
    return table


def _choice_shift(table: Regression, problem: _Problem, best: Solution, delay: float) -> FloatArray:
    """Half of what another filter for the direction of motion changes, one more deviation.

    Where a noisy position turns is in doubt by part of a sample, which blocks of one log share.
    """
    model = table.model
    if not model.coulomb:
        return np.zeros(len(model.parameters))
    wider = table.at_cut_off(CUT_OFF_RANGE * table.cut_off.frequency).refined(delay)
    other = replace(problem, drive=Drive.of(table.with_motion(wider.motion), problem.drive.delay))
    values, _ = physical(solve_separable(other, best.theta, _NOISE), len(model.parameters))
    return (values - physical(best, len(model.parameters))[0]) / 2


def _start(problem: _Problem, table: Regression, delay: float) -> FloatArray:
    """The best moving average of a few, at the p of least squares and one delay."""
    trials: list[tuple[float, FloatArray]] = []
    values = table.solve(delay)
    rate = problem.drive.rate_of(values)
    averages = [*map(_moving_average, _CORNERS), *_under_gravity(table, values, rate)]
    least = np.array([rate, 0.0, 0.0, delay])[: 4 if problem.drive.delay is None else 3]
    rows = [each[..., :_BEGUN] for each in problem.rows(least)]
    for average in averages:
        theta = least.copy()
        theta[1:3] = 1 + average[0] + average[1], 1 - average[0] + average[1]
        columns, target = (problem.whitened(each, theta) for each in rows)
        residual = target - solve(columns.T, target) @ columns
        trials.append((float(residual @ residual), theta))
    return min(trials, key=lambda trial: trial[0])[1]


def _moving_average(corner: float) -> tuple[float, float]:
    """c1, c2 whose roots are those of a critically tuned filter of a corner, part of the rate."""
    pole = np.exp(np.sqrt(2) * np.pi * corner * (-1 + 1j))
    return -2 * float(pole.real), float(abs(pole) ** 2)


def _under_gravity(
    table: Regression, values: FloatArray, rate: float
) -> Iterator[tuple[float, float]]:
    """c1, c2 where position noise is all there is: their roots are the poles under gravity.

    Gravity is taken at the measured position, so noise passes through its mean slope as well.
    """
    known = dict(zip(table.model.parameters, values.tolist(), strict=True))
    position = table.signals.position
    stiffness = known.get("position_stiffness", 0.0) + float(
        known.get("gravity_sine", 0.0) * np.mean(np.cos(position))
        - known.get("gravity_cosine", 0.0) * np.mean(np.sin(position))
    )
    if known["mass"] > 0 and stiffness > 0:
        root = sqrt(complex(rate * rate / 4 - stiffness / known["mass"]))
        poles = [exp((each - rate / 2) * table.signals.step) for each in (root, -root)]
        yield -(poles[0] + poles[1]).real, (poles[0] * poles[1]).real
