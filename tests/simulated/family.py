"""A family of logs: one device, one motion and one kind of imperfection, any number of seeds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Clock, Faults, Hand, Recording, Rig, Servo, simulate
from identification import Hardware, Trajectory

FloatArray = NDArray[np.float64]

#: Logs simulated at a time: 200 of 4 s at 1 kHz take some 50 MB.
_CHUNK = 200
#: What a family's truth states of its rig.
_TRUE = (
    "mass",
    "damping",
    "coulomb_friction",
    "force_offset",
    "damping_asymmetry",
    "stiffness",
    "gravity_sine",
    "gravity_cosine",
    "delay",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """What moves a device, noise apart."""

    force: FloatArray  # N (N·m), shape (1, n): all of it, or the feed-forward of the servo
    start: float  # position at t = 0, m (rad)
    servo: Servo | None = None  # that follows a logged reference


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Logs that differ by seed in their noise, their jitter and their lost rows only.

    So the scatter of an estimate over seeds is its statistical error and its mean is its bias.
    """

    name: str
    rig: Rig
    drive: Callable[[], Drive]
    faults: Faults
    hand: Hand | None = None
    clock: Clock | None = None
    hardware: Hardware | None = None  # stated beside a log; its delay where the family is about it

    @property
    def truth(self) -> Mapping[str, float]:
        """True values by the names of Rig; friction as the mean of both directions, SI units."""
        return MappingProxyType({key: float(getattr(self.rig, key)[0]) for key in _TRUE})

    def logs(self, seeds: Sequence[int]) -> list[Trajectory]:
        """One log a seed, the same whatever the other seeds; a log takes some 100 kB."""
        return [
            recording.trajectory(member)
            for recording in self.recordings(seeds)
            for member in range(recording.batch)
        ]

    def recordings(self, seeds: Sequence[int]) -> list[Recording]:
        """The same in chunks, lost rows included."""
        drive = self.drive()
        return [
            replace(
                simulate(
                    self.rig,
                    drive.force,
                    controller=drive.servo,
                    hand=self.hand,
                    faults=self.faults,
                    clock=self.clock,
                    seed=seeds[first : first + _CHUNK],
                    position=drive.start,
                ),
                source=f"simulated {self.name}",
            )
            for first in range(0, len(seeds), _CHUNK)
        ]
