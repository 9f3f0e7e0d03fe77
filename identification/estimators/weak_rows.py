"""Rows of a log under modulating functions, and iterated solutions of the weak form.

One file: rows, covariance and solution of one iteration.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification.estimators.banded import Covariance, bands
from identification.estimators.drive import MOST_SAMPLES
from identification.estimators.modulating_functions import Operators, bump_weights
from identification.estimators.regression import Regression
from identification.estimators.rows import FIRST, LAST, Kinematics, of_rows
from identification.estimators.terms import terms

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

#: Solutions at most for one ratio; ...
_MOST_ROUNDS = 20
#: ... they have settled when no parameter moves by more than this part of its deviation.
_SETTLED = 1e-3
#: Half of the difference of delays for the slope of the force, in samples: it need not be exact,
#: as the force itself is taken anew at every delay.
_NUDGE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Parameters and what they were solved from, whitened.

    Attributes:
        values: shape (p,).
        delay: s.
        corner: frequency below which unlogged forces rule, Hz.
        columns: shape (q, functions); q is p, or p + 1 if the delay is fitted.
        instruments: what the residual is orthogonal to, shape (q, functions).
        force: without unit, shape (functions,).
        residual: without unit, shape (functions,).
        unlikeliness: -2 log of the likelihood, but for a constant.
        settled: whether the last step was short.
    """

    values: FloatArray
    delay: float
    corner: float
    columns: FloatArray
    instruments: FloatArray
    force: FloatArray
    residual: FloatArray
    unlikeliness: float
    settled: bool

    @classmethod
    def first(cls, values: FloatArray, delay: float) -> Solution:
        """A start from values of shape (p,)."""
        nothing = np.empty(0)
        return cls(
            values=values,
            delay=delay,
            corner=0.0,
            columns=nothing,
            instruments=nothing,
            force=nothing,
            residual=nothing,
            unlikeliness=np.inf,
            settled=False,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedRows:
    """The tested rows of one log.

    Attributes:
        table: prepared regression.
        weights: test functions, shape (functions, rows).
        passes: which parameters pass noise of the position on, shape (k,).
        operators: what test functions read of each position, per unit of those parameters.
        bands: covariance of noise of unit variance through every two of them, then of the rows
            themselves; lower band form, shape (k(k + 1)/2 + 1, band + 1, functions).
        columns: shape (p, functions).
        fits_delay: whether the delay is one more parameter.
    """

    table: Regression
    weights: csr_array
    passes: IndexArray
    operators: tuple[csr_array, ...]
    bands: FloatArray
    columns: FloatArray
    fits_delay: bool

    @classmethod
    def of(cls, table: Regression, deviation: float, *, fits_delay: bool) -> TestedRows:
        """Rows under test functions of a standard deviation in s."""
        signals = table.signals
        samples, known = signals.position.size, table.known
        steps = np.broadcast_to(np.asarray(signals.steps), (samples - 1,))
        place = np.cumsum(steps)[FIRST - 1 : -LAST][known:]
        weights = bump_weights(place, deviation)
        passes, operators = _passing(table, Operators.of(weights, signals.steps, samples, known))
        pairs: list[csr_array] = []
        for one, other in combinations_with_replacement(operators, 2):
            both = one @ other.T
            pairs.append(both if one is other else both + both.T)
        return cls(
            table=table,
            weights=weights,
            passes=passes,
            operators=operators,
            bands=bands(*pairs, weights @ weights.T),
            columns=_columns(table, weights, signals.position),
            fits_delay=fits_delay,
        )

    def force(self, delay: float) -> FloatArray:
        """Force under every test function with a delay in s, N, shape (functions,)."""
        held = self.table.held_force(delay).times(self.table.motion.moving)
        return self.weights @ of_rows(held.triangle())[self.table.known :]

    def slope(self, delay: float) -> FloatArray:
        """Derivative of ``force`` by the delay, N/s, shape (functions,)."""
        width = _NUDGE * self.table.signals.step
        low, high = max(delay - width, 0.0), delay + width
        return (self.force(high) - self.force(low)) / (high - low)

    def improved(self, last: Solution, corner: float) -> Solution:
        """Solved with the covariance, and the noise of the position, as the last values have it."""
        passing = last.values[self.passes]
        shares = [one * other for one, other in combinations_with_replacement(passing, 2)]
        unlogged = (last.values[0] * (2 * np.pi * corner) ** 2) ** 2
        covariance = Covariance.of(np.tensordot([*shares, unlogged], self.bands, 1))
        force = self.force(last.delay)
        columns = clean = self.columns
        if last.residual.size:
            # What of the residual is noise of the position, were the last values the true ones.
            share = covariance.solve(force - last.values @ columns)
            position = self.table.signals.position.copy()
            for value, operator in zip(passing, self.operators, strict=True):
                position += value * (operator.T @ share)
            clean = _columns(self.table, self.weights, position)
        # Unlogged forces are in the acceleration, not in the logged force.
        tests = [force, *clean[1:]]
        if self.fits_delay:
            later = -self.slope(last.delay)
            columns, tests = np.vstack((columns, later)), [*tests, later]
        columns, instruments = covariance.whitened(columns), covariance.whitened(np.stack(tests))
        force = covariance.whitened(force)
        sizes = np.linalg.norm(columns, axis=1)
        sizes = np.where(sizes > 0, sizes, 1.0)
        normal = instruments @ columns.T / np.outer(sizes, sizes)
        solved = np.linalg.pinv(normal) @ (instruments @ force / sizes) / sizes
        residual = force - solved @ columns
        values, delay = solved[: last.values.size], last.delay
        moved = solved - np.append(last.values, [0.0] * self.fits_delay)
        if self.fits_delay:
            delay = float(np.clip(delay + solved[-1], 0.0, MOST_SAMPLES * self.table.signals.step))
        shift = moved @ columns
        variance = max(float(residual @ residual) / residual.size, np.finfo(float).tiny)
        return Solution(
            values=values,
            delay=delay,
            corner=corner,
            columns=columns,
            instruments=instruments,
            force=force,
            residual=residual,
            unlikeliness=covariance.log_determinant + residual.size * float(np.log(variance)),
            settled=bool(shift @ shift <= _SETTLED**2 * variance),
        )

    def settled(self, solution: Solution) -> Solution:
        """Solved again and again until nothing moves."""
        for _ in range(_MOST_ROUNDS):
            solution = self.improved(solution, solution.corner)
            if solution.settled:
                break
        return solution

    def scale(self, solution: Solution) -> float:
        """Root mean square of the residual of tested rows over that of the whitened ones."""
        size = float(np.linalg.norm(solution.residual))
        plain = self.force(solution.delay) - solution.values @ self.columns
        return float(np.linalg.norm(plain)) / size if size > 0 else 1.0


def _passing(table: Regression, found: Operators) -> tuple[IndexArray, tuple[csr_array, ...]]:
    """Parameters through which noise of the position reaches the rows, and how.

    Gravity changes with position; friction is taken not to, as little of it does.
    """
    names, position = table.model.parameters, table.signals.position
    through = {
        "mass": found.acceleration,
        "damping": found.velocity,
        "position_stiffness": found.place,
        "gravity_sine": found.place * np.cos(position),
        "gravity_cosine": found.place * -np.sin(position),
    }
    passes = [index for index, name in enumerate(names) if name in through]
    return np.array(passes, dtype=np.intp), tuple(through[names[index]].tocsr() for index in passes)


def _columns(table: Regression, weights: csr_array, position: FloatArray) -> FloatArray:
    """Every term of the model under test functions for a position, shape (p, functions)."""
    steps, known = table.signals.steps, table.known
    rows = Kinematics.of(position - np.mean(position), steps)
    others = terms(table.model, table.motion, position, steps).columns
    columns = [rows.acceleration, rows.velocity]
    columns += [of_rows(each.triangle()) for each in others]
    return np.stack([weights @ each[known:] for each in columns])
