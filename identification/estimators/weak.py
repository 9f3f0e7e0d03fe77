"""Method of modulating functions (weak form), solved by generalised least squares.

A test function, smooth and of compact support, takes the derivatives off the noisy position
(Messenger and Bortz, Multiscale Modeling & Simulation 19, 2021, p. 1474). White noise of position
passes through m·q̈ + b·q̇, and forces unknown to the log add to it; together they make the
covariance of the tested rows, banded and known but for the ratio of the two, which is chosen by
likelihood. Noise is in the columns as well, so they are computed from the position less the part of
the residual that is its noise: then the estimate is that of largest likelihood under the tested
equations, without bias. A test function looks ahead as well as back: where unlogged forces return
through a controller, the delay is to be stated, or found by another method.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import Estimate, PointEstimate, spread
from identification.estimators.filters import width_of
from identification.estimators.least_squares import MOST_SAMPLES, Regression, complete_estimate
from identification.estimators.signals import FIRST, LAST, HeldColumn, Kinematics, of_rows

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

#: Independent noise added to each variance, part of it: double precision resolves no smaller one.
_LOADING = 1e-12
#: Exponent of (1 - x²)^n: seven smooth derivatives at the ends, close to a Gaussian.
_EXPONENT = 8
#: Distance of two test functions in their standard deviations. At 1 their sums miss what costs
#: 5 % of the precision of mass; at 0.7, 1 %.
_SPACING = 0.7
#: Samples that one row of kinematics reads.
_READ = FIRST + LAST + 1
#: Solutions at most for one ratio; ...
_MOST_ROUNDS = 20
#: ... they have settled when no parameter moves by more than this part of its deviation.
_SETTLED = 1e-3
#: Test functions pass half of the power at this multiple of the frequency that holds most of the
#: motion: what is learnt of mass and damping goes with the power of position.
_HEADROOM = 4.0
#: ... most of its power, that is.
_MOST = 0.999
#: Highest half-power frequency, part of the sampling rate.
_HIGHEST = 0.1
#: At least this many test functions, or there are too few to compare.
_FEWEST = 60
#: Frequencies, in parts of the half-power one, below which unlogged forces rule the covariance.
_CORNERS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
#: Times the ratio of the noises is chosen.
_CHOICES = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class BandedCovariance:
    """A banded covariance by its Cholesky factor, shape (band + 1, functions), lower form."""

    factor: FloatArray

    @classmethod
    def of(cls, covariance: FloatArray) -> BandedCovariance:
        """From the covariance in the same form, shape (band + 1, functions)."""
        from scipy.linalg import cholesky_banded

        loaded = np.concatenate((covariance[:1] * (1 + _LOADING), covariance[1:]))
        return cls(factor=np.asarray(cholesky_banded(loaded, lower=True)))

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant."""
        return 2 * float(np.sum(np.log(self.factor[0])))

    def whitened(self, right: FloatArray) -> FloatArray:
        """Columns, shape (..., functions), as if the covariance were 1."""
        from scipy.linalg import solve_banded

        return solve_banded((len(self.factor) - 1, 0), self.factor, right.T).T

    def solve(self, right: FloatArray) -> FloatArray:
        """The inverse of the covariance times a column, shape (functions,)."""
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self.factor, True), right))


def bands(*matrices: csr_array) -> FloatArray:
    """Symmetric matrices in lower band form, shape (matrices, band + 1, functions)."""
    found = [each.tocoo() for each in matrices]
    band = max(int(np.max(each.coords[0] - each.coords[1])) for each in found)
    banded = np.zeros((len(found), band + 1, matrices[0].shape[0]))
    for target, each in zip(banded, found, strict=True):
        row, column = each.coords
        lower = row >= column
        target[(row - column)[lower], column[lower]] = each.data[lower]
    return banded


def bump_weights(place: FloatArray, deviation: float) -> csr_array:
    """Weights of the rows of a log in each test function, shape (functions, rows).

    Test function j is (1 - ((t - c[j])/h)²)^_EXPONENT for |t - c[j]| < h, its standard deviation
    given as of a bell curve, s. Those at the ends of a log are cut off there: any weighted sum of
    rows is exact. The weights of each sum to 1.
    """
    from scipy.sparse import csr_array

    half = deviation * float(np.sqrt(2 * _EXPONENT + 3))
    first_row, last_row = float(place[0]), float(place[-1])
    gaps = max(int((last_row - first_row) / (_SPACING * deviation)), 1)
    centres = first_row + np.arange(gaps + 1) * ((last_row - first_row) / gaps)
    first = np.searchsorted(place, centres - half, side="right")
    beyond = np.searchsorted(place, centres + half, side="left")
    lengths = beyond - first
    ends = np.concatenate(([0], np.cumsum(lengths)))
    columns: IndexArray = np.arange(int(ends[-1])) - np.repeat(ends[:-1] - first, lengths)
    apart = (place[columns] - np.repeat(centres, lengths)) / half
    weight = (1 - apart * apart) ** _EXPONENT
    weight /= np.repeat(np.add.reduceat(weight, ends[:-1]), lengths)
    return csr_array((weight, columns, ends), shape=(centres.size, place.size))


@dataclass(frozen=True, slots=True, kw_only=True)
class Operators:
    """What test functions read of each position, shape (functions, n) each."""

    acceleration: csr_array  # 1/s²
    velocity: csr_array  # 1/s
    place: csr_array  # of position itself, 1

    @classmethod
    def of(
        cls, weights: csr_array, steps: float | FloatArray, samples: int, known: int
    ) -> Operators:
        """Operators of a log, from weights of its rows after the first ``known``.

        The rows are asked for their own coefficients: each reads _READ neighbours, so as many
        positions that are 1 at every _READ-th sample show them all.
        """
        from scipy.sparse import csr_array

        rows = samples - _READ + 1
        read = np.arange(rows)[:, None] + np.arange(_READ)
        coefficients = np.empty((3, *read.shape))
        for phase in range(_READ):
            comb = np.zeros(samples)
            comb[phase::_READ] = 1.0
            moved = Kinematics.of(comb, steps)
            middle = HeldColumn.constant((comb[1:] + comb[:-1]) / 2, steps)
            answer = (moved.acceleration, moved.velocity, of_rows(middle.triangle()))
            which = (phase - np.arange(rows)) % _READ
            coefficients[:, np.arange(rows), which] = answer
        ends = np.arange(0, read.size + 1, _READ)
        made = [
            weights @ csr_array((each.ravel(), read.ravel(), ends), shape=(rows, samples))[known:]
            for each in coefficients
        ]
        return cls(acceleration=made[0], velocity=made[1], place=made[2])


@dataclass(frozen=True, slots=True)
class _Solution:
    """Parameters and what they were solved from, whitened."""

    values: FloatArray  # shape (p,)
    delay: float  # s
    corner: float  # frequency below which unlogged forces rule, Hz
    columns: FloatArray  # shape (q, functions); q is p, or p + 1 if the delay is fitted
    instruments: FloatArray  # what the residual is orthogonal to, shape (q, functions)
    force: FloatArray  # without unit, shape (functions,)
    residual: FloatArray  # without unit, shape (functions,)
    unlikeliness: float  # -2 log of the likelihood, but for a constant
    settled: bool  # whether the last step was short


@dataclass(frozen=True, slots=True, kw_only=True)
class _TestedRows:
    """The tested rows of one log."""

    table: Regression  # prepared regression
    weights: csr_array  # test functions, shape (functions, rows)
    passes: IndexArray  # which parameters pass noise of the position on, shape (k,)
    #: what test functions read of each position, per unit of those parameters
    operators: tuple[csr_array, ...]
    #: covariance of noise of unit variance through every two of them, then of the rows themselves;
    #: lower band form, shape (k(k + 1)/2 + 1, band + 1, functions)
    bands: FloatArray
    columns: FloatArray  # shape (p, functions)
    fits_delay: bool  # whether the delay is one more parameter

    @classmethod
    def of(cls, table: Regression, deviation: float, *, fits_delay: bool) -> _TestedRows:
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
        low, high = self.table.about(delay)
        return (self.force(high) - self.force(low)) / (high - low)

    def improved(self, last: _Solution, corner: float) -> _Solution:
        """Solved with the covariance, and the noise of the position, as the last values have it."""
        passing = last.values[self.passes]
        shares = [one * other for one, other in combinations_with_replacement(passing, 2)]
        unlogged = (last.values[0] * (2 * np.pi * corner) ** 2) ** 2
        covariance = BandedCovariance.of(np.tensordot([*shares, unlogged], self.bands, 1))
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
        return _Solution(
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

    def settled(self, solution: _Solution) -> _Solution:
        """Solved again and again until nothing moves."""
        for _ in range(_MOST_ROUNDS):
            solution = self.improved(solution, solution.corner)
            if solution.settled:
                break
        return solution

    def scale(self, solution: _Solution) -> float:
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
    columns = table.unfiltered(position, table.motion)
    return np.stack([weights @ each[table.known :] for each in columns])


def point(table: Regression, delay: float | None, *, start: float = 0.0) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    frequency = _half_power(table)
    tested = _TestedRows.of(table, width_of(frequency), fits_delay=delay is None)
    return _point(tested, _found(tested, frequency, start if delay is None else delay))


def fit(table: Regression, delay: float | None, *, start: float = 0.0) -> Estimate:
    """Mass, damping and friction by the weak form.

    The residual is a force, whitened and scaled to the root mean square of the tested rows.
    """
    frequency = _half_power(table)
    tested = _TestedRows.of(table, width_of(frequency), fits_delay=delay is None)
    best = _found(tested, frequency, start if delay is None else delay)
    around = spread(
        best.columns,
        best.residual,
        len(best.columns),
        signal=best.force,
        instruments=best.instruments,
    )
    # Unlogged forces come back through a controller, and the windows look ahead.
    open_loop_only = best.corner > 0 and delay is None
    notes = [f"{best.force.size} test functions, half power at {frequency:.3g} Hz"]
    if best.corner > 0:
        notes.append(f"unlogged forces rule below {best.corner:.2g} Hz")
    if open_loop_only:
        notes.append("the delay is right in open loop only")
    if not best.settled:
        notes.append("the solutions did not settle")
    best_point, fitted = _point(tested, best), delay is None
    found = complete_estimate(
        "weak", table, best_point, around, fitted=fitted, unit="force", notes=notes
    )
    return replace(found, open_loop_only=open_loop_only)


def _found(tested: _TestedRows, frequency: float, first: float) -> _Solution:
    """The likeliest solution, from least squares at a first delay on."""
    nothing = np.empty(0)
    start = tested.table.solve(first)
    best = _Solution(start, first, 0.0, nothing, nothing, nothing, nothing, np.inf, settled=False)
    for _ in range(_CHOICES):
        trials = [tested.improved(best, corner * frequency) for corner in _CORNERS]
        best = min(trials, key=lambda trial: trial.unlikeliness)
        best = tested.settled(best)
    return best


def _point(tested: _TestedRows, best: _Solution) -> PointEstimate:
    scale = tested.scale(best)
    return PointEstimate(
        values=best.values,
        delay=best.delay,
        signal=best.force * scale,
        residual=best.residual * scale,
    )


def _half_power(table: Regression) -> float:
    """Frequency up to which test functions shall see, Hz."""
    signals = table.signals
    rows = signals.kinematics.acceleration
    window = np.hanning(rows.size)
    power = np.abs(np.fft.rfft(rows * window)) ** 2
    frequency = np.fft.rfftfreq(rows.size, signals.step)
    # Back to the power of position; the first bins hold what the window lets through.
    relative = (2 * np.sin(np.pi * frequency[3:] * signals.step)) ** 4
    floor = signals.noise**2 * float(window @ window)
    position = np.cumsum(power[3:] * signals.step**4 / relative - floor)
    reached = float(frequency[3 + int(np.argmax(position >= _MOST * position[-1]))])
    longest = (rows.size * signals.step) / _FEWEST
    lowest = float(np.sqrt(np.log(2)) / (2 * np.pi * longest))
    highest = _HIGHEST / signals.step
    wanted = max(_HEADROOM * reached, table.cut_off.frequency)
    return float(np.clip(wanted, min(lowest, highest), highest))
