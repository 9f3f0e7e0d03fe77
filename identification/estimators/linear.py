"""Linear least squares on columns of very different size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def unit_columns(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns of unit norm and the norms, shape (n, p) and (p,); a column of zeros stays zero."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    return columns / norms, norms


def solve(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution by QR of unit-norm columns, shape (p,)."""
    unit, norms = unit_columns(columns)
    q, r = np.linalg.qr(unit)
    return np.linalg.lstsq(r, q.T @ right, rcond=None)[0] / norms


def explained(signal: FloatArray, residual: FloatArray) -> float:
    """Share of the mean square of a signal that is not in the residual; 0 without a signal."""
    power = float(signal @ signal)
    return 1 - float(residual @ residual) / power if power > 0 else 0.0
