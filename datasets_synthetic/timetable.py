"""Timetable: which command acts on each device in each part of every sample interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.motion import steps_needed
from datasets_synthetic.sampling import pieces

FloatArray = NDArray[np.float64]

#: A command that arrives within this fraction of a sample of a stamp arrives at it: sums of
#: steps carry rounding.
_AT_ONCE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of one sample interval over which the acting force is constant.

    Attributes:
        place: where in the flat list of commands (row by row, one member after the other) the
            force of each member stands, shape (batch,).
        steps: number of integration steps.
        step: length of one, s, shape (batch,); zero for a member that has no such part.
        kind: parts of the same kind have the same steps; None where every part differs.
    """

    place: NDArray[np.int64]
    steps: int
    step: FloatArray
    kind: int | None = None


class Timetable(Protocol):
    """The parts of every sample interval."""

    @property
    def lead(self) -> int:
        """Rows of zero force before the first command."""
        ...

    def parts(self, sample: int) -> Sequence[Part]:
        """The parts of the interval that starts at this sample."""
        ...


class EvenTimetable:
    """Every interval alike: the older command up to the arrival of the newer one, then that."""

    __slots__ = ("_batch", "_first", "lead")

    def __init__(
        self, delay: FloatArray, sample_time: FloatArray, rate: FloatArray, largest_step: float
    ) -> None:
        """Delay and sample time in s, rate in 1/s, each shape (batch,)."""
        self._batch = delay.size
        found = tuple(pieces(delay, sample_time, rate, largest_step))
        self.lead = max(int(piece.lag.max()) for piece in found)
        members = np.arange(self._batch) + self.lead * self._batch
        self._first = [
            (members - piece.lag * self._batch, piece.steps, piece.step) for piece in found
        ]

    def parts(self, sample: int) -> Sequence[Part]:
        """The parts of the interval that starts at this sample."""
        gone = sample * self._batch
        return [
            Part(place=first + gone, steps=steps, step=step, kind=kind)
            for kind, (first, steps, step) in enumerate(self._first)
        ]


class UnevenTimetable:
    """Intervals that differ: the command of stamp j acts from stamp j + delay to the next one."""

    __slots__ = ("_place", "_step", "_steps", "lead")

    def __init__(
        self, delay: FloatArray, stamps: FloatArray, rate: FloatArray, largest_step: float
    ) -> None:
        """Delay in s and rate in 1/s, shape (batch,); stamps in s, shape (n, batch)."""
        samples, batch = stamps.shape
        self.lead = 1
        ends = np.concatenate((stamps[1:], 2 * stamps[-1:] - stamps[-2:-1]))
        found = [
            _acting(stamps[:, member], ends[:, member], float(delay[member]))
            for member in range(batch)
        ]
        most = max(command.shape[0] for command, _ in found)
        rows = np.zeros((most, samples, batch), dtype=np.int64)
        durations = np.zeros((most, samples, batch))
        for member, (command, duration) in enumerate(found):
            rows[: command.shape[0], :, member] = command + self.lead
            durations[: duration.shape[0], :, member] = duration
        self._place: NDArray[np.int64] = rows * batch + np.arange(batch, dtype=np.int64)
        self._steps = [steps_needed(part, rate, largest_step) for part in durations]
        self._step = durations / np.array(self._steps)[:, None, None]

    def parts(self, sample: int) -> Sequence[Part]:
        """The parts of the interval that starts at this sample."""
        return [
            Part(place=place[sample], steps=steps, step=step[sample])
            for place, steps, step in zip(self._place, self._steps, self._step, strict=True)
        ]


def _acting(
    starts: FloatArray, ends: FloatArray, delay: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Command that acts (-1: none yet) and for how long (s), each shape (parts, n), one member."""
    arrivals = np.concatenate(([-np.inf], starts + delay, [np.inf]))  # of command j at place j + 1
    at_once = _AT_ONCE * (ends - starts)
    first = np.searchsorted(arrivals, starts + at_once, side="right") - 1
    last = np.searchsorted(arrivals, ends - at_once, side="left") - 1
    part = np.arange(int(np.max(last - first)) + 1)[:, None]
    acting = np.minimum(first + part, last)
    begins = np.where(part == 0, starts, np.maximum(arrivals[acting], starts))
    finishes = np.where(acting == last, ends, arrivals[acting + 1])
    there = first + part <= last
    return acting - 1, np.where(there, finishes - begins, 0.0)
