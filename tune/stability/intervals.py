"""Stability intervals: the s > 0 for which polynomials A(w) + s·B(w) are stable.

Between two neighbouring crossings of the boundary nothing changes: the criterion decides once. One
file: intervals and the shortcut up to one gain decide by the same crossings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tune.loop.polynomials import UNIT
from tune.stability.criterion import ULPS, VerdictArray, routh
from tune.stability.crossings import Ratio, candidates, crossings, real_parts, with_ends

FloatArray = NDArray[np.float64]

#: A root in x this far off the axis, relative, belongs to a pair that may come to touch it.
_ALMOST_REAL = 0.7
#: Neighbouring crossings closer than this, relative, are one.
_SAME = 64 * UNIT
#: Where only a top matters, crossings beyond so many times it, after so few Newton steps, are
#: certainly beyond it; for nearer ones the intervals decide.
_BEYOND, _ROUGH_POLISHES = 1.01, 2


class Intervals(NamedTuple):
    """Open intervals of a gain or a size, stable strictly inside; shape (intervals, *shape).

    Attributes:
        low: lower ends; 0 where the interval is connected to zero.
        high: upper ends, of the same shape; inf where there is no end. Unused entries are nan.
    """

    low: FloatArray
    high: FloatArray


def stable_intervals(
    fixed: FloatArray,
    varied: FloatArray,
    fixed_size: FloatArray,
    varied_size: FloatArray,
    ratio: Ratio | None = None,
) -> Intervals:
    """All intervals of s in (0, ∞) on which fixed + s·varied has every root in Re w < 0.

    Args:
        fixed: A, shape (degree+1, *shape), ascending powers of w.
        varied: B, same shape.
        fixed_size: absolute sums behind A, for the rounding bounds of the verdict.
        varied_size: the same for B.
        ratio: -A/B on the axis, from factors; the crossings then have its digits.

    Returns:
        Ends of shape (intervals, *shape), ascending in s.
    """
    shape = fixed.shape[1:]
    parts = [np.ascontiguousarray(p.reshape(len(p), -1)) for p in (fixed, varied)]
    sizes = [np.ascontiguousarray(p.reshape(len(p), -1)) for p in (fixed_size, varied_size)]
    points = candidates(parts[0], parts[1], _flattened(ratio, shape))
    low, high = _judged(parts, sizes, points)
    return Intervals(low.reshape(-1, *shape), high.reshape(-1, *shape))


def stable_up_to(
    fixed: FloatArray,
    varied: FloatArray,
    fixed_size: FloatArray,
    varied_size: FloatArray,
    top: float,
) -> NDArray[np.bool_]:
    """True where fixed + s·varied is certainly stable for every s in (0, top].

    What `stable_intervals` says for less work: one verdict at the top, and crossings only roughly
    unless one is near.

    Args:
        fixed: A, shape (degree+1, *shape), ascending powers of w.
        varied: B, same shape.
        fixed_size: absolute sums behind A.
        varied_size: the same for B.
        top: the largest s that matters.

    Returns:
        of shape ``shape``.
    """
    shape = fixed.shape[1:]
    parts = [np.ascontiguousarray(p.reshape(len(p), -1)) for p in (fixed, varied)]
    sizes = [np.ascontiguousarray(p.reshape(len(p), -1)) for p in (fixed_size, varied_size)]
    stable = _verdicts(parts, sizes, np.full((1, parts[0].shape[1]), top))[0] > 0
    open_ = np.flatnonzero(stable)
    if open_.size:
        points = candidates(parts[0][:, open_], parts[1][:, open_], None, _ROUGH_POLISHES)
        near = open_[np.any(points < _BEYOND * top, axis=0)]
        if near.size:
            close = [part[:, near] for part in (*parts, *sizes)]
            low, high = stable_intervals(close[0], close[1], close[2], close[3])
            stable[near] = (low[0] == 0) & (high[0] > top)
    return stable.reshape(shape)


class StabilityLimits(NamedTuple):
    """How a family of polynomials, shape (loops,), ceases to be stable below or beyond some s.

    Attributes:
        end: upper end of the last stable interval that begins below; 0 if nothing small is stable.
        omega: of the root w = jω that crosses there, 0 and inf at the ends of the axis.
        broken: there is an unstable gap below that end.
        near: frequencies v, (candidates, loops), about which roots cross or nearly do, or nan.
    """

    end: FloatArray
    omega: FloatArray
    broken: NDArray[np.bool_]
    near: FloatArray


def stability_limits(
    fixed: FloatArray,
    varied: FloatArray,
    fixed_size: FloatArray,
    varied_size: FloatArray,
    below: float,
) -> StabilityLimits:
    """Where fixed + s·varied ceases to be stable.

    Args:
        fixed: A, shape (degree+1, loops), ascending powers of w.
        varied: B, same shape.
        fixed_size: absolute sums behind A.
        varied_size: the same for B.
        below: the s of interest.
    """
    x, s, roots = crossings(fixed, varied, _ROUGH_POLISHES)
    points = with_ends(s, fixed, varied)
    low, high = _judged([fixed, varied], [fixed_size, varied_size], points.copy())
    begun = low < below
    broken = (np.sum(begun, axis=0) > 1) & (low[0] == 0)
    # Pairs that have come apart along the axis are only of interest where they leave a gap.
    with np.errstate(invalid="ignore"):
        roots[:, ~broken] = np.where(roots.imag == 0, np.nan, roots)[:, ~broken]
    end = np.where(low[0] == 0, np.max(np.where(begun, high, 0.0), axis=0), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = np.concatenate([x, np.zeros((1, x.shape[1])), np.full((1, x.shape[1]), np.inf)])
        away = np.nan_to_num(np.abs(points / end - 1), nan=np.inf)
        which = np.argmin(away, axis=0)[None]
        return StabilityLimits(
            end=end,
            omega=np.sqrt(np.take_along_axis(x, which, axis=0)[0]),
            broken=broken,
            near=np.sqrt(real_parts(roots, _ALMOST_REAL)),
        )


def _judged(
    parts: list[FloatArray], sizes: list[FloatArray], points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The stable intervals between candidates, which are sorted in place; (intervals, loops)."""
    # Up to here A + s·B is A, for all that rounding leaves of it.
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.where(sizes[1] > 0, sizes[0] / sizes[1], np.inf).min(axis=0)
    points[points <= ULPS * UNIT * alike] = np.inf
    points.sort(axis=0)
    edges = np.concatenate([np.zeros((1, points.shape[1])), points])
    after = np.concatenate([points, np.full((1, points.shape[1]), np.inf)])
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        middle = np.where(
            edges == 0,
            np.where(np.isinf(after), 1.0, after / 2),
            np.where(np.isinf(after), 2 * edges, np.sqrt(edges) * np.sqrt(after)),
        )
    empty = ~np.isfinite(edges) | ~(after > edges * (1 + _SAME))
    middle[empty] = 1.0
    stable = _verdicts(parts, sizes, middle) > 0
    stable[empty] = False
    return _merged(edges, after, stable, empty)


def _verdicts(parts: list[FloatArray], sizes: list[FloatArray], s: FloatArray) -> VerdictArray:
    coefficients = parts[0][:, None, :] + parts[1][:, None, :] * s
    return routh(coefficients, sizes[0][:, None, :] + sizes[1][:, None, :] * s)


def _merged(
    edges: FloatArray, after: FloatArray, stable: NDArray[np.bool_], empty: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Join stable neighbours; candidates that were no crossing disappear here."""
    rows, columns = edges.shape
    low = np.full((rows, columns), np.nan)
    high = np.full((rows, columns), np.nan)
    count = np.full(columns, -1)
    open_ = np.zeros(columns, dtype=bool)
    for row in range(rows):
        counts = ~empty[row]
        begins = np.flatnonzero(stable[row] & ~open_ & counts)
        count[begins] += 1
        low[count[begins], begins] = edges[row, begins]
        inside = np.flatnonzero(stable[row] & counts)
        high[count[inside], inside] = after[row, inside]
        open_ = np.where(counts, stable[row], open_)
    used = max(1, int(np.max(count, initial=-1)) + 1)
    return low[:used], high[:used]


def _flattened(ratio: Ratio | None, shape: tuple[int, ...]) -> Ratio | None:
    if ratio is None:
        return None
    return lambda v: ratio(v.reshape(-1, *shape)).reshape(v.shape)
