"""The one low-pass that every column of a regression goes through, force included."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identification.estimators.linear_filters import Spectra, overlap_save

FloatArray = NDArray[np.float64]

#: The kernel ends after this many standard deviations, where it has fallen to 4e-6 of its peak:
#: the step there lets through less noise than the second difference amplifies.
REACH = 5.0


def gaussian(width: float, step: float) -> FloatArray:
    """Symmetric Gaussian weights that sum to 1, odd in number.

    The weights have shape (2k + 1,) and no unit.

    Args:
        width: standard deviation, s; 0 gives the single weight 1.
        step: distance of two weights, s.
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
        kernel: weights, shape (2·half + 1,).
        spectra: of the kernel, by length of block.
    """

    kernel: FloatArray
    spectra: Spectra = field(default_factory=Spectra)

    @classmethod
    def at(cls, cut_off: float, step: float) -> LowPass:
        """The filter for a cut-off in Hz, where a sine keeps 1/√2, and a sample time in s."""
        return cls(kernel=gaussian(width_of(cut_off), step))

    @property
    def half(self) -> int:
        """Rows lost at each end."""
        return self.kernel.size // 2

    def __call__(self, columns: FloatArray) -> FloatArray:
        """The filtered columns, shape (..., n) to (..., n - 2·half)."""
        return overlap_save(columns, self.kernel, self.spectra)

    def continued(self, column: FloatArray) -> FloatArray:
        """The filtered column, shape (n,); its ends go on by odd reflection, which keeps slopes."""
        half = self.half
        if half == 0:
            return column
        return self(np.pad(column, half, mode="reflect", reflect_type="odd"))

    def noise_gains(self, step: float) -> tuple[float, float]:
        """Variance of filtered second and central differences per variance of the readings.

        Args:
            step: between readings, s; the gains are 1/s⁴ and 1/s².
        """
        second = np.convolve(self.kernel, [1.0, -2.0, 1.0]) / step**2
        central = np.convolve(self.kernel, [0.5, 0.0, -0.5]) / step
        return float(second @ second), float(central @ central)
