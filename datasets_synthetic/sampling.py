"""Delay and encoder: what stands between a continuous device and its controller."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.motion import steps_needed

FloatArray = NDArray[np.float64]

#: A delay within this fraction of a sample of a whole number of samples counts as that number:
#: 0.003/0.001 is not 3 in binary.
_WHOLE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A part of every sample interval over which the acting force is constant.

    Attributes:
        lag: samples between the command that acts and now, shape (batch,).
        steps: number of integration steps.
        step: length of one, s, shape (batch,).
    """

    lag: NDArray[np.int64]
    steps: int
    step: FloatArray


def pieces(
    delay: FloatArray, sample_time: FloatArray, rate: FloatArray, largest_step: float
) -> Iterator[Piece]:
    """The older command up to the instant the newer one arrives, then the newer one.

    Args:
        delay: s, shape (batch,); the part beyond whole samples sets the instant of arrival.
        sample_time: T, s, shape (batch,).
        rate: b/m, 1/s, shape (batch,).
        largest_step: largest |step·rate| of one integration step, without unit.
    """
    whole = np.floor(delay / sample_time + _WHOLE).astype(np.int64)
    arrival = delay - whole * sample_time
    arrival = np.where(arrival <= _WHOLE * sample_time, 0.0, arrival)
    for lag, duration in ((whole + 1, arrival), (whole, sample_time - arrival)):
        if np.any(duration > 0):
            steps = steps_needed(duration, rate, largest_step)
            yield Piece(lag=lag, steps=steps, step=duration / steps)


class Encoder:
    """Positions rounded to whole counts, half to even; exact where the resolution is zero."""

    __slots__ = ("_count", "_exact")

    def __init__(self, resolution: FloatArray) -> None:
        """Resolution in m (rad), shape (batch,)."""
        exact = resolution == 0
        self._exact = exact if exact.any() else None
        self._count = np.where(exact, 1.0, resolution)

    def read(self, position: FloatArray) -> FloatArray:
        """The readings of these positions, m (rad), shape (batch,)."""
        rounded = np.rint(position / self._count) * self._count
        return rounded if self._exact is None else np.where(self._exact, position, rounded)
