"""Routh's table in whatever arithmetic the coefficients come in: numbers, arrays or symbols.

The solvers differentiate through these functions and the encoder ripple is summed from them; no
verdict is: `criterion` judges, with error bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def product(p: Sequence[Any], q: Sequence[Any]) -> list[Any]:
    """Coefficients of the product of two polynomials."""
    total: list[Any] = [0.0] * (len(p) + len(q) - 1)
    for i, left in enumerate(p):
        for j, right in enumerate(q):
            total[i + j] = total[i + j] + left * right
    return total


def routh_ratios(coefficients: Sequence[Any]) -> list[Any]:
    """Ratios that are all below 1 exactly when a polynomial with positive coefficients is stable.

    Each new entry of the table is a difference p - q; in a stable table every p, q and difference
    is positive, so the ratios q/p say it all, free of units and of the scale of w.

    Args:
        coefficients: ascending powers, degree >= 2, all positive.
    """
    upper, lower = list(coefficients[::-2]), list(coefficients[-2::-2])
    ratios: list[Any] = []
    while len(upper) > 1:
        factor = upper[0] / lower[0]
        following = upper[1:]
        for column, item in enumerate(lower[1:]):
            ratios.append(factor * item / following[column])
            following[column] = following[column] - factor * item
        upper, lower = lower, following
    return ratios


def h2_squared(numerator: Sequence[Any], denominator: Sequence[Any]) -> Any:
    """(1/2π)∫|N(jω)/D(jω)|² dω of a stable, strictly proper quotient: Åström's α-β recursion.

    The energy is the sum of β_k²/(2α_k) over the two tables, each row of which is reduced as in
    Routh's scheme (K. J. Åström, Introduction to Stochastic Control Theory, 1970, chapter 5).

    Args:
        numerator: ascending powers, shorter than the denominator.
        denominator: ascending powers, all roots in Re w < 0.
    """
    a = list(denominator[::-1])
    b = [0.0] * (len(a) - 1 - len(numerator)) + list(numerator[::-1])
    total: Any = 0.0
    while len(a) > 1:
        alpha = a[0] / a[1]
        beta = b[0] / a[1]
        total = total + beta * beta / (2 * alpha)
        reduced, left = a[1:], b[1:]
        for index in range(1, len(reduced) - 1, 2):
            reduced[index] = reduced[index] - alpha * a[index + 2]
        for index in range(1, len(left), 2):
            left[index] = left[index] - beta * a[index + 2]
        a, b = reduced, left
    return total
