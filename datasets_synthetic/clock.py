"""When a device is sampled, and which of its samples reach the log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.noise import Sources

FloatArray = NDArray[np.float64]

#: Jitter is cut at this part of the shortest step, so that stamps never meet.
_FURTHEST = 0.45


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """Uneven sampling and lost rows; the log carries the true stamps.

    The device is read, and its force renewed, at the uneven instants themselves. Rows are lost from
    the log only: the loop ran at every sample.

    Attributes:
        steps: lengths of the steps, s, taken in turn, over and over; empty means the rig's
            sample time at every step.
        jitter: rms of each stamp about its even place, normal, cut at 45 % of the shortest step,
            s, a number or shape (batch,). It does not add up; the first stamp is 0.
        dropped: probability of each row but the first and the last to be lost, 0 to below 1, a
            number or shape (batch,).
    """

    steps: tuple[float, ...] = ()
    jitter: float | FloatArray = 0.0
    dropped: float | FloatArray = 0.0

    def __post_init__(self) -> None:
        if any(step <= 0 for step in self.steps):
            raise ValueError(f"steps of a clock must be positive, not {self.steps}")
        if np.any(np.asarray(self.jitter) < 0):
            raise ValueError(f"jitter must not be negative, not {self.jitter}")
        lost = np.asarray(self.dropped)
        if np.any((lost < 0) | (lost >= 1)):
            raise ValueError(f"dropped must be at least 0 and less than 1, not {self.dropped}")

    @property
    def even(self) -> bool:
        """Whether every step is the rig's sample time."""
        return not self.steps and not np.any(self.jitter)

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(self.jitter), np.size(self.dropped)]

    def nominal(self, sample_time: FloatArray) -> FloatArray:
        """Mean step, s, shape (batch,): what the filters of a controller are made for."""
        return np.full_like(sample_time, np.mean(self.steps)) if self.steps else sample_time

    def stamps(self, sample_time: FloatArray, samples: int, sources: Sources) -> FloatArray:
        """True stamps, s, shape (samples, batch), from zero and increasing."""
        if self.steps:
            turns = np.resize(np.asarray(self.steps, dtype=np.float64), samples)
            places = np.concatenate(([0.0], np.cumsum(turns)[:-1]))
            stamps = np.repeat(places[:, None], sample_time.size, axis=1)
            shortest = np.full_like(sample_time, min(self.steps))
        else:
            stamps = np.arange(samples, dtype=np.float64)[:, None] * sample_time
            shortest = sample_time
        jitter = np.broadcast_to(np.asarray(self.jitter, dtype=np.float64), sample_time.shape)
        if not np.any(jitter):
            return stamps
        for member, source in enumerate(sources.generators("clock")):
            if jitter[member] > 0:
                bound = _FURTHEST * shortest[member]
                moved = np.clip(jitter[member] * source.standard_normal(samples), -bound, bound)
                stamps[1:, member] += moved[1:]
        return stamps

    def kept(self, batch: int, samples: int, sources: Sources) -> NDArray[np.bool_] | None:
        """Which rows reach the log, shape (batch, samples); None if all of them do."""
        dropped = np.broadcast_to(np.asarray(self.dropped, dtype=np.float64), (batch,))
        if not np.any(dropped):
            return None
        generators = sources.generators("rows")
        rows = np.stack([each.random(samples) for each in generators]) >= dropped[:, None]
        rows[:, [0, -1]] = True
        return rows
