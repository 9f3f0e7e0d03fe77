"""Rows that were lost from a log whose others were numbered anew, and the time put back.

Where a row is lost every column moves in one step as far as in two. A step is clear where it stands
out of noise and bending beside its neighbours: nearly every step of a planned force or a set-point,
and the fast ones of a position. Clear steps are given the time of the rows lost in them, the others
their even share. Where no column is clear, jumps of position tell at least that rows are lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.trajectory import Trajectory, position_noise

FloatArray = NDArray[np.float64]

#: A step is clear if noise moves it, less its neighbours, by this part of them at most, and the
#: middle two of these differ by the second part at most; rows lost are whole numbers within ...
_CLEAR, _BENT, _WHOLE = 0.25, 0.5, 0.3
#: Steps too long that chance does not make: this many, and so many times those that are too short.
_FEWEST_LONG, _SURE = 8, 4
#: Position then jumps by this part of the steps lost, and so many deviations.
_JUMPS, _SURELY = 0.4, 4.0
#: Rows to either side of a cubic that a jump is told by, there and where no step is clear; then
#: so many jumps of one step within a part are needed, so many times those backward, and so many
#: deviations of both counts more than those: noise makes as many of either.
_BESIDE, _WIDE = 6, 12
_FEWEST_WIDE, _WITHIN, _WIDELY_SURE, _MORE = 15, 0.4, 2, 3.0
#: Part of the rows lost up to which the log stands as it is, and up to which time is put back ...
_HARMLESS, _MOST_LOST = 0.002, 0.2
_DOUBTED = 0.0025  # ... if chance leaves its length in doubt by this part at most, one deviation.


@dataclass(frozen=True, slots=True, kw_only=True)
class Restored:
    """A log with the time of the rows that it lost, or as it was."""

    trajectory: Trajectory
    share: float = 0.0  # rows lost for each that is left
    doubt: float = 0.0  # deviation of the length of time, a part of it
    first: float = 0.0  # first loss, s

    @property
    def usable(self) -> bool:
        """Whether the log stands, with its time put back if it lost any."""
        return self.share <= _MOST_LOST and self.doubt <= _DOUBTED

    def carried_by(self, estimate: Estimate) -> Estimate:
        """An estimate with what the doubt of time adds: mass goes with its square."""
        if not self.usable:  # allowed as it was
            return estimate
        covariance, moved = estimate.covariance.copy(), self.doubt * estimate.values[:2] * (2, 1)
        covariance[:2, :2] += np.outer(moved, moved)
        return replace(estimate, covariance=covariance)


def lost_rows(trajectory: Trajectory) -> Iterator[Finding]:
    """``lost-rows``: steps that are two steps of the motion, with no gap in time."""
    found = restored(trajectory)
    if found.share == 0:
        return
    refused = found.share > _HARMLESS and not found.usable
    done = "time is put back there" if found.usable else "too few are clear to put time back"
    yield Finding(
        code="lost-rows",
        severity="refusal" if refused else "warning",
        seen=f"{trajectory.source} steps twice as far as before and after, with no gap in time, in "
        f"{found.share:.1%} of its clear rows, the first after {found.first:g} s: rows were lost "
        f"and the others numbered anew; {done}",
        needed="no row lost" if found.usable else f"at most {_HARMLESS:.1%}",
        remedy="Log the controller's own time or its counter of samples with each row, and give "
        "it as time.",
        at=((found.first, found.first),),
    )


def restored(trajectory: Trajectory) -> Restored:
    """A log with even stamps and the time of its lost rows, if a clear column tells them."""
    step, place = trajectory.steps, trajectory.position
    if isinstance(step, np.ndarray):
        return Restored(trajectory=trajectory)
    noise = position_noise(place, trajectory.force, step)
    planned = [each for each in (trajectory.force, trajectory.reference) if each is not None]
    reads = [_read(place, noise), *(_read(each, _roughness(each)) for each in planned)]
    clear = np.any([each[0] for each in reads], axis=0)
    lost = np.max([each[1] for each in reads], axis=0)
    rows = np.flatnonzero(lost)
    enough = max(_FEWEST_LONG, _SURE * sum(each[2] for each in reads))
    if rows.size < enough or not _jumps(place, noise, rows, lost[rows]):
        return _suspected(trajectory, noise)
    part, share = float(clear.mean()), float(lost.sum() / clear.sum())
    time = np.concatenate(([0.0], np.cumsum(step * np.where(clear, 1 + lost, 1 + share))))
    doubt, first = share / np.sqrt(rows.size) * (1 - part), float(trajectory.time[rows[0]])
    found = Restored(trajectory=trajectory, share=share, doubt=doubt, first=first)
    timed = replace(trajectory, time=trajectory.time[0] + time)
    return replace(found, trajectory=timed) if found.usable else found


def _roughness(column: FloatArray) -> float:
    """Noise of a column that is smooth but for it, from the median of its fourth differences."""
    return float(max(np.median(np.abs(np.diff(column, 4))) / 5.64, 1e-12 * np.ptp(column)))


def _read(column: FloatArray, noise: float) -> tuple[NDArray[np.bool_], FloatArray, int]:
    """Which steps are clear, rows lost in each, and how many are too short by a row."""
    steps = np.diff(column)
    near = np.sort(np.lib.stride_tricks.sliding_window_view(steps, 5)[:, (0, 1, 3, 4)], axis=1)
    usual, bend = (near[:, 1] + near[:, 2]) / 2, near[:, 2] - near[:, 1]
    # Noise of one reading enters by about 3/2, 3/2, 1/2 and 1/2.
    clear = (np.abs(usual) >= np.sqrt(5.0) * noise / _CLEAR) & (bend <= _BENT * np.abs(usual))
    clear &= near[:, 0] * near[:, 3] > 0
    excess = np.divide(steps[2:-2], usual, out=np.ones(usual.size), where=clear) - 1
    whole = np.where(np.abs(excess - np.rint(excess)) <= _WHOLE, np.rint(excess), 0.0)
    # The top of a fast sine is longer than its neighbours too, but no longer than a cubic of them.
    long = np.flatnonzero(whole > 0)
    cubic = (4 * (steps[1:-3] + steps[3:-1]) - steps[:-4] - steps[4:])[long] / 6
    beyond = (steps[long + 2] - cubic) / (whole * usual)[long]
    if np.sum(beyond) < _JUMPS * long.size:
        whole = np.minimum(whole, 0.0)
    return np.pad(clear, 2), np.pad(np.maximum(whole, 0.0), 2), int(np.sum(whole < 0))


def _jump_and_step(place: FloatArray, beside: int) -> tuple[FloatArray, FloatArray, float]:
    """Jumps that a cubic leaves between two rows, its steps there, and noise of a jump.

    The first is between rows ``beside`` - 1 and ``beside``. Noise is in noise of a reading.
    """
    row = np.arange(2 * beside) - beside + 0.5
    cubic = (row / beside) ** np.arange(4)[:, None]
    jump = np.linalg.pinv(np.vstack((cubic, np.sign(row) / 2)))[:, -1]
    step = np.linalg.pinv(cubic)[:, 1] / beside
    return np.correlate(place, jump), np.correlate(place, step), float(np.sqrt(jump @ jump))


def _jumps(place: FloatArray, noise: float, rows: NDArray[np.intp], lost: FloatArray) -> bool:
    """Whether position jumps on average where rows seem lost: a force has steps of its own."""
    jump, step, size = _jump_and_step(place, _BESIDE)
    index = np.clip(rows - _BESIDE + 1, 0, jump.size - 1)
    expected = lost * step[index]
    total = float(np.sqrt(np.sum(expected**2)))
    return float(expected @ jump[index]) > max(_JUMPS * total, _SURELY * noise * size) * total


def _suspected(trajectory: Trajectory, noise: float) -> Restored:
    """Losses where no step is clear by itself, with no time put back."""
    jump, step, size = _jump_and_step(trajectory.position, _WIDE)
    clear = np.abs(step) >= noise * size / _CLEAR
    excess = np.divide(jump, step, out=np.zeros(step.size), where=clear)
    near = [np.flatnonzero(np.abs(sign * excess - 1) < _WITHIN) for sign in (1, -1)]
    # Rows beside a loss see it too; one of them counts.
    long, short = (int(np.sum(np.diff(each, prepend=-_WIDE) >= _WIDE)) for each in near)
    if long < max(_FEWEST_WIDE, _WIDELY_SURE * short, short + _MORE * np.sqrt(long + short)):
        return Restored(trajectory=trajectory)
    # Motion too fast for the wide cubic leaves jumps as well, but none beside the narrower one.
    runs = np.split(near[0], np.flatnonzero(np.diff(near[0]) >= _WIDE) + 1)
    best = np.array([each[np.argmax(np.abs(jump[each]))] for each in runs]) + _WIDE - 1
    if not _jumps(trajectory.position, noise, best, np.ones(best.size)):
        return Restored(trajectory=trajectory)
    first = float(trajectory.time[near[0][0] + _WIDE - 1])
    share = long / int(clear.sum())
    return Restored(trajectory=trajectory, share=share, doubt=np.inf, first=first)
