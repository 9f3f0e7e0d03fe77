"""Trajectories: one log of several axes of a device that were driven together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.errors import UsageError
from identification.trajectory import Motion, Trajectory

#: Axes of one device at most: every pair has its entries in two matrices.
MOST_AXES = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectories:
    """Forces and positions of several axes over one time.

    Args:
        axes: the log of each axis, of one time, one kind of motion and names of their own.

    Raises:
        UsageError: fewer than two or more than six axes, axes of other kinds, names or times.
    """

    axes: tuple[Trajectory, ...]

    def __post_init__(self) -> None:
        if not 1 < len(self.axes) <= MOST_AXES:
            problem = f"{len(self.axes)} given"
            raise UsageError("axes", problem, f"Give two to {MOST_AXES} axes of one device")
        if len(set(self.names)) < len(self.axes):
            listed = ", ".join(self.names)
            raise UsageError("--axis", f"is {listed}", "Give each axis a name of its own")
        kinds = list(dict.fromkeys(each.motion or "not stated" for each in self.axes))
        if len(kinds) > 1:
            problem = f"the axes are {' and '.join(kinds)}"
            raise UsageError("--motion", problem, "Give linear axes together, or rotary ones")
        first = self.axes[0].time
        if any(not np.array_equal(each.time, first) for each in self.axes):
            raise UsageError("axes", "differ in their times", "Log all axes in one file")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(each.axis for each in self.axes)

    @property
    def axis(self) -> str:
        """Names of all axes, as one."""
        return ",".join(self.names)

    @property
    def motion(self) -> Motion | None:
        """Linear or rotary; None where nobody said it."""
        return self.axes[0].motion

    @property
    def digest(self) -> str:
        """Digest of the file the log comes from, or ""."""
        return self.axes[0].digest

    @property
    def read_as(self) -> str:
        """How a file that is no plain table in SI units was understood, or ""."""
        return self.axes[0].read_as

    @property
    def source(self) -> str:
        """Where the log comes from, for messages."""
        return self.axes[0].source

    def __len__(self) -> int:
        return len(self.axes[0])
