"""Decimal digits of a column of a log: how finely its numbers were printed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Digits after the point that are looked for in a column.
_MOST_DIGITS = 12
#: Part of a digit by which a printed number may miss a multiple of it, for it was rounded again.
WHOLE = 1e-3


def decimal_digit(column: FloatArray) -> float:
    """The decimal digit all values are multiples of; 0 where none of the first twelve is.

    The column has shape (rows,), any unit, which the answer shares.
    """
    for power in range(_MOST_DIGITS):
        shifted = column * 10.0**power
        if np.all(np.abs(shifted - np.rint(shifted)) < WHOLE):
            return 10.0**-power
    return 0.0
