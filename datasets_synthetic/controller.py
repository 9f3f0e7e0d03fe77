"""What closes the loop of a simulated device: virtual effects, or a servo on a reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Controller:
    """Virtual effects about position zero; numbers, or arrays of shape (batch,).

    Attributes:
        stiffness: K, N/m (N·m/rad).
        damping: B, N·s/m (N·m·s/rad), on the backward difference of the measured position.
        mass: M, kg (kg·m²), on the double backward difference.
        velocity_cutoff: fc of the velocity filter, Hz; infinite means no filter.
        acceleration_cutoff: fc of the acceleration filter, Hz; infinite means no filter.

    A filtered velocity is (1-a)(z-1)/(T(z-a)) with a = exp(-2π·fc·T), a filtered acceleration the
    square of the same expression with its own fc. Both start from rest at the first reading.
    """

    stiffness: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    mass: float | FloatArray = 0.0
    velocity_cutoff: float | FloatArray = np.inf
    acceleration_cutoff: float | FloatArray = np.inf

    def size(self) -> int:
        """Number of members the gains and cut-offs describe."""
        return np.broadcast(
            self.stiffness, self.damping, self.mass, self.velocity_cutoff, self.acceleration_cutoff
        ).size


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """Drives the device along a logged reference: F = kp·(r - q) - kd·(filtered velocity) + feed.

    The feed-forward is the force given to ``simulate``.

    Attributes:
        reference: r at each sample, m (rad), shape (n,) or (batch, n).
        stiffness: kp, N/m (N·m/rad), a number or shape (batch,).
        damping: kd, N·s/m (N·m·s/rad), a number or shape (batch,), on the velocity that
            ``Controller`` describes.
        velocity_cutoff: of its filter, Hz; infinite means no filter.
    """

    reference: FloatArray
    stiffness: float | FloatArray
    damping: float | FloatArray = 0.0
    velocity_cutoff: float | FloatArray = np.inf

    def regulator(self) -> Controller:
        """The part that looks at the position alone; kp·r is added to its force."""
        return Controller(
            stiffness=self.stiffness, damping=self.damping, velocity_cutoff=self.velocity_cutoff
        )

    def size(self) -> int:
        """Number of members it describes."""
        return max(np.atleast_2d(self.reference).shape[0], self.regulator().size())


class ControlLaw:
    """A Controller at work: one call a sample, remembering what its filters need."""

    __slots__ = (
        "_acceleration",
        "_acceleration_pole",
        "_controller",
        "_last",
        "_sample_time",
        "_slope",
        "_velocity",
        "_velocity_pole",
    )

    def __init__(self, controller: Controller, sample_time: FloatArray) -> None:
        self._controller = controller
        self._sample_time = sample_time
        self._velocity_pole = np.exp(-2 * np.pi * controller.velocity_cutoff * sample_time)
        self._acceleration_pole = np.exp(-2 * np.pi * controller.acceleration_cutoff * sample_time)
        self._last: FloatArray | None = None
        self._velocity = self._slope = self._acceleration = np.zeros_like(sample_time)

    def force(self, reading: FloatArray) -> FloatArray:
        """-(K·q + B·velocity + M·acceleration) for this sample's reading (m), N, shape (batch,)."""
        change = 0.0 if self._last is None else (reading - self._last) / self._sample_time
        self._last = reading
        pole = self._velocity_pole
        self._velocity = pole * self._velocity + (1 - pole) * change
        pole = self._acceleration_pole
        slope = pole * self._slope + (1 - pole) * change
        change_of_slope = (slope - self._slope) / self._sample_time
        self._acceleration = pole * self._acceleration + (1 - pole) * change_of_slope
        self._slope = slope
        gains = self._controller
        return -(
            gains.stiffness * reading
            + gains.damping * self._velocity
            + gains.mass * self._acceleration
        )
