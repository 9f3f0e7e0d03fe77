"""Peak of a quotient P(x)/Q(x), x = v², over all frequencies, by level sets and no grid.

Where P - level·Q has no positive root the level is nowhere exceeded. From the largest value known,
the roots at that level enclose whatever exceeds it; the middles of those gaps give a larger value,
and so on; it converges quadratically (Bruinsma and Steinbuch 1990, for norms of transfer
functions). Levels need polynomials of half the degree that the stationary points would.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Levels are raised by this, relative: two roots that touch the axis must be seen as a pair.
_RAISED = 1e-13
#: A gain in value below this, relative, ends the search; the peak is flat to its square root.
_ENOUGH = 1e-12
#: Levels tried; from a start near a peak four are usual.
_MOST_LEVELS = 40
#: Roots this far from the real axis, relative, are still tried: near its top a peak's two roots
#: leave the axis by the square root of the rounding error. A false one costs one evaluation.
NEARLY_REAL = 1e-3


def squared_modulus(polynomial: FloatArray) -> FloatArray:
    """|p(jv)|² as coefficients of x = v², for ascending coefficients of p; shape (degree+1,)."""
    even, odd = parts_on_axis(polynomial)
    total = np.zeros(len(polynomial))
    squared = np.convolve(even, even)
    total[: len(squared)] = squared
    if len(odd):
        squared = np.convolve(odd, odd)
        total[1 : 1 + len(squared)] += squared
    return total


def parts_on_axis(polynomial: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(E, O) in powers of x with p(jv) = E(x) + jv·O(x)."""
    even, odd = polynomial[0::2], polynomial[1::2]
    return even * (-1.0) ** np.arange(len(even)), odd * (-1.0) ** np.arange(len(odd))


def positive_roots(polynomial: FloatArray) -> FloatArray:
    """Positive and nearly real roots of a polynomial in x, ascending.

    The coefficients have shape (degree + 1,), ascending; the answer has shape (roots,).
    """
    roots = np.roots(polynomial[::-1])
    real = (roots.real > 0) & (np.abs(roots.imag) <= NEARLY_REAL * roots.real)
    return np.sort(roots.real[real]).astype(np.float64)


def peak(
    value: Callable[[FloatArray], FloatArray],
    top: FloatArray,
    bottom: FloatArray,
    starts: FloatArray,
) -> tuple[float, float]:
    """(largest value, its v) of P/Q over v in [0, ∞].

    Coefficients have shape (degree + 1,), starts shape (starts,).

    Args:
        value: P/Q at finite v, an array; it may know better digits than the expanded P and Q.
        top: P, ascending in x.
        bottom: Q, of the same length, positive for x > 0 and with a last coefficient not zero.
        starts: places v where a peak may be expected, such as the imaginary parts of poles.
    """
    places = np.concatenate([[0.0], starts[np.isfinite(starts)]])
    best, place = _largest(value, places)
    end = float(top[-1] / bottom[-1])
    if not best >= end:
        best, place = end, float("inf")
    for _ in range(_MOST_LEVELS):
        edges = positive_roots(top - (best + _RAISED * abs(best)) * bottom)
        if not edges.size:
            break
        middles = np.sqrt(edges[1:]) * np.sqrt(edges[:-1])
        found, where = _largest(value, np.sqrt(np.concatenate([edges, middles])))
        if not found > best:
            break
        gained, best, place = found - best, found, where
        if gained <= _ENOUGH * abs(best):
            break
    return best, place


def _largest(value: Callable[[FloatArray], FloatArray], v: FloatArray) -> tuple[float, float]:
    with np.errstate(divide="ignore", invalid="ignore"):
        values = value(v)
    index = int(np.argmax(np.where(np.isnan(values), -np.inf, values)))
    return float(values[index]), float(v[index])
