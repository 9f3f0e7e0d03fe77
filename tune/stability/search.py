"""Searches along one line: the last value that keeps to a limit, and the peak of a quotient.

scipy.optimize's bracketing searches want finite values and give a root; here values may be infinite
or jump, what is wanted is the last place seen to keep to the limit, and no scipy is loaded for it.

The peak of P(x)/Q(x), x = v², over all frequencies is found by level sets and no grid. Where
P - level·Q has no positive root the level is nowhere exceeded. From the largest value known, the
roots at that level enclose whatever exceeds it; the middles of those gaps give a larger value, and
so on; it converges quadratically (Bruinsma and Steinbuch 1990, for norms of transfer functions).
Levels need polynomials of half the degree that the stationary points would.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Gains and sizes this close to a boundary, relative, are taken to be on it: the verdicts decide
#: at 1e-9, and a written profile is rounded to six digits anyway.
CLOSE = 1e-9
#: Sizes below this part of the top are as good as nothing.
_NOTHING = 1e-15
#: Steps at most; regula falsi needs about eight, halving alone forty for the closest asked for.
_MOST_STEPS = 80


def last_kept(
    room: Callable[[float], float],
    kept: float,
    broken: float,
    *,
    room_kept: float,
    room_broken: float,
    close: float,
) -> float:
    """The last place seen to keep to a limit, ``close`` to one that does not.

    Regula falsi with the Illinois rule (Dowell and Jarratt, BIT 11, 1971, p. 168), halvings where a
    value is infinite. The room is what a place leaves to the limit, negative beyond it, as at
    ``broken``, which lies above ``kept``; it may be infinite, and may jump.
    """
    last = 0
    for _ in range(_MOST_STEPS):
        if broken - kept <= close:
            break
        part = 0.5
        if np.isfinite(room_kept) and np.isfinite(room_broken):
            part = float(np.clip(room_kept / (room_kept - room_broken), 0.0, 1.0))
        # A step that ends on the limit must leave room on both sides to end the search.
        place = float(np.clip(kept + part * (broken - kept), kept + close / 2, broken - close / 2))
        found = room(place)
        # An end that stays twice counts half, so that both ends move.
        if found >= 0:
            kept, room_kept = place, found
            room_broken = room_broken / 2 if last > 0 else room_broken
            last = 1
        else:
            broken, room_broken = place, found
            room_kept = room_kept / 2 if last < 0 else room_kept
            last = -1
    return kept


def last_within(
    value: Callable[[float], float], limit: float, top: float, first: float = 0.0
) -> float:
    """The size up to which a growing value keeps to a limit; inf where it does so to the top.

    Narrowed on logarithms from the top, the largest size looked at, or from ``first``; where the
    limit is kept there, sizes below do not matter. A value that is nan is beyond any limit. 0 where
    no size was seen to keep it.
    """

    def room(size: float) -> float:
        with np.errstate(all="ignore"):
            found = -float(np.log(value(size) / limit))
        return -np.inf if np.isnan(found) else found

    high, room_high = top, room(top)
    if room_high >= 0:
        return np.inf
    low, room_low = top, room_high
    if 0 < first < top:
        low, room_low = first, room(first)
    while room_low < -CLOSE:
        if low < _NOTHING * top:
            return 0.0
        high, room_high = low, room_low
        # In proportion, as the ripple of a small effect is, and a little less.
        low *= min(0.5, 0.9 * float(np.exp(room_low)) if np.isfinite(room_low) else 0.1)
        room_low = room(low)
    end = last_kept(
        lambda place: room(float(np.exp(place))),
        float(np.log(low)),
        float(np.log(high)),
        room_kept=room_low,
        room_broken=room_high,
        close=CLOSE,
    )
    return float(np.exp(end))


#: Levels are raised by this, relative: two roots that touch the axis must be seen as a pair.
_RAISED = 1e-13
#: A gain in value below this, relative, ends the search; the peak is flat to its square root.
_ENOUGH = 1e-12
#: Levels tried; from a start near a peak four are usual.
_MOST_LEVELS = 40
#: Roots this far from the real axis, relative, are still tried: near its top a peak's two roots
#: leave the axis by the square root of the rounding error. A false one costs one evaluation.
_NEARLY_REAL = 1e-3


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
    """Positive and nearly real roots of a polynomial in x, ascending."""
    roots = np.roots(polynomial[::-1])
    real = (roots.real > 0) & (np.abs(roots.imag) <= _NEARLY_REAL * roots.real)
    return np.sort(roots.real[real]).astype(np.float64)


def peak(
    value: Callable[[FloatArray], FloatArray],
    top: FloatArray,
    bottom: FloatArray,
    starts: FloatArray,
) -> tuple[float, float]:
    """(largest value, its v) of P/Q over v in [0, ∞].

    Both have shape (degree + 1,), ascending in x; Q is positive for x > 0, its last coefficient not
    zero. ``value`` is P/Q at finite v and may know better digits than the expanded P and Q;
    ``starts`` are places v where a peak may be expected, such as the imaginary parts of poles.
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
