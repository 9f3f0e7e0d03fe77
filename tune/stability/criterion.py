"""Routh-Hurwitz criterion with bounds of its rounding errors: are all roots in Re w < 0?

Each coefficient c comes with a size s, the sum of the absolute values it was added up from; the
true coefficient lies within ``ULPS·u·s`` of c. +1 is certainly stable, -1 certainly not stable and
0 closer to the boundary than float64 can tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.loop.companion import companion_roots
from tune.loop.polynomials import UNIT

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
VerdictArray = NDArray[np.int8]

#: Units of roundoff in one coefficient: the factors of a block are right to 12 of their sizes, a
#: filter to 3, delays are whole numbers, and each product and sum adds one; against 600 bits no
#: coefficient of 3 000 loops was off by more than 12.
ULPS = 32.0
#: Signs of the errors in a vertex of Kharitonov's, from one power to the next.
_SIGNS = (1, 1, -1, -1)
#: Newton steps on a computed root.
_POLISHES = 3
#: The disc around a root is so much wider than the distance the root may have.
_WIDER = 1.5
#: Covers the roundings of the terms of a disc.
_SAFE = 1 - 1e-9


def routh(coefficients: FloatArray, sizes: FloatArray) -> VerdictArray:
    """The verdict for any degree.

    Running error bounds decide most; they grow with the degree, so what they leave open is judged
    by sharper and slower means: stable where the four vertices of Kharitonov's theorem are, not
    stable where a disc around a computed root lies beyond the axis.

    Args:
        coefficients: (degree+1, *shape), ascending powers of w.
        sizes: the same shape; absolute sums behind each coefficient.

    Returns:
        +1, 0 or -1, of shape ``shape``.
    """
    shape = coefficients.shape[1:]
    c = coefficients.reshape(len(coefficients), -1)
    errors = ULPS * UNIT * sizes.reshape(c.shape)
    verdict = _running(c, errors)
    known = np.all(np.isfinite(c) & np.isfinite(errors), axis=0)
    open_ = np.flatnonzero((verdict == 0) & known)
    if open_.size:
        rest, slack = c[:, open_], errors[:, open_]
        beyond = np.where(_root_beyond(rest, slack), np.int8(-1), np.int8(0))
        verdict[open_] = np.where(_vertices_stable(rest, slack), np.int8(1), beyond)
    return verdict.reshape(shape)


def _running(coefficients: FloatArray, errors: FloatArray) -> VerdictArray:
    """Routh's array with running error bounds: quick, and sharp for low degrees."""
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


def _vertices_stable(coefficients: FloatArray, errors: FloatArray) -> NDArray[np.bool_]:
    """True where every polynomial within the errors is stable; (degree+1, points).

    Kharitonov (1978): a box of coefficients is stable if four of its vertices are. Routh's array
    in floating point, while all its entries are positive, is the exact one of coefficients that
    differ by two units of roundoff for each row at most, because they are sums of products of its
    entries without a subtraction. The box is widened by that.
    """
    degree = len(coefficients) - 1
    errors = errors + 4 * degree * UNIT * (np.abs(coefficients) + errors)
    stable = np.ones(coefficients.shape[1], dtype=np.bool_)
    for start in range(4):
        signs = np.array([_SIGNS[(start + power) % 4] for power in range(degree + 1)])
        stable &= _all_positive(coefficients + signs[:, None] * errors)
    return stable


def _all_positive(coefficients: FloatArray) -> NDArray[np.bool_]:
    """True where every entry of Routh's array is positive."""
    positive = np.all(coefficients > 0, axis=0)
    upper, lower = coefficients[::-1][::2], coefficients[::-1][1::2]
    with np.errstate(all="ignore"):
        while len(lower):
            following = upper[1:].copy()
            following[: len(lower) - 1] -= upper[0] / lower[0] * lower[1:][: len(following)]
            positive &= np.all(following > 0, axis=0)
            upper, lower = lower, following
    return positive


def _root_beyond(coefficients: FloatArray, errors: FloatArray) -> NDArray[np.bool_]:
    """True where every polynomial within the errors has a root in Re w > 0; (degree+1, points).

    By Rouché's theorem a disc of radius ρ around a point holds exactly one root if |p'|·ρ exceeds
    |p| and all higher terms of the expansion there, errors included.
    """
    degree = len(coefficients) - 1
    roots = _roots(coefficients)
    slack = errors + 4 * degree * UNIT * np.abs(coefficients)
    with np.errstate(all="ignore"):
        for _ in range(_POLISHES):
            value, slope, *_ = _expanded(coefficients, roots)
            step = value / slope
            roots = np.where(np.abs(step) < 0.1 * np.abs(roots), roots - step, roots)
        terms = [np.abs(term) for term in _expanded(coefficients, roots)]
        blur = [np.abs(term) for term in _expanded(slack, np.abs(roots).astype(np.complex128))]
        (constant, slope, *higher), (constant_slack, slope_slack, *higher_slack) = terms, blur
        radius = _WIDER * (constant + constant_slack) / (slope - slope_slack)
        rest = constant + constant_slack
        for power, (term, more) in enumerate(zip(higher, higher_slack, strict=True), start=2):
            rest += (term + more) * radius**power
        single = (radius > 0) & (rest < _SAFE * (slope - slope_slack) * radius)
        return np.any(single & (np.real(roots) > radius), axis=0)


def _roots(coefficients: FloatArray) -> ComplexArray:
    """(degree, points), in whatever digits eigenvalues have."""
    degree = len(coefficients) - 1
    lead = np.where(coefficients[-1] != 0, coefficients[-1], np.finfo(float).tiny)
    unit = np.abs(coefficients[0] / lead) ** (1 / degree)
    unit = np.where(np.isfinite(unit) & (unit > 0), unit, 1.0)
    with np.errstate(all="ignore"):
        scaled = coefficients[:-1] / lead / unit ** (degree - np.arange(degree))[:, None]
    return companion_roots(np.nan_to_num(scaled)) * unit


def _expanded(coefficients: FloatArray, place: ComplexArray) -> list[ComplexArray]:
    """Coefficients of the polynomial in the distance from a place, by Horner's scheme."""
    rows = [np.zeros_like(place) + row for row in coefficients]
    for first in range(len(rows) - 1):
        for power in range(len(rows) - 2, first - 1, -1):
            rows[power] = rows[power] + place * rows[power + 1]
    return rows
