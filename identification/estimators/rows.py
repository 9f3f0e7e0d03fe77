"""The equation of motion, once for each inner sample of a log: exact for any steps.

Row k is m·q̈ + b·q̇ + … = F multiplied by the triangle that is 1 at t[k] and 0 at both neighbours,
integrated and divided by the mean step. Integrated by parts, acceleration becomes the difference
of two slopes of position, velocity the difference of two means; a held force enters by its own
integral (Held.triangle). Any weighted sum of rows holds as well, so filters act on rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.estimators.noise import position_noise
from identification.estimators.zero_order_hold import Commands, mean_step
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: The first row belongs to this sample, ...
FIRST = 2
#: ... and as many samples at the end have none: means of position need both neighbours' bend.
LAST = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Kinematics:
    """Unfiltered rows of acceleration (m/s²) and velocity (m/s), shape (n - 4,) each."""

    acceleration: FloatArray
    velocity: FloatArray

    @classmethod
    def of(cls, position: FloatArray, steps: float | FloatArray) -> Kinematics:
        """Rows of a position.

        Args:
            position: m, shape (n,).
            steps: of the log, s: one number, or shape (n - 1,).
        """
        step = mean_step(steps)
        bend = np.diff(np.diff(position) / steps)
        # Mean position of an interval: the chord less what the motion bends away from it.
        between = (steps[1:] + steps[:-1]) / 2 if isinstance(steps, np.ndarray) else steps
        curved = bend / between
        bends = (curved[1:] + curved[:-1]) / 2
        inner = steps[1:-1] if isinstance(steps, np.ndarray) else steps
        mean = (position[1:-2] + position[2:-1]) / 2 - inner * inner / 12 * bends
        return cls(acceleration=bend[1:-1] / step, velocity=np.diff(mean) / step)


def of_rows(triangles: FloatArray) -> FloatArray:
    """Those of n - 2 triangles that have a row of kinematics.

    The triangles have shape (n - 2,), the answer has the shape (n - 4,) of the kinematics, in the
    unit of the triangles.
    """
    return triangles[FIRST - 1 : triangles.size - LAST + 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Signals:
    """What every estimator reads of one log.

    Attributes:
        steps: length of the intervals, s: one number if the log is even, else shape (n - 1,).
        step: their mean, s.
        position: m, shape (n,).
        commands: forces as logged.
        speed: mean velocity of each interval, m/s, shape (n - 1,).
        kinematics: rows of acceleration and velocity.
        noise: standard deviation of one position reading, m.
        reference: logged set-point, m, shape (n,); None if there is none, or it never moves.
    """

    steps: float | FloatArray
    step: float
    position: FloatArray
    commands: Commands
    speed: FloatArray
    kinematics: Kinematics
    noise: float
    reference: FloatArray | None

    @classmethod
    def of(cls, trajectory: Trajectory) -> Signals:
        """Signals of a log, time stamps as they are."""
        steps, position, reference = trajectory.steps, trajectory.position, trajectory.reference
        return cls(
            steps=steps,
            step=mean_step(steps),
            position=position,
            commands=Commands.of(trajectory.force, steps),
            speed=np.diff(position) / steps,
            kinematics=Kinematics.of(position - np.mean(position), steps),
            noise=position_noise(position, trajectory.force, steps),
            reference=None if reference is None or np.ptp(reference) == 0 else reference,
        )

    def part(self, samples: int) -> Signals:
        """Those of the first samples alone, read with the noise of all."""
        steps = self.steps[: samples - 1] if isinstance(self.steps, np.ndarray) else self.steps
        position, reference = self.position[:samples], self.reference
        return replace(
            self,
            steps=steps,
            step=mean_step(steps),
            position=position,
            commands=self.commands.part(samples),
            speed=self.speed[: samples - 1],
            kinematics=Kinematics.of(position - np.mean(position), steps),
            reference=None if reference is None else reference[:samples],
        )
