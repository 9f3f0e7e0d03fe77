"""Roots of stacks of polynomials, as eigenvalues of their companion matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def companion_roots(lower: FloatArray) -> NDArray[np.complex128]:
    """All roots of monic polynomials, in whatever digits eigenvalues have.

    Args:
        lower: (degree, columns), ascending coefficients without the leading one, which is 1.

    Returns:
        shape (degree, columns).
    """
    degree, columns = lower.shape
    companion = np.zeros((columns, degree, degree))
    companion[:, 0, :] = -lower[::-1].T
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.linalg.eigvals(companion).T.astype(np.complex128)
