"""Do all roots of a real polynomial lie in Re w < 0? An answer that knows its rounding errors.

Each coefficient c comes with a size s, the sum of the absolute values it was added up from; the
true coefficient lies within ``ULPS·u·s`` of c. +1 is certainly stable, -1 certainly not stable and
0 closer to the boundary than float64 can tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
VerdictArray = NDArray[np.int8]

#: Unit roundoff of float64.
UNIT = 2.0**-53
#: Units of roundoff in one coefficient: at most 12 factors of 3 roundings, each followed by a
#: product and a sum, and one sum over four terms with one product each: below 64.
ULPS = 64.0


def routh(coefficients: FloatArray, sizes: FloatArray) -> VerdictArray:
    """Routh array with running error bounds, for any degree.

    Args:
        coefficients: (degree+1, *shape), ascending powers of w.
        sizes: the same shape; absolute sums behind each coefficient.

    Returns:
        +1, 0 or -1, of shape ``shape``.
    """
    errors = ULPS * UNIT * sizes
    negative = np.any(coefficients < -errors, axis=0)
    verdict = np.where(negative, np.int8(-1), np.int8(1))
    doubtful = np.any(coefficients <= errors, axis=0) & ~negative
    degree = len(coefficients) - 1
    upper, upper_error = coefficients[degree::-2], errors[degree::-2]
    lower, lower_error = coefficients[degree - 1 :: -2], errors[degree - 1 :: -2]
    with np.errstate(all="ignore"):
        while len(lower):
            pivot, slack = lower[0], lower_error[0]
            certain = pivot > slack
            # Once a pivot is not certainly positive nothing below it means anything.
            verdict = np.where((pivot < -slack) & ~doubtful & (verdict > 0), np.int8(-1), verdict)
            doubtful |= (verdict > 0) & ~certain
            ratio = upper[0] / pivot
            ratio_error = (upper_error[0] + np.abs(ratio) * slack) / (pivot - slack)
            ratio_error += 2 * UNIT * np.abs(ratio)
            count = len(upper) - 1
            nxt, nxt_error = upper[1:].copy(), upper_error[1:].copy()
            for column in range(min(count, len(lower) - 1)):
                product = ratio * lower[column + 1]
                nxt[column] -= product
                nxt_error[column] += (
                    np.abs(ratio) * lower_error[column + 1]
                    + ratio_error * (np.abs(lower[column + 1]) + lower_error[column + 1])
                    + 2 * UNIT * (np.abs(product) + np.abs(nxt[column]))
                )
            upper, upper_error, lower, lower_error = lower, lower_error, nxt, nxt_error
    return np.where((verdict > 0) & doubtful, np.int8(0), verdict)


class Quartic:
    """Verdicts for many settings of one loop: c_i > 0 and c1·c2·c3 - c0·c3² - c4·c1² > 0.

    This is the criterion of equations (38) to (43) with the signs they leave out. It decides
    whatever a bound common to all the points of a block can decide, and leaves the rest at 0 for
    `routh`. Its arrays are made once and reused, so that a block stays in the cache.

    Args:
        terms: (5, 1 + effects): constant part and coefficient of each effect, ascending in w.
        sizes: the same with every factor taken absolutely.
        block: largest number of points judged at once.
        position_free: no spring in the structure; the factor w is left in, c0 is not asked for.
    """

    def __init__(
        self, terms: FloatArray, sizes: FloatArray, block: int, *, position_free: bool
    ) -> None:
        self._terms = terms
        self._sizes = sizes
        self._position_free = position_free
        self._points = np.ones((terms.shape[1], block))
        self._coefficients = np.empty((5, block))
        self._lowest = np.empty(block)
        self._flags = np.empty((2, block), dtype=np.bool_)

    def judge(self, values: tuple[FloatArray, ...], verdict: VerdictArray) -> None:
        """Write the verdict of each point; values are flat arrays of one length, one an effect."""
        count = verdict.size
        points = self._points[:, :count]
        for row, value in zip(points[1:], values, strict=True):
            row[:] = value
        reach = np.maximum(points.max(axis=1), -points.min(axis=1))
        s0, s1, s2, s3, s4 = size = self._sizes @ reach
        slack = ULPS * UNIT * float(size.max())
        h_slack = 4 * ULPS * UNIT * float(s1 * s2 * s3 + s0 * s3 * s3 + s4 * s1 * s1)
        c0, c1, c2, c3, c4 = np.matmul(self._terms, points, out=self._coefficients[:, :count])
        lowest = np.minimum(c1, c2, out=self._lowest[:count])
        for coefficient in (c3, c4) if self._position_free else (c3, c4, c0):
            np.minimum(lowest, coefficient, out=lowest)
        # h = c3·(c1·c2 - c0·c3) - c4·c1², overwriting what is no longer used.
        c2 *= c1
        c0 *= c3
        c2 -= c0
        c2 *= c3
        c1 *= c1
        c1 *= c4
        c2 -= c1
        one, two = self._flags[:, :count]
        np.greater(lowest, slack, out=one)
        np.greater(c2, h_slack, out=two)
        np.logical_and(one, two, out=one)
        verdict[:] = one
        np.less(lowest, -slack, out=one)
        np.less(c2, -h_slack, out=two)
        np.logical_or(one, two, out=one)
        verdict -= one.view(np.int8)
