"""The columns of a log before anything has looked at them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Recording
from datasets_synthetic.device import Motion
from identification import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class RawLog:
    """Columns that need not make a Trajectory; arrays of one length, SI unless a fault says so."""

    time: FloatArray
    force: FloatArray
    position: FloatArray
    reference: FloatArray | None = None
    motion: Motion = "linear"

    @classmethod
    def of(cls, recording: Recording, member: int = 0) -> RawLog:
        """The log of one member of a recording, without the rows it lost."""
        rows = slice(None) if recording.kept is None else recording.kept[member]
        reference = recording.reference
        return cls(
            time=recording.time[0 if len(recording.time) == 1 else member][rows],
            force=recording.force[member][rows],
            position=recording.position[member][rows],
            reference=None if reference is None else reference[member][rows],
            motion=recording.motion,
        )

    def trajectory(self, source: str = "log") -> Trajectory:
        """The same as a Trajectory. Raises LogRefusedError where the columns are no log."""
        return Trajectory(
            time=self.time,
            force=self.force,
            position=self.position,
            reference=self.reference,
            motion=self.motion,
            source=source,
        )

    def rows(self, which: slice | NDArray[np.bool_]) -> RawLog:
        """Some of the rows."""
        return replace(
            self,
            time=self.time[which],
            force=self.force[which],
            position=self.position[which],
            reference=None if self.reference is None else self.reference[which],
        )
