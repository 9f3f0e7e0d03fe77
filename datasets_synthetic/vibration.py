"""A vibration mode of a simulated mechanism."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import choose_members

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Vibration:
    """One mode of a mechanism that is not rigid; numbers, or arrays of shape (batch,).

    Its coordinate q obeys m·(q'' + 2·z·w·q' + w²·q) = e·Fa - h·Fh, with m the whole mass of the
    device, Fa the force of the actuator and Fh what the device does to the hand. The encoder reads
    the rigid coordinate and e·q, the handle is at the rigid coordinate and h·q. A motor m1 with
    its encoder and a handle m2 on a spring make one mode, e = √(m2/m1) and h = -√(m1/m2).

    Attributes:
        frequency_hz: w/2π, undamped, Hz.
        damping_ratio: z, not negative.
        at_encoder: e, without unit.
        at_handle: h, without unit.
    """

    frequency_hz: float | FloatArray
    damping_ratio: float | FloatArray
    at_encoder: float | FloatArray
    at_handle: float | FloatArray

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.frequency_hz) > 0):
            raise ValueError(f"frequency_hz of a mode must be positive, not {self.frequency_hz}")
        if not np.all(np.asarray(self.damping_ratio) >= 0):
            raise ValueError(f"damping_ratio must not be negative, not {self.damping_ratio}")

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, name)) for name in _FIELDS]

    def members(self, which: NDArray[np.intp]) -> Vibration:
        """The mode of these members, shape (members,); a value that all share stays a number."""
        return Vibration(**{name: choose_members(getattr(self, name), which) for name in _FIELDS})


_FIELDS = ("frequency_hz", "damping_ratio", "at_encoder", "at_handle")
