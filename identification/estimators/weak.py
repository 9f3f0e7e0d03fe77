"""The weak form: rows weighted by smooth test functions, and generalised least squares on those.

A test function takes the derivatives off the noisy position (Messenger and Bortz, Multiscale
Modeling & Simulation 19, 2021, p. 1474). White noise of position passes through m·q̈ + b·q̇, and
forces unknown to the log add to it; together they make the covariance of the tested rows, banded
and known but for the ratio of the two, which is chosen by likelihood. Noise is in the columns as
well, so they are computed from the position less the part of the residual that is its noise: then
the estimate is that of largest likelihood under the tested equations, without bias.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification.estimators.banded import Covariance, bands
from identification.estimators.bumps import Operators, bumps
from identification.estimators.delay import find_delay
from identification.estimators.drive import MOST_SAMPLES
from identification.estimators.least_squares import Regression, prepare
from identification.estimators.linear import explained
from identification.estimators.low_pass import width_of
from identification.estimators.model import Estimate, Model
from identification.estimators.rows import FIRST, LAST, Kinematics, of_rows
from identification.estimators.terms import terms
from identification.estimators.whiteness import whiteness
from identification.intervals import spread
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]

#: Test functions pass half of the power at this multiple of the frequency that holds most of the
#: motion: what is learnt of mass and damping goes with the power of position.
HEADROOM = 4.0
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
#: Solutions at most for one ratio; ...
_MOST_ROUNDS = 20
#: ... they have settled when no parameter moves by more than this part of its deviation.
_SETTLED = 1e-3
#: Half of the difference of delays for the slope of the force, in samples: it need not be exact,
#: as the force itself is taken anew at every delay.
_NUDGE = 0.05


def estimate(trajectory: Trajectory, model: Model, delay: float | None) -> Estimate:
    """Mass, damping and friction by the weak form.

    Args:
        trajectory: the log; time stamps are used as they are.
        model: which terms to estimate.
        delay: s, command to force; a fraction of a sample is honoured. None fits it, from 0 to
            MOST_SAMPLES samples.

    Returns:
        Estimate with the residual in force, whitened by its covariance and scaled to the root mean
        square of the tested rows.
    """
    if delay is not None:
        return fit(prepare(trajectory, model, delay), delay)
    start = find_delay(trajectory, model).value
    room = min(start + trajectory.sample_time, MOST_SAMPLES * trajectory.sample_time)
    table = prepare(trajectory, model, room, refine=False).refined(start)
    return fit(table, None, start=start)


def fit(table: Regression, delay: float | None, *, start: float = 0.0) -> Estimate:
    """The same from a prepared regression, which gives the start and the direction of motion.

    Args:
        table: with at least as many known intervals as the delay needs.
        delay: as for estimate.
        start: where the search for the delay begins, s.
    """
    frequency = _half_power(table)
    tested = _Tested.of(table, width_of(frequency), fits_delay=delay is None)
    first = start if delay is None else delay
    best = _Solution.first(table.solve(first), first)
    for _ in range(_CHOICES):
        trials = [tested.improved(best, corner * frequency) for corner in _CORNERS]
        best = min(trials, key=lambda trial: trial.unlikeliness)
        best = tested.settled(best)
    force, residual = best.force, best.residual
    around = spread(
        best.columns, residual, len(best.columns), signal=force, instruments=best.instruments
    )
    size = best.values.size
    notes = (
        f"{force.size} test functions, half power at {frequency:.3g} Hz",
        f"unlogged forces rule below {best.corner:.2g} Hz",
    )
    return Estimate(
        method="weak",
        model=table.model,
        delay=best.delay,
        delay_deviation=float(np.sqrt(around.covariance[size, size])) if delay is None else None,
        values=best.values,
        covariance=around.covariance[:size, :size],
        degrees_of_freedom=around.degrees_of_freedom,
        residual=residual * tested.scale(best),
        residual_unit="force",
        explained=explained(force, residual),
        whiteness=whiteness(residual),
        condition=around.condition,
        inflation=around.inflation[:size],
        mean_speed=table.mean_speed,
        notes=notes if best.settled else (*notes, "the solutions did not settle"),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Solution:
    """Parameters and what they were solved from, whitened.

    Attributes:
        values: shape (p,).
        delay: s.
        corner: frequency below which unlogged forces rule, Hz.
        columns: shape (q, functions); q is p, or p + 1 if the delay is fitted.
        instruments: what the residual is orthogonal to, shape (q, functions).
        force: shape (functions,).
        residual: shape (functions,).
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
    def first(cls, values: FloatArray, delay: float) -> _Solution:
        """A start."""
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
class _Tested:
    """The tested rows of one log.

    Attributes:
        table: prepared regression.
        weights: test functions, shape (functions, rows).
        bands: covariance of acceleration, of acceleration and velocity both ways, of velocity and
            of rows, for noise of unit variance; lower band form, shape (4, band + 1, functions).
        operators: acceleration and velocity as functions of position.
        columns: shape (p, functions).
        fits_delay: whether the delay is one more parameter.
    """

    table: Regression
    weights: csr_array
    bands: FloatArray
    operators: Operators
    columns: FloatArray
    fits_delay: bool

    @classmethod
    def of(cls, table: Regression, deviation: float, *, fits_delay: bool) -> _Tested:
        """Rows under test functions of a standard deviation in s."""
        signals = table.signals
        samples, known = signals.position.size, table.known
        steps = np.broadcast_to(np.asarray(signals.steps), (samples - 1,))
        place = np.cumsum(steps)[FIRST - 1 : -LAST][known:]
        weights = bumps(place, deviation)
        operators = Operators.of(weights, signals.steps, samples, known)
        fast, slow = operators.acceleration, operators.velocity
        mixed = fast @ slow.T
        return cls(
            table=table,
            weights=weights,
            bands=bands(fast @ fast.T, mixed + mixed.T, slow @ slow.T, weights @ weights.T),
            operators=operators,
            columns=_columns(table, weights, signals.position),
            fits_delay=fits_delay,
        )

    def force(self, delay: float) -> FloatArray:
        """Of every test function with a delay in s, N, shape (functions,)."""
        held = self.table.held_force(delay).times(self.table.motion.moving)
        return self.weights @ of_rows(held.triangle())[self.table.known :]

    def slope(self, delay: float) -> FloatArray:
        """Derivative of ``force`` by the delay, N/s."""
        width = _NUDGE * self.table.signals.step
        low, high = max(delay - width, 0.0), delay + width
        return (self.force(high) - self.force(low)) / (high - low)

    def improved(self, last: _Solution, corner: float) -> _Solution:
        """Solved with the covariance, and the noise of the position, as the last values have it."""
        mass, damping = last.values[:2]
        unlogged = (mass * (2 * np.pi * corner) ** 2) ** 2
        shares = np.array([mass * mass, mass * damping, damping * damping, unlogged])
        covariance = Covariance.of(np.tensordot(shares, self.bands, 1))
        force = self.force(last.delay)
        columns = clean = self.columns
        if last.residual.size:
            # What of the residual is noise of the position, were the last values the true ones.
            share = covariance.solve(force - last.values @ columns)
            correction = mass * (self.operators.acceleration.T @ share)
            correction += damping * (self.operators.velocity.T @ share)
            position = self.table.signals.position + correction
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


def _columns(table: Regression, weights: csr_array, position: FloatArray) -> FloatArray:
    """Every term of the model under test functions for a position, shape (p, functions)."""
    steps, known = table.signals.steps, table.known
    rows = Kinematics.of(position - np.mean(position), steps)
    others = terms(table.model, table.motion, position, steps).columns
    columns = [rows.acceleration, rows.velocity]
    columns += [of_rows(each.triangle()) for each in others]
    return np.stack([weights @ each[known:] for each in columns])


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
    wanted = max(HEADROOM * reached, table.cut_off.frequency)
    return float(np.clip(wanted, min(lowest, highest), highest))
