"""How far a residual is from white noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def whiteness(residual: FloatArray) -> float:
    """Largest distance of the cumulated periodogram from the straight line of white noise.

    0 is white, 1 is all power at one end of the spectrum (Bartlett's test: Bartlett, An
    Introduction to Stochastic Processes, 1966, section 9.3.2; chance alone exceeds 1.63/√(n/2)
    once in a hundred times).
    """
    power = np.abs(np.fft.rfft(residual)[1:]) ** 2
    total = float(np.sum(power))
    if total == 0:
        return 0.0
    line = np.arange(1, power.size + 1) / power.size
    return float(np.max(np.abs(np.cumsum(power) / total - line)))
