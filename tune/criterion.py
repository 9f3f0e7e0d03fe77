"""Do all roots of a real polynomial lie in Re w < 0? An answer that knows its rounding errors.

Each coefficient c comes with a size s, the sum of the absolute values it was added up from; the
true coefficient lies within ``ULPS·u·s`` of c. +1 is certainly stable, -1 certainly not stable and
0 closer to the boundary than float64 can tell.
"""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True, kw_only=True)
class QuarticTerms:
    """Scalar coefficients of 1, α, β, γ for degree at most 4, and their sizes; (5, 4) each."""

    terms: FloatArray
    sizes: FloatArray


def quartic(
    family: QuarticTerms, values: tuple[FloatArray, ...], *, position_free: bool
) -> VerdictArray:
    """Verdicts for many (α, β, γ) on one loop: c_i > 0 and c1·c2·c3 - c0·c3² - c4·c1² > 0.

    This is the criterion of equations (38) to (43) with the signs they leave out. It decides
    whatever a bound common to all the points can decide, and leaves the rest at 0 for `routh`.

    Args:
        family: the loop; where ``position_free`` its factor w is left in and c0 is not asked for.
        values: flat arrays (α, β, γ), all of one length.
        position_free: no spring in the structure.
    """
    stacked = np.empty((4, values[0].size))
    stacked[0] = 1.0
    for row, value in zip(stacked[1:], values, strict=True):
        row[:] = value
    lower, upper = stacked.min(axis=1, initial=0.0), stacked.max(axis=1, initial=0.0)
    size = family.sizes @ np.maximum(upper, -lower)
    slack = ULPS * UNIT * size
    c0, c1, c2, c3, c4 = family.terms @ stacked
    lowest = np.minimum(c1, c2)
    np.minimum(lowest, c3, out=lowest)
    np.minimum(lowest, c4, out=lowest)
    if not position_free:
        np.minimum(lowest, c0, out=lowest)
    # h = c3·(c1·c2 - c0·c3) - c4·c1², overwriting c2, c0 and c1 once they are used.
    c2 *= c1
    c0 *= c3
    c2 -= c0
    c2 *= c3
    c1 *= c1
    c1 *= c4
    c2 -= c1
    s0, s1, s2, s3, s4 = size
    h_slack = 4 * ULPS * UNIT * (s1 * s2 * s3 + s0 * s3 * s3 + s4 * s1 * s1)
    slack_all = float(np.max(slack))
    verdict = ((lowest > slack_all) & (c2 > h_slack)).view(np.int8)
    verdict -= ((lowest < -slack_all) | (c2 < -h_slack)).view(np.int8)
    return verdict
