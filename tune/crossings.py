"""Where a family of polynomials A(w) + s·B(w), s > 0, changes between stable and unstable.

A root can only cross the boundary at w = jω. With x = ω² both even and odd part vanish there:
E_A(x) + s·E_B(x) = 0 and O_A(x) + s·O_B(x) = 0, so x is a positive root of one polynomial,
E_A·O_B - O_A·E_B, and s = -E_A/E_B. Adding the crossings at w = 0 and w = ∞, the criterion decides
each interval between neighbours once. No iteration over s, no grid.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tune.criterion import ULPS, UNIT, VerdictArray, routh

FloatArray = NDArray[np.float64]
#: -A/B at w = jv without expanded products: v of shape (candidates, *shape).
Ratio = Callable[[FloatArray], NDArray[np.complex128]]

#: Roots x this far off the real axis, relative to their size, are still tried: a touching pair
#: leaves the axis by the square root of the rounding error. A false one costs one more verdict.
_NEARLY_REAL = 1e-3
#: Newton steps on (x, s); each doubles the digits that the eigenvalues left (six or more).
_POLISHES = 4
#: Newton steps on v by the ratio, the part of v they look ahead for its slope, and the part they
#: may go: the coefficients of the polynomials have found v to better than that.
_REFINEMENTS, _AHEAD, _NEAR = 2, 1e-6, 1e-3
#: Neighbouring crossings closer than this, relative, are one.
_SAME = 64 * UNIT


class Intervals(NamedTuple):
    """Open intervals of a gain or a size, stable strictly inside.

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
    # Up to here A + s·B is A, for all that rounding leaves of it.
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.where(sizes[1] > 0, sizes[0] / sizes[1], np.inf).min(axis=0)
    points = _candidates(parts[0], parts[1], _flattened(ratio, shape))
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
    low, high = _merged(edges, after, stable, empty)
    return Intervals(low.reshape(-1, *shape), high.reshape(-1, *shape))


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


def _candidates(fixed: FloatArray, varied: FloatArray, ratio: Ratio | None) -> FloatArray:
    """Every s > 0 at which a crossing may happen, inf where unused; (candidates, loops)."""
    even = [_in_x(part[0::2]) for part in (fixed, varied)]
    odd = [_in_x(part[1::2]) for part in (fixed, varied)]
    resultant = _times(even[0], odd[1])
    other = _times(odd[0], even[1])
    length = max(len(resultant), len(other))
    scale = _grown(np.abs(resultant), length) + _grown(np.abs(other), length)
    resultant = _grown(resultant, length) - _grown(other, length)
    resultant[np.abs(resultant) <= 4 * UNIT * scale] = 0.0
    x = _positive_roots(resultant)
    s = _gain_at(x, even, odd)
    for _ in range(_POLISHES):
        x, s = _newton(x, s, even, odd)
    if ratio is not None and s.size:
        s = _refined(x, s, ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -fixed[[0, -1]] / varied[[0, -1]]
    points = np.concatenate([s, ends])
    points[~((points > 0) & np.isfinite(points))] = np.inf
    return points


def _refined(x: FloatArray, s: FloatArray, ratio: Ratio) -> FloatArray:
    """s where the ratio becomes real, by Newton's method on v; unchanged where that leads away."""
    with np.errstate(all="ignore"):
        start = np.sqrt(np.where(x > 0, x, np.nan))
        v = start.copy()
        for _ in range(_REFINEMENTS):
            places = np.concatenate([v, v * (1 + _AHEAD), v * (1 - _AHEAD)])
            here, above, below = np.split(np.imag(ratio(places)), 3)
            v -= here / (above - below) * (2 * _AHEAD * v)
        value = ratio(v)
        good = (np.abs(v - start) <= _NEAR * start) & (np.abs(np.imag(value)) <= _NEAR * np.abs(s))
        good &= np.abs(np.real(value) - s) <= _NEAR * np.abs(s)
        return np.where(good, np.real(value), s)


def _in_x(part: FloatArray) -> FloatArray:
    """Powers of w² = -x to powers of x."""
    signs = (-1.0) ** np.arange(len(part))
    return part * signs[:, None]


def _times(p: FloatArray, q: FloatArray) -> FloatArray:
    total = np.zeros((len(p) + len(q) - 1, p.shape[1]))
    for power, row in enumerate(p):
        total[power : power + len(q)] += row * q
    return total


def _grown(part: FloatArray, length: int) -> FloatArray:
    return np.concatenate([part, np.zeros((length - len(part), part.shape[1]))])


def _positive_roots(polynomials: FloatArray) -> FloatArray:
    """Positive real parts of the nearly real roots of each column, nan elsewhere."""
    length, columns = polynomials.shape
    roots = np.full((length - 1, columns), np.nan)
    present = polynomials != 0
    lead = np.where(present.any(axis=0), length - 1 - np.argmax(present[::-1], axis=0), 0)
    tail = np.argmax(present, axis=0)
    for top, bottom in {(int(a), int(b)) for a, b in zip(lead, tail, strict=True)}:
        degree = top - bottom
        chosen = np.flatnonzero((lead == top) & (tail == bottom))
        if degree < 1:
            continue
        part = polynomials[bottom : top + 1, chosen]
        companion = np.zeros((chosen.size, degree, degree))
        companion[:, 0, :] = (-part[-2::-1] / part[-1]).T
        companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
        values = np.linalg.eigvals(companion).T
        with np.errstate(invalid="ignore"):
            real = (values.real > 0) & (np.abs(values.imag) <= _NEARLY_REAL * np.abs(values.real))
        roots[:degree, chosen] = np.where(real, values.real, np.nan)
    return roots


def _value(part: FloatArray, x: FloatArray) -> FloatArray:
    total = np.broadcast_to(part[-1], x.shape).copy()
    for row in part[-2::-1]:
        total *= x
        total += row
    return total


def _slope(part: FloatArray, x: FloatArray) -> FloatArray:
    powers = np.arange(1, len(part))[:, None]
    return _value(part[1:] * powers, x) if len(part) > 1 else np.zeros_like(x)


def _gain_at(x: FloatArray, even: list[FloatArray], odd: list[FloatArray]) -> FloatArray:
    """s from whichever part says it best."""
    e_b, o_b = _value(even[1], x), _value(odd[1], x)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(
            np.abs(e_b) >= np.abs(o_b) * np.sqrt(x),
            -_value(even[0], x) / e_b,
            -_value(odd[0], x) / o_b,
        )


def _newton(
    x: FloatArray, s: FloatArray, even: list[FloatArray], odd: list[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """One Newton step on the pair of equations; a step that leaves (0, 2x] is not taken."""
    e_b, o_b = _value(even[1], x), _value(odd[1], x)
    e, o = _value(even[0], x) + s * e_b, _value(odd[0], x) + s * o_b
    e_x = _slope(even[0], x) + s * _slope(even[1], x)
    o_x = _slope(odd[0], x) + s * _slope(odd[1], x)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        determinant = e_x * o_b - o_x * e_b
        dx = (e * o_b - o * e_b) / determinant
        ds = (e_x * o - o_x * e) / determinant
        good = np.isfinite(dx) & np.isfinite(ds) & (np.abs(dx) < 0.5 * x)
        return np.where(good, x - dx, x), np.where(good, s - ds, s)
