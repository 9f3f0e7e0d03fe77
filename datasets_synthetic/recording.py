"""What a simulation leaves behind: the logs of a batch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from identification import Trajectory

FloatArray = NDArray[np.float64]
Motion = Literal["linear", "rotary"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """True motion at the samples; arrays read-only, shape (batch, n).

    Attributes:
        handle: where the handle is, m (rad).
        speed: of the handle, m/s (rad/s).
        energy: of motion, springs and gravity, the hand's included, J.
    """

    handle: FloatArray
    speed: FloatArray
    energy: FloatArray

    @classmethod
    def of(cls, handle: FloatArray, speed: FloatArray, energy: FloatArray) -> Truth:
        """From each at each sample, shape (n, batch)."""
        return cls(
            handle=read_only_copy(handle.T),
            speed=read_only_copy(speed.T),
            energy=read_only_copy(energy.T),
        )

    def members(self, which: slice) -> Truth:
        """The truth of these members."""
        return Truth(handle=self.handle[which], speed=self.speed[which], energy=self.energy[which])


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Logs of a batch; arrays read-only. Rows that were lost from a log are still in the arrays.

    Attributes:
        sample_time: s, shape (batch,); the mean step where stamps are uneven.
        force: as commanded after the limit and before the delay, N (N·m), shape (batch, n).
        position: as the encoder reads it, m (rad), shape (batch, n).
        axis: name of the axis.
        motion: "linear" or "rotary".
        source: where the recording comes from, for messages.
        stamps: true instants of uneven samples, s, shape (batch, n), or None for even ones.
        reference: what a servo followed, m (rad), shape (batch, n), or None.
        kept: which rows reached the log, shape (batch, n), or None for all.
        truth: the true motion, where it was watched.
    """

    sample_time: FloatArray
    force: FloatArray
    position: FloatArray
    axis: str = "x"
    motion: Motion = "linear"
    source: str = "simulated"
    stamps: FloatArray | None = None
    reference: FloatArray | None = None
    kept: NDArray[np.bool_] | None = None
    truth: Truth | None = None

    @property
    def batch(self) -> int:
        """Number of logs."""
        return self.sample_time.size

    @property
    def time(self) -> FloatArray:
        """True instants of the samples, s, shape (batch, n)."""
        if self.stamps is not None:
            return self.stamps
        return self.sample_time[:, None] * np.arange(self.force.shape[1], dtype=np.float64)

    def instants(self, member: int) -> FloatArray:
        """True instants of the samples of one member, s, shape (n,)."""
        if self.stamps is not None:
            return self.stamps[member]
        step = float(self.sample_time[member])
        return step * np.arange(self.force.shape[1], dtype=np.float64)

    def members(self, which: slice) -> Recording:
        """The logs of these members."""

        def of(array: NDArray[Any] | None) -> NDArray[Any] | None:
            return None if array is None else array[which]

        return replace(
            self,
            sample_time=self.sample_time[which],
            force=self.force[which],
            position=self.position[which],
            stamps=of(self.stamps),
            reference=of(self.reference),
            kept=of(self.kept),
            truth=None if self.truth is None else self.truth.members(which),
        )

    def trajectory(self, member: int = 0) -> Trajectory:
        """The log of one member. Raises LogRefusedError if it is no log (too short, diverged)."""
        rows = slice(None) if self.kept is None else self.kept[member]
        return Trajectory(
            time=self.instants(member)[rows],
            force=self.force[member][rows],
            position=self.position[member][rows],
            reference=None if self.reference is None else self.reference[member][rows],
            axis=self.axis,
            motion=self.motion,
            source=self.source,
        )


def read_only_copy(array: FloatArray) -> FloatArray:
    """A read-only contiguous copy.

    Any shape and unit.
    """
    copy = np.array(array, order="C")
    copy.setflags(write=False)
    return copy
