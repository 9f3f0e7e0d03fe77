"""Covariances of which only a band about the diagonal is not zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]

#: Independent noise added to each variance, part of it: double precision resolves no smaller one.
_LOADING = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Covariance:
    """A banded covariance by its Cholesky factor, shape (band + 1, functions), lower form."""

    factor: FloatArray

    @classmethod
    def of(cls, covariance: FloatArray) -> Covariance:
        """From the covariance in the same form, shape (band + 1, functions)."""
        from scipy.linalg import cholesky_banded

        loaded = np.concatenate((covariance[:1] * (1 + _LOADING), covariance[1:]))
        return cls(factor=np.asarray(cholesky_banded(loaded, lower=True)))

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant."""
        return 2 * float(np.sum(np.log(self.factor[0])))

    def whitened(self, right: FloatArray) -> FloatArray:
        """Columns, shape (..., functions), as if the covariance were 1."""
        from scipy.linalg import solve_banded

        return solve_banded((len(self.factor) - 1, 0), self.factor, right.T).T

    def solve(self, right: FloatArray) -> FloatArray:
        """The inverse of the covariance times a column, shape (functions,)."""
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self.factor, True), right))


def bands(*matrices: csr_array) -> FloatArray:
    """Symmetric matrices in lower band form, shape (matrices, band + 1, functions)."""
    found = [each.tocoo() for each in matrices]
    band = max(int(np.max(each.coords[0] - each.coords[1])) for each in found)
    banded = np.zeros((len(found), band + 1, matrices[0].shape[0]))
    for target, each in zip(banded, found, strict=True):
        row, column = each.coords
        lower = row >= column
        target[(row - column)[lower], column[lower]] = each.data[lower]
    return banded
