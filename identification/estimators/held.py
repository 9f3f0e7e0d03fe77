"""Columns that are held between samples: delayed force, direction of motion, a constant.

Interval k is [kT, (k+1)T); a log of n samples has n - 1 of them. Everything that acts on the
device is constant over an interval or changes once inside it, so the equation of motion can be
averaged and integrated exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """One value for a fraction of each interval, then another.

    Attributes:
        early: shape (n - 1,).
        late: shape (n - 1,).
        fraction: part of the interval that ``early`` lasts, 0 to 1, one number or shape (n - 1,).
    """

    early: FloatArray
    late: FloatArray
    fraction: float | FloatArray

    def mean(self) -> FloatArray:
        """Mean over each interval, shape (n - 1,)."""
        return self.late + self.fraction * (self.early - self.late)

    def triangle(self) -> FloatArray:
        """Mean over [(k-1)T, (k+1)T] with a triangular weight, shape (n - 2,), rows k = 1..n-2.

        That is what a second central difference of position makes of an acceleration, so mass
        times the one equals the other exactly for a pure mass, wherever inside the interval the
        value changes. Held over whole intervals it is (x[k] + x[k-1])/2.
        """
        d = self.fraction
        falling = (d - d * d / 2) * self.early + (1 - d) ** 2 / 2 * self.late
        rising = d * d / 2 * self.early + (1 - d * d) / 2 * self.late
        return falling[1:] + rising[:-1]

    def times(self, factor: FloatArray) -> Held:
        """The column times a factor for each interval, shape (n - 1,)."""
        return Held(early=self.early * factor, late=self.late * factor, fraction=self.fraction)

    def since(self, first: int) -> Held:
        """The column from one interval on."""
        fraction = self.fraction[first:] if isinstance(self.fraction, np.ndarray) else self.fraction
        return Held(early=self.early[first:], late=self.late[first:], fraction=fraction)


def delayed(force: FloatArray, samples: float) -> Held:
    """A logged force where it acts.

    Args:
        force: N, shape (n,), row k held from kT to (k+1)T at the controller.
        samples: delay in sample times, not negative, need not be whole. The first
            ``ceil(samples)`` intervals feel forces from before the log; they repeat its first row.
    """
    whole = int(np.floor(samples))
    index = np.arange(force.size - 1) - whole
    return Held(
        early=force[np.maximum(index - 1, 0)],
        late=force[np.maximum(index, 0)],
        fraction=samples - whole,
    )


def unknown_intervals(samples: float) -> int:
    """How many intervals at the start of a log feel forces from before it."""
    return int(np.ceil(samples))
