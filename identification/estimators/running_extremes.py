"""Running extremes: over a window about each sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def running_maximum(column: FloatArray, width: int) -> FloatArray:
    """Largest of the ``width`` samples about each one, fewer at the ends; shape (n,) to (n,).

    Maxima of two neighbouring spans make one of twice the span, so the cost goes with log(width).

    Args:
        column: shape (n,).
        width: samples, odd.
    """
    outside = np.full(width // 2, -np.inf)
    largest, span = np.concatenate((outside, column, outside)), 1
    while 2 * span <= width:
        largest = np.maximum(largest[:-span], largest[span:])
        span *= 2
    last = width - span
    return np.maximum(largest[: column.size], largest[last : last + column.size])


def running_range(column: FloatArray, width: int) -> FloatArray:
    """Largest less smallest of the ``width`` samples about each one, shape (n,)."""
    return running_maximum(column, width) + running_maximum(-column, width)
