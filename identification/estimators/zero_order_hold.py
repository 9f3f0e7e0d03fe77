"""Columns under a zero-order hold: delayed force, direction of motion, a constant.

Interval k is [t[k], t[k+1]); a log of n samples has n - 1 of them, of any lengths. Everything that
acts on the device is constant over an interval but for jumps inside it, so the equation of motion
can be averaged and integrated exactly. One file: a held column, and the commands that it is made
of.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

#: A step longer than this many median steps has lost a sample.
LOST = 1.5
#: A delay this part of a sample beyond whole ones is whole: the rest is rounding of the stamps.
_HARDLY = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldColumn:
    """A column that is constant over each interval but for jumps.

    Attributes:
        steps: length of the intervals, s: one number, or shape (n - 1,).
        level: value at the start of each interval, shape (n - 1,).
        change: size of each jump, shape (j,); none if empty.
        left: time from each jump to the end of its interval, s: one number, or shape (j,).
        interval: interval of each jump, shape (j,); None means one jump in every interval.
    """

    steps: float | FloatArray
    level: FloatArray
    change: FloatArray
    left: float | FloatArray
    interval: IndexArray | None

    @classmethod
    def constant(cls, level: FloatArray, steps: float | FloatArray) -> HeldColumn:
        """One value for each interval, shape (n - 1,), without jumps."""
        nothing = np.zeros(0)
        return cls(
            steps=steps,
            level=level,
            change=nothing,
            left=nothing,
            interval=np.zeros(0, dtype=np.intp),
        )

    @classmethod
    def turning(
        cls, early: FloatArray, late: FloatArray, fraction: FloatArray, steps: float | FloatArray
    ) -> HeldColumn:
        """``early`` for a fraction of each interval, then ``late``; all of shape (n - 1,)."""
        jumps = np.flatnonzero((early != late) & (fraction > 0) & (fraction < 1))
        lengths = np.broadcast_to(np.asarray(steps), early.shape)[jumps]
        return cls(
            steps=steps,
            level=np.where(fraction > 0, early, late),
            change=(late - early)[jumps],
            left=(1 - fraction[jumps]) * lengths,
            interval=jumps,
        )

    def added(self, weight: FloatArray | float) -> FloatArray:
        """Sum over the jumps of each interval of change times weight, shape (n - 1,)."""
        total = self.change * weight
        if self.interval is None:
            return total
        sums = np.bincount(self.interval, total, minlength=self.level.size)
        return sums.astype(np.float64, copy=False)

    def mean(self) -> FloatArray:
        """Mean over each interval, shape (n - 1,)."""
        return self.level + self.added(self.left) / self.steps if self.change.size else self.level

    def triangle(self) -> FloatArray:
        """Integral over a triangle about each inner sample by the mean step, shape (n - 2,).

        The triangle is 1 at its sample and 0 at both neighbours. That is what the difference of
        two slopes of position makes of an acceleration, so mass times the one equals the other
        exactly for a pure mass, wherever the jumps are. Held evenly it is (x[k] + x[k-1])/2.
        """
        half = self.level * self.steps / 2
        if not self.change.size:
            falling = rising = half
        else:
            square = self.left * self.left / 2
            after = self.added(square) / self.steps
            falling = half + after
            rising = half + self.added(self.left) - after
        return (falling[1:] + rising[:-1]) / mean_step(self.steps)

    def times(self, factor: FloatArray) -> HeldColumn:
        """The column times a factor for each interval, shape (n - 1,)."""
        of_jump = factor if self.interval is None else factor[self.interval]
        return replace(self, level=self.level * factor, change=self.change * of_jump)


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """The forces a controller sent during one log.

    Attributes:
        steps: length of the intervals of the log, s: one number, or shape (n - 1,).
        value: N, shape (c,); with even steps one for each of the n samples.
        sent: when each was sent, s after the first sample, shape (c,); None with even steps.
    """

    steps: float | FloatArray
    value: FloatArray
    sent: FloatArray | None

    @classmethod
    def of(cls, force: FloatArray, steps: float | FloatArray) -> Commands:
        """Commands of a log: row k was sent at t[k] and is held until the next is sent.

        Forces, in N, have shape (n,); steps, in s, are one number, or have shape (n - 1,). A step
        LOST times the median or more has lost rows. The controller sent forces there that nobody
        wrote down; they are taken to lie on the straight line between their neighbours.
        """
        if not isinstance(steps, np.ndarray):
            return cls(steps=steps, value=force, sent=None)
        sent = np.concatenate(([0.0], np.cumsum(steps)))
        usual = float(np.median(steps))
        pieces = np.where(steps > LOST * usual, np.rint(steps / usual), 1.0).astype(np.intp)
        if np.all(pieces == 1):
            return cls(steps=steps, value=force, sent=sent)
        row = np.repeat(np.arange(steps.size), pieces)
        first = np.repeat(np.cumsum(pieces) - pieces, pieces)
        part = (np.arange(row.size) - first) / pieces[row]
        return cls(
            steps=steps,
            value=np.append(force[row] + part * (force[row + 1] - force[row]), force[-1]),
            sent=np.append(sent[row] + part * steps[row], sent[-1]),
        )

    def part(self, samples: int) -> Commands:
        """Those of the first samples of the log."""
        if not isinstance(self.steps, np.ndarray) or self.sent is None:
            return replace(self, value=self.value[:samples])
        steps = self.steps[: samples - 1]
        count = int(np.searchsorted(self.sent, np.sum(steps), side="right"))
        return Commands(steps=steps, value=self.value[:count], sent=self.sent[:count])

    def after(self, delay: float) -> HeldColumn:
        """The forces where they act, a delay in s later, not negative, need not be whole steps.

        The first ``unknown_intervals`` feel forces from before the log; they repeat its first.
        """
        if not isinstance(self.steps, np.ndarray) or self.sent is None:
            steps = mean_step(self.steps)
            whole, fraction = _split(delay, steps)
            before = np.full(whole + 1, self.value[0])
            padded = np.concatenate((before, self.value))[: self.value.size]
            late, early = padded[1:], padded[:-1]
            if fraction == 0:
                return HeldColumn.constant(late, steps)
            return HeldColumn(
                steps=steps, level=early, change=late - early, left=steps - fraction, interval=None
            )
        time = np.concatenate(([0.0], np.cumsum(self.steps)))
        arrival = self.sent + delay
        # Those that act from before an interval, or from its very start, make its level.
        acting = np.searchsorted(arrival, time[:-1], side="right") - 1
        interval = np.searchsorted(time, arrival, side="right") - 1
        inside = interval < self.steps.size
        inside[inside] = arrival[inside] > time[interval[inside]]
        inside[0] = False
        interval = interval[inside]
        return HeldColumn(
            steps=self.steps,
            level=self.value[np.maximum(acting, 0)],
            change=np.diff(self.value, prepend=self.value[0])[inside],
            left=time[interval + 1] - arrival[inside],
            interval=interval.astype(np.intp),
        )


def even_taps(delay: float, step: float) -> tuple[int, tuple[float, float, float]]:
    """How a triangle sees a force that is held evenly and delayed (Held.triangle).

    Args:
        delay: s.
        step: s.

    Returns:
        Whole samples of the delay, and the weights of the force sent so long before the sample,
        one sample earlier and two earlier.
    """
    whole, fraction = _split(delay, step)
    left = 1 - fraction / step
    return whole, (left * left / 2, 0.5 + left - left * left, (1 - left) ** 2 / 2)


def mean_step(steps: float | FloatArray) -> float:
    """Mean length of the intervals of a log, s.

    The steps have shape (n - 1,), s, or are one value for all.
    """
    return float(np.mean(steps)) if isinstance(steps, np.ndarray) else steps


def _split(delay: float, step: float) -> tuple[int, float]:
    """Whole samples of a delay, and what is left of it, s."""
    whole = int(np.floor(delay / step))
    return whole, delay - whole * step


def unknown_intervals(steps: float | FloatArray, delay: float) -> int:
    """How many intervals at the start of a log feel forces from before it.

    The steps have shape (n - 1,), s, or are one value for all; the delay is in s.
    """
    if not isinstance(steps, np.ndarray):
        return int(np.ceil(delay / steps - _HARDLY))
    return int(np.searchsorted(np.cumsum(steps), delay)) + 1 if delay > 0 else 0
