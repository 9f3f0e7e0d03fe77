"""Rows lost from a log, or written twice, the others numbered anew, and the time put right.

Where a row is lost every column moves in one step as far as in two. A step is clear where it stands
out of noise and bending beside its neighbours: nearly every step of a planned force or a set-point,
and the fast ones of a position. Clear steps are given the time of the rows lost in them, the others
their even share. Where no column is clear, jumps of position tell at least that rows are lost.
Rows equal to those before them, beside steps that are clear, were written twice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.trajectory import (
    SHORTEST,
    BoolArray,
    FloatArray,
    IndexArray,
    Trajectory,
    encoder_count,
    position_noise,
)

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
#: Rows alike that are no rest, at most. Where a force is clear and stands still, position does as
#: well in this part at least; where it is clear, in the second at most. Rows so nearly at their
#: usual distance, in the last part of them, are those of another rate.
_MOST_ALIKE, _BOTH, _SELDOM, _NEARLY, _REGULAR = 3, 0.9, 0.5, 0.1, 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Restored:
    """A log with the time of the rows that it lost or has twice, or as it was."""

    trajectory: Trajectory
    code: str = "lost-rows"
    share: float = 0.0  # rows lost for each that is left, or repeated for each row
    doubt: float = 0.0  # deviation of the length of time, a part of it
    first: float = 0.0  # first loss or repeat, s
    rows: int = 0  # repeated

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


def lost_rows(trajectory: Trajectory, *, alone: bool = True) -> Iterator[Finding]:
    """``lost-rows`` and ``repeated-rows``, with no gap in time; put right of an axis alone."""
    found = restored(trajectory)
    if found.share == 0:
        return
    mends = found.usable and alone
    refused = found.share > _HARMLESS and not mends
    if found.code == "repeated-rows":
        doubted = "how many others are is not told" if alone else "of several axes they stay"
        done = "they are taken out" if mends else doubted
        yield Finding(
            code=found.code,
            severity="refusal" if refused else "warning",
            seen=f"{found.rows} rows of {trajectory.source}, {found.share:.1%} of the clear ones, "
            f"are equal to the row before in mid-motion, the first after {found.first:g} s; {done}",
            needed="each row once" if mends else f"at most {_HARMLESS:.1%}",
            remedy="Log each sample once, with the controller's own time or its counter of "
            "samples, and give that as time.",
            at=((found.first, found.first),),
        )
        return
    doubted = (
        "too few are clear to put time back" if alone else "of several axes time stays as it is"
    )
    done = "time is put back there" if mends else doubted
    yield Finding(
        code="lost-rows",
        severity="refusal" if refused else "warning",
        seen=f"{trajectory.source} steps twice as far as before and after, with no gap in time, in "
        f"{found.share:.1%} of its clear rows, the first after {found.first:g} s: rows were lost "
        f"and the others numbered anew; {done}",
        needed="no row lost" if mends else f"at most {_HARMLESS:.1%}",
        remedy="Log the controller's own time or its counter of samples with each row, and give "
        "it as time.",
        at=((found.first, found.first),),
    )


def restored(trajectory: Trajectory) -> Restored:
    """A log with even stamps and the time of its lost rows, if a clear column tells them."""
    step, place = trajectory.steps, trajectory.position
    if isinstance(step, np.ndarray):
        return Restored(trajectory=trajectory)
    once = _once(trajectory)
    if once is not None:
        return once
    noise = position_noise(place, trajectory.force, step)
    reads = _reads(trajectory, noise)
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


def _once(trajectory: Trajectory) -> Restored | None:
    """The log without the rows it has twice in mid-motion; None if it has none, or at a rate."""
    still = {name: np.diff(column) == 0 for name, column in trajectory.columns()}
    same = np.all([each for name, each in still.items() if name != "time"], axis=0)
    edges = np.flatnonzero(np.diff(same, prepend=False, append=False)).reshape(-1, 2)
    for first, end in edges[np.diff(edges)[:, 0] > _MOST_ALIKE]:  # at rest
        same[first:end] = False
    single = np.append(True, ~same)
    if np.count_nonzero(same) < _FEWEST_LONG or np.count_nonzero(single) < SHORTEST:
        return None
    left = _of_rows(trajectory, single, trajectory.time[: np.count_nonzero(single)])
    reads = _reads(left, position_noise(left.position, left.force, left.sample_time))
    # A force of another rate stands still where position may do so by its counts.
    count = encoder_count(left.force)
    rough = max(_roughness(left.force), 0.0 if count is None else count / np.sqrt(12.0))
    driven, rows = _read(left.force, rough)[0], np.cumsum(single) - 1
    held, place = driven & (np.diff(left.force) == 0), np.diff(left.position) == 0
    both = np.count_nonzero(driven[np.minimum(rows[:-1][same], driven.size - 1)])
    alone = np.count_nonzero(held) > (1 - _BOTH) * both
    if alone or np.count_nonzero(driven & place) > _SELDOM * np.count_nonzero(driven):
        driven = np.zeros_like(driven)
    told = _on_both_sides(reads[0][0]) | _on_both_sides(driven)
    again = same & told[rows[:-1]]
    out, lost = np.flatnonzero(again), np.max([each[1] for each in reads], axis=0)
    if out.size < max(_FEWEST_LONG, _SURE * np.count_nonzero(lost)):
        return None
    apart = np.diff(out)
    usual = float(np.median(apart))
    regular = np.mean(np.abs(apart - usual) <= max(_NEARLY * usual, 1.0)) > _REGULAR
    share, part = out.size / (out.size + np.count_nonzero(told)), float(np.mean(told))
    if regular or share > _MOST_LOST:
        return None
    found = Restored(
        trajectory=trajectory,
        code="repeated-rows",
        share=share,
        doubt=share / np.sqrt(out.size) * (1 - part),
        first=float(trajectory.time[out[0]]),
        rows=out.size,
    )
    if not found.usable:
        return found
    steps = np.where(again, 0.0, np.where(told[rows[:-1]], 1.0, 1 - share))
    time = trajectory.time[0] + trajectory.sample_time * np.append(0.0, np.cumsum(steps))
    kept = np.append(True, ~again)
    return replace(found, trajectory=_of_rows(trajectory, kept, time[kept]))


def _on_both_sides(clear: BoolArray) -> BoolArray:
    """Rows whose step before and step after are clear, shape (n,) of shape (n - 1,)."""
    return np.append(False, clear) & np.append(clear, False)


def _of_rows(trajectory: Trajectory, kept: BoolArray, time: FloatArray) -> Trajectory:
    """Some rows of a log, with other stamps."""
    columns = {name: column[kept] for name, column in trajectory.columns()}
    return replace(trajectory, **{**columns, "time": time})


def _reads(trajectory: Trajectory, noise: float) -> list[tuple[BoolArray, FloatArray, int]]:
    """What position, force and set-point say, in this order."""
    planned = [each for each in (trajectory.force, trajectory.reference) if each is not None]
    return [_read(trajectory.position, noise), *(_read(each, _roughness(each)) for each in planned)]


def _roughness(column: FloatArray) -> float:
    """Noise of a column that is smooth but for it, from the median of its fourth differences."""
    return float(max(np.median(np.abs(np.diff(column, 4))) / 5.64, 1e-12 * np.ptp(column)))


def _read(column: FloatArray, noise: float) -> tuple[BoolArray, FloatArray, int]:
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
    """Jumps a cubic leaves in the middle of its rows, its steps there, and noise of a jump."""
    row = np.arange(2 * beside) - beside + 0.5
    cubic = (row / beside) ** np.arange(4)[:, None]
    jump = np.linalg.pinv(np.vstack((cubic, np.sign(row) / 2)))[:, -1]
    step = np.linalg.pinv(cubic)[:, 1] / beside
    return np.correlate(place, jump), np.correlate(place, step), float(np.sqrt(jump @ jump))


def _jumps(place: FloatArray, noise: float, rows: IndexArray, lost: FloatArray) -> bool:
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
