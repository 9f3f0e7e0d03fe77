"""Method of modulating functions (weak form), solved by generalised least squares.

A test function takes the derivatives off the noisy position (Messenger and Bortz, Multiscale
Modeling & Simulation 19, 2021, p. 1474). White noise of position passes through m·q̈ + b·q̇, and
forces unknown to the log add to it; together they make the covariance of the tested rows, banded
and known but for the ratio of the two, which is chosen by likelihood. Noise is in the columns as
well, so they are computed from the position less the part of the residual that is its noise: then
the estimate is that of largest likelihood under the tested equations, without bias. A test function
looks ahead as well as back: where unlogged forces return through a controller, the delay is to be
stated, or found by another method.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.estimators.intervals import spread
from identification.estimators.low_pass import width_of
from identification.estimators.model import Estimate
from identification.estimators.point_estimate import PointEstimate, complete_estimate
from identification.estimators.regression import Regression
from identification.estimators.weak_rows import Solution, TestedRows

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


def point(table: Regression, delay: float | None, *, start: float = 0.0) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    frequency = _half_power(table)
    tested = TestedRows.of(table, width_of(frequency), fits_delay=delay is None)
    return _point(tested, _found(tested, frequency, start if delay is None else delay))


def fit(table: Regression, delay: float | None, *, start: float = 0.0) -> Estimate:
    """Mass, damping and friction by the weak form.

    Args:
        table: gives the start and the direction of motion; it has at least as many known
            intervals as the delay needs.
        delay: s, command to force; a fraction of a sample is honoured. None fits it, from 0 to
            MOST_SAMPLES samples.
        start: where the search for the delay begins, s.

    Returns:
        Estimate with the residual in force, whitened by its covariance and scaled to the root mean
        square of the tested rows.
    """
    frequency = _half_power(table)
    tested = TestedRows.of(table, width_of(frequency), fits_delay=delay is None)
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
    found = complete_estimate(
        "weak",
        table.model,
        _point(tested, best),
        around,
        fitted=delay is None,
        unit="force",
        mean_speed=table.mean_speed,
        notes=tuple(notes),
    )
    return replace(found, open_loop_only=open_loop_only)


def _found(tested: TestedRows, frequency: float, first: float) -> Solution:
    """The likeliest solution, from least squares at a first delay on.

    Args:
        tested: rows under test functions.
        frequency: half-power frequency of those, Hz.
        first: delay, s.
    """
    best = Solution.first(tested.table.solve(first), first)
    for _ in range(_CHOICES):
        trials = [tested.improved(best, corner * frequency) for corner in _CORNERS]
        best = min(trials, key=lambda trial: trial.unlikeliness)
        best = tested.settled(best)
    return best


def _point(tested: TestedRows, best: Solution) -> PointEstimate:
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
    wanted = max(HEADROOM * reached, table.cut_off.frequency)
    return float(np.clip(wanted, min(lowest, highest), highest))
