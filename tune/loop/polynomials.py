"""Polynomials in w with a bound of the rounding errors of their coefficients.

A coefficient comes with a size: its error is at most a few units of roundoff of it. Products and
sums keep that true, because sizes are multiplied and added without signs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Unit roundoff of float64.
UNIT = 2.0**-53


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Polynomial:
    """Ascending coefficients, (degree+1, *shape), and their sizes, of the same shape."""

    value: FloatArray
    size: FloatArray

    @classmethod
    def exact(cls, *coefficients: FloatArray | float) -> Polynomial:
        """Coefficients in which nothing cancelled, constant first."""
        value = np.stack(np.broadcast_arrays(*(np.asarray(c, float) for c in coefficients)))
        return cls(value=value, size=np.abs(value))

    def scaled(self, factor: FloatArray | float) -> Polynomial:
        """Multiplied by a number, or an array of the loops' shape, known to its last digits."""
        single = np.asarray(factor, float)[None]
        return Polynomial(
            value=product(self.value, single), size=product(self.size, np.abs(single))
        )

    def times(self, *others: Polynomial) -> Polynomial:
        """The product."""
        value, size = self.value, self.size
        for other in others:
            value, size = product(value, other.value), product(size, other.size)
        return Polynomial(value=value, size=size)

    def plus(self, *others: Polynomial) -> Polynomial:
        """The sum."""
        value, size = self.value, self.size
        for other in others:
            value, size = total(value, other.value), total(size, other.size)
        return Polynomial(value=value, size=size)

    def same_as(self, other: Polynomial) -> bool:
        """Whether the two are one and the same factor, number for number."""
        return np.array_equal(self.value, other.value)


#: The polynomial 1.
ONE = Polynomial.exact(1.0)
#: z → 1 + w over 1 - w; also the factor that a delay of one sample adds to a denominator.
LATE = Polynomial.exact(1.0, 1.0)
#: What a delay of one sample, and the hold, add to a numerator.
EARLY = Polynomial.exact(1.0, -1.0)
#: z - 1 → 2w over 1 - w.
DIFFERENCE = Polynomial.exact(0.0, 2.0)


def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Product of two polynomials along the first axis; the other axes broadcast.

    Shapes are (degree + 1, ...), ascending; the unit is the product of both.
    """
    shape = _common(p, q)
    grown = np.zeros((len(p) + len(q) - 1, *shape))
    p = _lifted(p, shape)
    for power, coefficient in enumerate(q):
        grown[power : power + len(p)] += p * coefficient
    return grown


def total(p: FloatArray, q: FloatArray) -> FloatArray:
    """Sum of two polynomials along the first axis; the other axes broadcast.

    Shapes are (degree + 1, ...), ascending, of one unit.
    """
    shape = _common(p, q)
    grown = np.zeros((max(len(p), len(q)), *shape))
    grown[: len(p)] += _lifted(p, shape)
    grown[: len(q)] += _lifted(q, shape)
    return grown


def pad_coefficients(part: FloatArray, length: int) -> FloatArray:
    """With zeros for the powers that are missing.

    The part has shape (degree + 1, ...), ascending; the answer has shape (length, ...) and the unit
    of the part.
    """
    missing = length - len(part)
    return np.concatenate([part, np.zeros((missing, *part.shape[1:]))]) if missing else part


def _common(p: FloatArray, q: FloatArray) -> tuple[int, ...]:
    """The shape behind the axis of powers that both broadcast to."""
    own, other = p.shape[1:], q.shape[1:]
    return own if own == other else np.broadcast_shapes(own, other)


def _lifted(p: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    if p.ndim == len(shape) + 1:
        return p
    return p.reshape(len(p), *(1,) * (len(shape) - p.ndim + 1), *p.shape[1:])
