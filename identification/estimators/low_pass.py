"""The one low-pass that every column of a regression goes through, force included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.linear_filters import overlap_save

FloatArray = NDArray[np.float64]

#: The kernel ends after this many standard deviations, where it has fallen to 4e-6 of its peak:
#: the step there lets through less noise than the second difference amplifies.
REACH = 5.0


def gaussian(width: float, step: float) -> FloatArray:
    """Symmetric Gaussian weights that sum to 1, odd in number.

    Args:
        width: standard deviation, in the unit of ``step``; 0 gives the single weight 1.
        step: distance of two weights.
    """
    half = int(np.ceil(REACH * width / step))
    if half == 0:
        return np.ones(1)
    place = np.arange(-half, half + 1) * step / width
    weights = np.exp(-(place**2) / 2)
    return weights / weights.sum()


def width_of(cut_off: float) -> float:
    """Standard deviation in s of the Gaussian that passes 1/√2 of a sine at ``cut_off`` Hz."""
    return float(np.sqrt(np.log(2)) / (2 * np.pi * cut_off))


@dataclass(frozen=True, slots=True, kw_only=True)
class LowPass:
    """Zero-phase Gaussian filter without start or end effects.

    Its output is a weighted mean of input rows, so an equation that holds for every row holds
    for the filtered rows exactly; rows without a full set of neighbours are not returned.

    Attributes:
        cut_off: Hz, where a sine passes with 1/√2 of its amplitude.
        kernel: weights, shape (2·half + 1,).
    """

    cut_off: float
    kernel: FloatArray

    @classmethod
    def at(cls, cut_off: float, step: float) -> LowPass:
        """The filter for a cut-off in Hz and a sample time in s."""
        return cls(cut_off=cut_off, kernel=gaussian(width_of(cut_off), step))

    @property
    def half(self) -> int:
        """Rows lost at each end."""
        return self.kernel.size // 2

    def __call__(self, column: FloatArray) -> FloatArray:
        """The filtered column, shape (..., n) to (..., n - 2·half)."""
        return overlap_save(column, self.kernel)
