"""Where a family of polynomials A(w) + s·B(w), s > 0, changes between stable and unstable.

A root can only cross the boundary at w = jω. With x = ω² both even and odd part vanish there:
E_A(x) + s·E_B(x) = 0 and O_A(x) + s·O_B(x) = 0, so x is a positive root of one polynomial,
E_A·O_B - O_A·E_B, and s = -E_A/E_B. Adding the crossings at w = 0 and w = ∞, the criterion decides
each interval between neighbours once. No iteration over s, no grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tune.criterion import UNIT, VerdictArray, routh

FloatArray = NDArray[np.float64]

#: Roots x this far off the real axis, relative to their size, are still tried: a touching pair
#: leaves the axis by the square root of the rounding error. A false one costs one more verdict.
_NEARLY_REAL = 1e-3
#: Newton steps on (x, s); each doubles the digits that the eigenvalues left (six or more).
_POLISHES = 4
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
    fixed: FloatArray, varied: FloatArray, fixed_size: FloatArray, varied_size: FloatArray
) -> Intervals:
    """All intervals of s in (0, ∞) on which fixed + s·varied has every root in Re w < 0.

    Args:
        fixed: A, shape (degree+1, *shape), ascending powers of w.
        varied: B, same shape.
        fixed_size: absolute sums behind A, for the rounding bounds of the verdict.
        varied_size: the same for B.

    Returns:
        Ends of shape (intervals, *shape), ascending in s.
    """
    shape = fixed.shape[1:]
    parts = [np.ascontiguousarray(p.reshape(len(p), -1)) for p in (fixed, varied)]
    sizes = [np.ascontiguousarray(p.reshape(len(p), -1)) for p in (fixed_size, varied_size)]
    points = _candidates(parts[0], parts[1])
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


def _candidates(fixed: FloatArray, varied: FloatArray) -> FloatArray:
    """Every s > 0 at which a crossing may happen, sorted, inf where unused; (candidates, loops)."""
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
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -fixed[[0, -1]] / varied[[0, -1]]
    points = np.concatenate([s, ends])
    points[~((points > 0) & np.isfinite(points))] = np.inf
    return np.sort(points, axis=0)


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
