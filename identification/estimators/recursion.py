"""Linear difference equations: what a row keeps of the rows before it.

A triangular system with a few diagonals, solved as such: it knows no growth that would have to be
divided out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def recursive(rows: FloatArray, *past: FloatArray | float) -> FloatArray:
    """y with y[k] + past[0]·y[k - 1] + past[1]·y[k - 2] + … = rows[k], nothing before the first.

    Args:
        rows: shape (n,) or (columns, n).
        past: one weight for each row back: a number, or its value at each row, shape (n,).
    """
    from scipy.linalg.lapack import dtbtrs

    count = rows.shape[-1]
    band = np.ones((len(past) + 1, count), order="F")
    for back, weight in enumerate(past, start=1):
        # The diagonal below the main one begins with the row that is the first to look back so far.
        band[back, : count - back] = weight[back:] if isinstance(weight, np.ndarray) else weight
    return dtbtrs(band, np.atleast_2d(rows).T, uplo="L", diag="U")[0].T.reshape(rows.shape)
