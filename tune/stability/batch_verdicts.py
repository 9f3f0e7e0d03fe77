"""Batch verdicts: stability of many settings of one loop, a block of points at a time.

Both classes decide what error bounds common to all the points of a block can decide, and leave the
rest at 0 for `criterion.routh`. Their arrays are made once and reused, so that a block stays in the
cache.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tune.loop.polynomials import UNIT
from tune.stability.criterion import ULPS, VerdictArray

FloatArray = NDArray[np.float64]

#: Points of a block: its arrays stay in the cache, and the cost of a call is shared by many.
_QUARTIC_BLOCK, _TABLE_BLOCK = 16384, 8192

#: The bounds begin with so much more than the coefficients' own errors; see `Table`.
_ROUNDED = 8


class Judge(Protocol):
    """Verdicts of at most ``block`` points."""

    block: int

    def judge(self, values: tuple[FloatArray, ...], verdict: VerdictArray) -> None:
        """Write the verdict of each point, shape (points,), from the values of each effect there.

        There is one array of values an effect, each of shape (points,).
        """
        ...


def judge_of(terms: FloatArray, sizes: FloatArray, *, position_free: bool) -> Judge:
    """The quickest judge of a loop.

    Args:
        terms: (degree+1, 1 + effects): constant part and coefficient of each effect, ascending.
        sizes: the same with every factor taken absolutely.
        position_free: no spring in the structure; the factor w is left out of the judgement.
    """
    if len(terms) == 5:
        return Quartic(terms, sizes, position_free=position_free)
    start = 1 if position_free else 0
    return Table(terms[start:], sizes[start:])


class Table:
    """Any degree: Routh's array with running error bounds, in place.

    With r = u0/v0 every entry of the next row is u - r·v, and its error that of u, r + dr times
    that of v, and dr times |v|. What is rounded on the way is less than a sixteenth of these bounds
    in each row, because they begin with more than 32 units of roundoff; beginning with eight
    times as much covers thirty rows.
    """

    block = _TABLE_BLOCK

    def __init__(self, terms: FloatArray, sizes: FloatArray) -> None:
        self._terms = np.ascontiguousarray(terms[::-1])
        self._sizes = sizes[::-1]
        rows = len(terms)
        self._points = np.ones((terms.shape[1], self.block))
        self._coefficients, self._errors = np.empty((2, rows, self.block))
        self._scratch = np.empty((rows, self.block))
        self._ratio, self._slack, self._reach = np.empty((3, self.block))
        self._good, self._bad, self._flag = np.empty((3, self.block), dtype=np.bool_)

    def judge(self, values: tuple[FloatArray, ...], verdict: VerdictArray) -> None:
        """Write the verdict of each point, shape (points,), from the values of each effect there.

        There is one array of values an effect, each of shape (points,).
        """
        count = verdict.size
        points = self._points[:, :count]
        for row, value in zip(points[1:], values, strict=True):
            row[:] = value
        reach = np.maximum(points.max(axis=1), -points.min(axis=1))
        slack = _ROUNDED * ULPS * UNIT * (self._sizes @ reach)
        c = np.matmul(self._terms, points, out=self._coefficients[:, :count])
        e = self._errors[:, :count]
        e[:] = slack[:, None]
        good, bad, flag = self._good[:count], self._bad[:count], self._flag[:count]
        lowest = np.min(c, axis=0, out=self._ratio[:count])
        np.less(lowest, -slack.max(), out=bad)
        np.greater(c[0], e[0], out=good)
        with np.errstate(all="ignore"):
            self._reduce(c, e, (good, bad, flag))
        verdict[:] = good
        verdict -= bad.view(np.int8)

    def _reduce(
        self,
        c: FloatArray,
        e: FloatArray,
        flags: tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]],
    ) -> None:
        """Row after row; u and v hold every second power, in place."""
        good, bad, flag = flags
        count = c.shape[1]
        ratio, dr, reach = self._ratio[:count], self._slack[:count], self._reach[:count]
        u, v, eu, ev = c[0::2], c[1::2], e[0::2], e[1::2]
        while len(v):
            np.less(v[0], np.negative(ev[0], out=reach), out=flag)
            flag &= good
            bad |= flag
            good &= np.greater(v[0], ev[0], out=flag)
            width = len(v) - 1
            if width or len(u) > 1:
                np.divide(u[0], v[0], out=ratio)
                np.multiply(ratio, ev[0], out=dr)
                dr += eu[0]
                dr /= np.subtract(v[0], ev[0], out=reach)
                np.add(ratio, dr, out=reach)
                part = self._scratch[:width, :count]
                u[1 : 1 + width] -= np.multiply(v[1:], ratio, out=part)
                np.abs(v[1:], out=part)
                part *= dr
                eu[1 : 1 + width] += part
                eu[1 : 1 + width] += np.multiply(ev[1:], reach, out=part)
            u, v, eu, ev = v, u[1:], ev, eu[1:]


class Quartic:
    """Degree four: c_i > 0 and c1·c2·c3 - c0·c3² - c4·c1² > 0.

    This is the criterion of equations (38) to (43) with the signs they leave out.

    Args:
        terms: (5, 1 + effects): constant part and coefficient of each effect, ascending in w.
        sizes: the same with every factor taken absolutely.
        position_free: no spring in the structure; the factor w is left in, c0 is not asked for.
    """

    block = _QUARTIC_BLOCK

    def __init__(self, terms: FloatArray, sizes: FloatArray, *, position_free: bool) -> None:
        self._terms = terms
        self._sizes = sizes
        self._position_free = position_free
        self._points = np.ones((terms.shape[1], self.block))
        self._coefficients = np.empty((5, self.block))
        self._lowest = np.empty(self.block)
        self._flags = np.empty((2, self.block), dtype=np.bool_)

    def judge(self, values: tuple[FloatArray, ...], verdict: VerdictArray) -> None:
        """Write the verdict of each point, shape (points,), from the values of each effect there.

        There is one array of values an effect, each of shape (points,).
        """
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
