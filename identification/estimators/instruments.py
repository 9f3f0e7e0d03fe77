"""Instrumental variables: filtered rows tested against columns free of the log's own noise.

Noise in the columns and, in closed loop, in the force biases least squares. Instruments are the
same columns of a position that does not carry it: the part of the position that a logged reference
explains, or, without one, the noise-free device moved by the logged force, simulated with the
estimate and estimated again until both agree (refined instrumental variables: Young, Recursive
Estimation and Time-Series Analysis, 2011, chapter 8). The simulated ones are valid in open loop
only: in closed loop the logged force carries the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.estimators.estimate import Estimate, PointEstimate, spread, unit_columns
from identification.estimators.least_squares import (
    Drive,
    Regression,
    complete_estimate,
    longest_delay,
)
from identification.estimators.motion import Motion
from identification.estimators.signals import Commands, HeldColumn, HeldResponse, of_rows
from identification.trajectory import FloatArray

#: Estimates at most with simulated instruments; ...
_MOST_ROUNDS = 10
#: ... they have settled when no fit moves by more than this part of the residual.
_SETTLED = 1e-3
#: Past values of the reference that make up the position it explains, ...
_LAGS = 40
#: ... this far apart, in periods of the low-pass: closer ones are alike.
_LAG = 0.25
#: Half of the difference of delays for the slope of the force, in samples: it need not be exact,
#: as the force itself is taken anew at every delay.
_NUDGE = 0.05
#: Combinations of past values smaller than this part of the largest are left out: the reference
#: does not excite them.
_UNEXCITED = 1e-6


@dataclass(frozen=True, slots=True)
class _Source:
    """Where instruments come from."""

    note: str
    commands: Commands  # forces free of noise, for the slope by the delay
    columns: Callable[[FloatArray, float], FloatArray]  # from an estimate and its delay, (p, rows)


def point(table: Regression, delay: float, *, fits_delay: bool = False) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    return _found(table, _source(table), delay, fits_delay=fits_delay)


def fit(table: Regression, delay: float, *, fits_delay: bool = False) -> Estimate:
    """Mass, damping and friction by instrumental variables; the residual is a filtered force."""
    source = _source(table)
    best = _found(table, source, delay, fits_delay=fits_delay)
    size = len(table.model.parameters) + fits_delay
    around = spread(best.columns, best.residual, size, signal=best.signal, instruments=best.tests)
    notes = [source.note, table.cut_off.reason]
    notes += [] if best.settled else ["the instruments did not settle"]
    return complete_estimate(
        "instruments", table, best, around, fitted=fits_delay, unit="force", notes=notes
    )


def _found(table: Regression, source: _Source, delay: float, *, fits_delay: bool) -> _Solution:
    """The solution that its own instruments no longer move."""
    best = _improved(table, source, table.solve(delay), delay, fits_delay=fits_delay)
    for _ in range(_MOST_ROUNDS):
        if best.settled:
            break
        best = _improved(table, source, best.values, best.delay, fits_delay=fits_delay)
    return best


@dataclass(frozen=True, slots=True, kw_only=True)
class _Solution(PointEstimate):
    """A point estimate and what it was solved from."""

    columns: FloatArray  # shape (q, rows); q is p, or p + 1 if the delay is fitted
    tests: FloatArray  # instruments, shape (q, rows)
    settled: bool  # whether the last step was short


def _improved(
    table: Regression, source: _Source, values: FloatArray, delay: float, *, fits_delay: bool
) -> _Solution:
    """Solved with instruments from the last values and their delay."""
    force, columns = table.force(delay), table.columns
    tests = source.columns(values, delay)
    last = values
    if fits_delay:
        last = np.append(values, 0.0)
        columns = np.vstack((columns, -_slope(table, table.signals.commands, delay)))
        tests = np.vstack((tests, -_slope(table, source.commands, delay)))
    solved = solve_instrumental(tests, columns, force)
    residual = force - solved @ columns
    if fits_delay:
        most = longest_delay(table.signals.step, table.signals.position.size)
        delay = float(np.clip(delay + solved[-1], 0.0, most))
    moved = float(np.linalg.norm((solved - last) @ columns))
    return _Solution(
        values=solved[: values.size],
        delay=delay,
        columns=columns,
        tests=tests,
        signal=force,
        residual=residual,
        settled=moved <= _SETTLED * float(np.linalg.norm(residual)),
    )


def _source(table: Regression) -> _Source:
    """What past values of a logged reference explain, else the noise-free device, simulated."""
    signals = table.signals
    if signals.reference is None:
        return _Source(
            "instruments simulated from the logged force, valid in open loop",
            signals.commands,
            lambda values, delay: _columns(table, _simulated(table, values, delay)),
        )
    past = _Past.of(table, signals.reference)
    known = _columns(table, past.explained(signals.position))
    if signals.commands.sent is not None:
        past = _Past.of(table, signals.reference, signals.commands.sent)
    force = replace(signals.commands, value=past.explained(signals.commands.value))
    return _Source("instruments from the logged reference", force, lambda _values, _delay: known)


def explained_by_reference(table: Regression) -> FloatArray | None:
    """Position that past values of the logged reference explain, m; None where none is logged."""
    reference = table.signals.reference
    if reference is None:
        return None
    return _Past.of(table, reference).explained(table.signals.position)


def _simulated(table: Regression, values: FloatArray, delay: float) -> FloatArray:
    """Position of the noise-free device, from the start that fits the measured one."""
    drive = Drive.of(table, delay)
    # A mass that is not positive has no motion to simulate; without damping it is still one.
    device = HeldResponse.at(drive.rate_of(values), drive.steps)
    mass = values[0] if values[0] > 0 else 1.0
    weights = np.concatenate(([1.0], -values[2:])) / mass
    gain = np.zeros((2, table.signals.speed.size))
    for weight, held in zip(weights, drive.inputs(delay), strict=True):
        gain += weight * device.gain(held)
    moved, _ = device.position(gain)
    coasted = device.coasting(table.signals.speed.size)
    starts = np.stack((np.ones(moved.size), coasted), axis=1)
    missing = table.signals.position - moved
    return moved + starts @ np.linalg.lstsq(starts, missing, rcond=None)[0]


@dataclass(frozen=True, slots=True)
class _Past:
    """Values of a reference some lags before some times, each about its mean and of unit norm."""

    values: FloatArray  # shape (lags, times)
    #: of their products, as far as the reference excites them, shape (lags, lags)
    inverse: FloatArray

    @classmethod
    def of(cls, table: Regression, reference: FloatArray, at: FloatArray | None = None) -> _Past:
        """Before the samples, or before other times in s."""
        signals = table.signals
        if isinstance(signals.steps, np.ndarray):
            time = np.concatenate(([0.0], np.cumsum(signals.steps)))
        else:
            time = np.arange(signals.position.size) * np.float64(signals.steps)
        at, apart = time if at is None else at, max(_LAG / table.cut_off.frequency, signals.step)
        past = np.empty((_LAGS, at.size))
        for lag, row in enumerate(past):
            row[:] = np.interp(at - lag * apart, time, reference)
        past -= past.mean(axis=1, keepdims=True)
        norms = np.linalg.norm(past, axis=1, keepdims=True)
        past /= np.where(norms > 0, norms, 1.0)
        products: FloatArray = past @ past.T
        inverse = np.asarray(
            np.linalg.pinv(products, rcond=_UNEXCITED**2, hermitian=True), dtype=np.float64
        )
        return cls(past, inverse)

    def explained(self, column: FloatArray) -> FloatArray:
        """What they explain of a column, shape (times,)."""
        mean = np.mean(column)
        return (self.inverse @ (self.values @ (column - mean))) @ self.values + mean


def _slope(table: Regression, commands: Commands, delay: float) -> FloatArray:
    """Derivative of the filtered force by its delay, N/s, shape (rows,)."""
    low, high = max(delay - _NUDGE * table.signals.step, 0.0), delay + _NUDGE * table.signals.step
    late, early = (commands.after(each).times(table.motion.moving) for each in (high, low))
    change = of_rows(late.triangle() - early.triangle())
    return table.low_pass(change)[table.known :] / (high - low)


def solve_instrumental(
    instruments: FloatArray, columns: FloatArray, force: FloatArray
) -> FloatArray:
    """Parameters whose residual no instrument sees, shape (p,)."""
    tests, _ = unit_columns(instruments.T)
    unit, norms = unit_columns(columns.T)
    return np.linalg.lstsq(tests.T @ unit, tests.T @ force, rcond=None)[0] / norms


def _columns(table: Regression, position: FloatArray) -> FloatArray:
    """The columns of the regression with another position in place of the measured one."""
    motion, steps = table.motion, table.signals.steps
    if table.model.coulomb:
        sense = np.sign(np.diff(position)) * motion.moving
        motion = Motion(direction=HeldColumn.constant(sense, steps), moving=motion.moving)
    return table.low_pass(table.unfiltered(position, motion))[:, table.known :]
