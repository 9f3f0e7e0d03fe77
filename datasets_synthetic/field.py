"""Position-dependent forces: a spring to ground, and gravity on a turning arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Resisting force k·q + gs·sin q + gc·cos q per unit mass; each array shape (batch,).

    Attributes:
        stiffness: k/m, 1/s².
        sine: gs/m, m/s² (rad/s²).
        cosine: gc/m, m/s² (rad/s²).
        curved: whether any sine or cosine is there.
    """

    stiffness: FloatArray
    sine: FloatArray
    cosine: FloatArray
    curved: bool

    @classmethod
    def of(
        cls,
        *,
        mass: FloatArray,
        stiffness: FloatArray,
        gravity_sine: FloatArray,
        gravity_cosine: FloatArray,
    ) -> Field | None:
        """The field of a batch of devices: kg, N/m, N, N, each shape (batch,); None if all zero."""
        curved = bool(np.any(gravity_sine) or np.any(gravity_cosine))
        if not curved and not np.any(stiffness):
            return None
        return cls(
            stiffness=stiffness / mass,
            sine=gravity_sine / mass,
            cosine=gravity_cosine / mass,
            curved=curved,
        )

    def at(self, position: FloatArray) -> FloatArray:
        """Resisting force per unit mass, m/s², at these positions (m), shape (..., batch)."""
        spring = self.stiffness * position
        if not self.curved:
            return spring
        return spring + self.sine * np.sin(position) + self.cosine * np.cos(position)

    def stored(self, position: FloatArray) -> FloatArray:
        """Energy per unit mass, m²/s², at these positions (m), shape (..., batch); zero at zero."""
        spring = 0.5 * self.stiffness * position**2
        if not self.curved:
            return spring
        return spring + self.sine * (1 - np.cos(position)) + self.cosine * np.sin(position)

    def members(self, which: NDArray[np.intp]) -> Field:
        """The field of these members, shape (members,)."""
        return Field(
            stiffness=self.stiffness[which],
            sine=self.sine[which],
            cosine=self.cosine[which],
            curved=self.curved,
        )

    def fastest(self) -> FloatArray:
        """Largest natural frequency anywhere, 1/s, shape (batch,).

        No slope of the field exceeds its square.
        """
        return np.sqrt(np.abs(self.stiffness) + np.hypot(self.sine, self.cosine))
