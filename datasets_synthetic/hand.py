"""A hand that holds the device while it is logged, which the log does not say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import choose_members
from datasets_synthetic.noise import Sources, band_noise

FloatArray = NDArray[np.float64]

#: Physiological tremor of hand and forearm, Hz (R. J. Elble, W. C. Koller, Tremor, 1990).
TREMOR_BAND = (8.0, 12.0)
#: Voluntary motion of a hand that is not tracking anything fast, Hz.
WANDER_BAND = (0.1, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """Mass, damper and spring that move with the handle; numbers, or arrays of shape (batch,).

    The spring and the damper are fixed to ground, the spring at the rest position.

    Attributes:
        mass: of the hand, kg (kg·m²), added to that of the device.
        damping: N·s/m (N·m·s/rad).
        stiffness: N/m (N·m/rad).
        rest: where the spring is relaxed, m (rad).
        tremor: rms of an unlogged force of 8 to 12 Hz, held one sample, N (N·m).
        wander: rms of a slow voluntary motion of the rest position, 0.1 to 1 Hz, m (rad).
    """

    mass: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    stiffness: float | FloatArray = 0.0
    rest: float | FloatArray = 0.0
    tremor: float | FloatArray = 0.0
    wander: float | FloatArray = 0.0

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, name)) for name in _FIELDS]

    def members(self, which: NDArray[np.intp]) -> Hand:
        """The hands on these members, shape (members,); a value that all share stays a number."""
        return Hand(**{name: choose_members(getattr(self, name), which) for name in _FIELDS})

    def push(self, sources: Sources, stamps: FloatArray) -> FloatArray | None:
        """Force of tremor and voluntary motion (its spring at zero apart), N, shape (n, batch).

        None where both are nothing.
        """

        def column(values: float | FloatArray) -> FloatArray:
            return np.broadcast_to(np.asarray(values, dtype=np.float64), stamps.shape[1:])

        moved = column(self.stiffness) * column(self.wander)
        tremor = band_noise(sources, "tremor", column(self.tremor), TREMOR_BAND, stamps)
        wander = band_noise(sources, "wander", moved, WANDER_BAND, stamps)
        parts = [part for part in (tremor, wander) if part is not None]
        return sum(parts[1:], start=parts[0]) if parts else None


_FIELDS = ("mass", "damping", "stiffness", "rest", "tremor", "wander")
