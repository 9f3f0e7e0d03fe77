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


def symmetric_inverse(matrices: FloatArray, nothing: float = 1e-15) -> FloatArray:
    """Pseudo-inverses of symmetric matrices by their eigenvalues, shape (..., p, p).

    Args:
        matrices: shape (..., p, p).
        nothing: eigenvalues below this part of the largest, in size, carry nothing but rounding.
    """
    values, vectors = np.linalg.eigh(matrices)
    sizes = np.abs(values)
    told = sizes > nothing * np.max(sizes, axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=told)
    return (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def explained_share(signal: FloatArray, residual: FloatArray) -> float:
    """Share of the mean square of a signal that is not in the residual; 0 without a signal.

    Both are of shape (rows,) and of one unit; the share has none.
    """
    power = float(signal @ signal)
    return 1 - float(residual @ residual) / power if power > 0 else 0.0


def gauss_newton(
    slopes: FloatArray, residual: FloatArray, nothing: float
) -> tuple[FloatArray, float]:
    """The Gauss-Newton step of a fit, and what it gains in units of the variance of a residual.

    Args:
        slopes: derivative of the fit by each parameter, shape (k, rows).
        residual: what the fit leaves, shape (rows,).
        nothing: directions this much weaker than the strongest carry nothing but rounding.
    """
    normal = slopes @ slopes.T
    size = np.sqrt(np.diag(normal))
    # A parameter that changes nothing does not move.
    size = np.where(size > 0, size, 1.0)
    right = slopes @ residual / size
    inverse = symmetric_inverse(normal / np.outer(size, size), nothing)
    move = inverse @ right
    cost = max(float(residual @ residual), np.finfo(float).tiny)
    return move / size, float(move @ right) * residual.size / cost
