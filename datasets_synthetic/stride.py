"""Runge-Kutta over the steps of one part of a sample, as the linear map it is without reversals.

For dv/dt = drive - p·v - k·x, dx/dt = v with a held drive a classical fourth-order Runge-Kutta step
is a fixed linear map of position, velocity and drive. It is run here on the unit vectors once; the
map serves at every sample. What is kept is the change, the map less one, so that slow motion loses
no digits beside one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: (position, velocity, drive) to (travel, gain of velocity) over one step; arrays (..., batch).
Step = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stride:
    """Travel and gain of velocity over some steps as weighted sums; weights of shape (batch,).

    Attributes:
        travel: weights of velocity and drive, per step (s, s²).
        gain: likewise (1, s).
        pulled: weights of the position in both; None where no force depends on it.
    """

    travel: tuple[FloatArray, FloatArray]
    gain: tuple[FloatArray, FloatArray]
    pulled: tuple[FloatArray, FloatArray] | None

    @classmethod
    def of(cls, step: Step, steps: int, batch: int, *, in_field: bool) -> Stride:
        """Of so many steps one after the other, run on the unit vectors.

        Args:
            step: one step, linear in its three arguments.
            steps: how many.
            batch: number of devices.
            in_field: whether the position makes a difference.
        """
        place, speed, drive = np.repeat(np.eye(3)[:, :, None], batch, axis=2)
        moved, gained = np.zeros_like(place), np.zeros_like(speed)
        for _ in range(steps):
            travel, gain = step(place + moved, speed + gained, drive)
            moved, gained = moved + travel, gained + gain
        return cls(
            travel=(moved[1], moved[2]),
            gain=(gained[1], gained[2]),
            pulled=(moved[0], gained[0]) if in_field else None,
        )

    def changes(
        self, position: FloatArray, velocity: FloatArray, drive: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Travel (m) and gain of velocity (m/s) from here, the drive (m/s²) held."""
        travel = self.travel[0] * velocity + self.travel[1] * drive
        gain = self.gain[0] * velocity + self.gain[1] * drive
        if self.pulled is None:
            return travel, gain
        return travel + self.pulled[0] * position, gain + self.pulled[1] * position
