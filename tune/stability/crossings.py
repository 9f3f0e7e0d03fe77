"""Crossings of the stability boundary by A(w) + s·B(w), s > 0: its roots on Re w = 0.

A root can only cross the boundary at w = jω. With x = ω² both even and odd part vanish there:
E_A(x) + s·E_B(x) = 0 and O_A(x) + s·O_B(x) = 0, so x is a positive root of one polynomial,
E_A·O_B - O_A·E_B, and s = -E_A/E_B. Beside these there are the crossings at w = 0 and w = ∞. No
iteration over s, no grid.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tune.loop.companion import companion_roots
from tune.loop.polynomials import UNIT, pad_coefficients, product

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
#: -A/B at w = jv without expanded products: v of shape (candidates, *shape).
Ratio = Callable[[FloatArray], ComplexArray]

#: Roots x this far off the real axis, relative to their size, are still tried: a touching pair
#: leaves the axis by the square root of the rounding error. A false one costs one more verdict.
_NEARLY_REAL = 1e-3
#: Newton steps on (x, s); each doubles the digits that the eigenvalues left (six or more).
POLISHES = 4
#: Newton steps on v by the ratio, the part of v they look ahead for its slope, and the part they
#: may go: the coefficients of the polynomials have found v to better than that.
_REFINEMENTS, _AHEAD, _NEAR = 2, 1e-6, 1e-3


def candidates(
    fixed: FloatArray, varied: FloatArray, ratio: Ratio | None, polishes: int = POLISHES
) -> FloatArray:
    """Every s > 0 at which a crossing may happen.

    Args:
        fixed: A, shape (degree+1, loops), ascending powers of w.
        varied: B, same shape.
        ratio: -A/B on the axis, from factors; the crossings then have its digits.
        polishes: Newton steps.

    Returns:
        shape (candidates, loops), inf where unused.
    """
    x, s, _ = crossings(fixed, varied, polishes)
    if ratio is not None and s.size:
        s = _refined(x, s, ratio)
    return with_ends(s, fixed, varied)


def with_ends(s: FloatArray, fixed: FloatArray, varied: FloatArray) -> FloatArray:
    """Crossings with those at w = 0 and w = ∞, inf where unused.

    s has shape (crossings, loops), the coefficients shape (degree + 1, loops); the answer has two
    more rows.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -fixed[[0, -1]] / varied[[0, -1]]
    points = np.concatenate([s, ends])
    points[~((points > 0) & np.isfinite(points))] = np.inf
    return points


def crossings(
    fixed: FloatArray, varied: FloatArray, polishes: int
) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """Every crossing at a frequency between nothing and infinity.

    Args:
        fixed: A, shape (degree+1, loops), ascending powers of w.
        varied: B, same shape.
        polishes: Newton steps.

    Returns:
        x and s, shape (candidates, loops), nan where unused; all roots in x as they were found,
        real or not.
    """
    even = [_in_x(part[0::2]) for part in (fixed, varied)]
    odd = [_in_x(part[1::2]) for part in (fixed, varied)]
    resultant = product(odd[1], even[0])
    other = product(even[1], odd[0])
    length = max(len(resultant), len(other))
    scale = pad_coefficients(np.abs(resultant), length) + pad_coefficients(np.abs(other), length)
    resultant = pad_coefficients(resultant, length) - pad_coefficients(other, length)
    resultant[np.abs(resultant) <= 4 * UNIT * scale] = 0.0
    roots = _roots_of(resultant)
    x = real_parts(roots, _NEARLY_REAL)
    both = np.stack(
        [pad_coefficients(part, len(even[0])) for part in (even[0], odd[0], even[1], odd[1])], 1
    )
    both = both[:, :, None]
    s = _gain_at(x, both)
    for _ in range(polishes):
        x, s = _newton(x, s, both)
    return x, s, roots


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


def _roots_of(polynomials: FloatArray) -> ComplexArray:
    """Roots of each column, nan where there are fewer."""
    length, columns = polynomials.shape
    roots = np.full((length - 1, columns), np.nan, dtype=np.complex128)
    present = polynomials != 0
    lead = np.where(present.any(axis=0), length - 1 - np.argmax(present[::-1], axis=0), 0)
    tail = np.argmax(present, axis=0)
    for top, bottom in {(int(a), int(b)) for a, b in zip(lead, tail, strict=True)}:
        degree = top - bottom
        chosen = np.flatnonzero((lead == top) & (tail == bottom))
        if degree < 1:
            continue
        part = polynomials[bottom : top + 1, chosen]
        roots[:degree, chosen] = companion_roots(part[:-1] / part[-1])
    return roots


def real_parts(roots: ComplexArray, nearly: float) -> FloatArray:
    """Positive real parts of the roots that are real to a part of them, nan elsewhere.

    Roots have any shape, and the answer has it too.
    """
    with np.errstate(invalid="ignore"):
        real = (roots.real > 0) & (np.abs(roots.imag) <= nearly * np.abs(roots.real))
    return np.where(real, roots.real, np.nan)


def _values(parts: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values and slopes of polynomials in x, both (polynomials, candidates, loops).

    Args:
        parts: shape (coefficients, polynomials, 1, loops).
        x: shape (candidates, loops).
    """
    value = parts[-1] + np.zeros_like(x)
    slope = np.zeros_like(value)
    for row in parts[-2::-1]:
        slope *= x
        slope += value
        value *= x
        value += row
    return value, slope


def _gain_at(x: FloatArray, parts: FloatArray) -> FloatArray:
    """s from whichever of the even and the odd part says it best."""
    value, _ = _values(parts, x)
    with np.errstate(divide="ignore", invalid="ignore"):
        said = -value[:2] / value[2:]
        by_even = np.abs(value[2:3]) >= np.abs(value[3:]) * np.sqrt(x)
        return np.where(by_even, said[:1], said[1:])[0]


def _newton(x: FloatArray, s: FloatArray, parts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One Newton step on the pair of equations; a step that leaves (0, 2x] is not taken."""
    value, slope = _values(parts, x)
    e_b, o_b = value[2:]
    e, o = value[:2] + s * value[2:]
    e_x, o_x = slope[:2] + s * slope[2:]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        determinant = e_x * o_b - o_x * e_b
        dx = (e * o_b - o * e_b) / determinant
        ds = (e_x * o - o_x * e) / determinant
        good = np.isfinite(dx) & np.isfinite(ds) & (np.abs(dx) < 0.5 * x)
        return np.where(good, x - dx, x), np.where(good, s - ds, s)
