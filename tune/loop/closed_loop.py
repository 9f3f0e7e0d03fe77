"""One closed loop as polynomials in w: what its poles and its frequency response are read from.

With L = N/D the open loop, D = free and N what the effects add, the closed loop is D + N, the
sensitivity S = D/(D+N). A frequency ω is v = tan(ωT/2), w = jv: v runs from 0 to ∞ (Nyquist).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.loop import Loop

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Newton steps on the roots that the eigenvalues gave to six digits or more.
_POLISHES = 3
#: A longer step, relative, belongs to a cluster, where Newton's method is not to be trusted.
_LONGEST_STEP = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoop:
    """A single device with its effects.

    Attributes:
        open: D, ascending in w; shape (degree+1,).
        added: N, of the same shape.
        closed: D + N, of the same shape.
        sample_time: T, s; 1 for a dimensionless loop.
    """

    open: FloatArray
    added: FloatArray
    closed: FloatArray
    sample_time: float

    def poles(self) -> ComplexArray:
        """Poles in w, shape (degree,); a pole at z = -1 is infinite."""
        roots = np.full(len(self.closed) - 1, np.inf, dtype=np.complex128)
        found = polish_roots(np.roots(self.closed[::-1]).astype(np.complex128), self.closed)
        roots[: found.size] = found
        return roots

    def hertz(self, v: float) -> float:
        """The frequency f = atan(v)/(πT) of a place v on the axis."""
        return float(np.arctan(v) / (np.pi * self.sample_time))


def closed_loops(loop: Loop, effects: Effects) -> tuple[list[ClosedLoop], tuple[int, ...]]:
    """Every loop of the broadcast shape, in order, and that shape.

    Where nothing holds the position the pole of free motion, w = 0, is divided out of D and N.
    """
    closed, _ = loop.polynomial(effects)
    shape = closed.shape[1:]
    added = np.zeros_like(closed)
    parts = (loop.terms.alpha, loop.terms.beta, loop.terms.gamma)
    for term, value in zip(parts, loop.dimensionless_effects(effects), strict=True):
        if value is not None:
            added += spread(term, shape) * value
    free = np.broadcast_to(spread(loop.terms.free, shape), closed.shape)
    times = np.broadcast_to(loop.scales[0] / loop.scales[1], shape).reshape(-1)
    drop = loop.lowest_power(effects)
    columns = [part[drop:].reshape(len(part) - drop, -1) for part in (free, added, closed)]
    return [
        ClosedLoop(
            open=columns[0][:, i],
            added=columns[1][:, i],
            closed=columns[2][:, i],
            sample_time=float(time),
        )
        for i, time in enumerate(times)
    ], shape


def for_each(loop: Loop, effects: Effects, answer: Callable[[ClosedLoop], float]) -> FloatArray:
    """One number of each closed loop, in the broadcast shape."""
    loops, shape = closed_loops(loop, effects)
    return np.array([answer(one) for one in loops]).reshape(shape)


def spread(coefficients: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Coefficients (degree+1, *own) with room to broadcast against ``shape``."""
    missing = len(shape) - (coefficients.ndim - 1)
    return coefficients.reshape(len(coefficients), *(1,) * missing, *coefficients.shape[1:])


def value(polynomial: FloatArray, v: FloatArray) -> ComplexArray:
    """A polynomial in w at w = jv.

    The coefficients have shape (degree + 1,), ascending; v and the answer have one shape, whatever
    it is.
    """
    total = np.full(np.shape(v), polynomial[-1], dtype=np.complex128)
    for coefficient in polynomial[-2::-1]:
        total = total * (1j * v) + coefficient
    return total


def slope(polynomial: FloatArray) -> FloatArray:
    """Its derivative, ascending in w.

    The coefficients have shape (degree + 1,), those of the answer shape (degree,).
    """
    return polynomial[1:] * np.arange(1, len(polynomial))


def polish_roots(roots: ComplexArray, polynomial: FloatArray) -> ComplexArray:
    """Roots improved by Newton's method on the polynomial itself.

    Roots have any shape, which the answer has too; the coefficients have shape (degree + 1,),
    ascending.
    """
    derivative = slope(polynomial)
    for _ in range(_POLISHES):
        with np.errstate(all="ignore"):
            step = np.polynomial.polynomial.polyval(roots, polynomial)
            step = step / np.polynomial.polynomial.polyval(roots, derivative)
            good = np.abs(step) < _LONGEST_STEP * np.abs(roots)
        roots = np.where(good, roots - np.where(good, step, 0), roots)
    return roots
