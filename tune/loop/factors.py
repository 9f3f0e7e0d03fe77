"""Factored loop on the stability boundary w = jv, without expanding any product.

The damping of a lightly damped root is a small part of every coefficient of the expanded
polynomial; where it decides, the coefficients know a boundary to seven digits only. Factor by
factor nothing of it is lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class Factors:
    """Plant and estimators as they are built; each polynomial (degree+1, *shape), ascending in w.

    Attributes:
        early: power of 1-w above the plant.
        late: power of 1+w below it.
        blocks: (numerator, denominator) of the terms the plant is a sum of.
        velocity: (numerator, factors of the denominator) of the damping's estimate, in 1/T.
        acceleration: (numerator, factors of the denominator) of the mass's estimate, in 1/T².
    """

    early: int
    late: int
    blocks: tuple[tuple[FloatArray, FloatArray], ...]
    velocity: tuple[FloatArray, tuple[FloatArray, ...]]
    acceleration: tuple[FloatArray, tuple[FloatArray, ...]]

    def plant(self, v: FloatArray) -> ComplexArray:
        """Position over force at w = jv, over T²/m.

        Args:
            v: (points, *more, *shape): whatever stands before the shape broadcasts.
        """
        total = np.zeros(v.shape, dtype=np.complex128)
        for numerator, denominator in self.blocks:
            total += _at(numerator, v) / _at(denominator, v)
        return total * (1 - 1j * v) ** self.early / (1 + 1j * v) ** self.late

    def laws(self, v: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Force over position at w = jv of unit α, β and γ, of the shape of v, without the sign."""
        return (
            np.ones(v.shape, dtype=np.complex128),
            _estimate(self.velocity, v),
            _estimate(self.acceleration, v),
        )


def _estimate(parts: tuple[FloatArray, tuple[FloatArray, ...]], v: FloatArray) -> ComplexArray:
    numerator, factors = parts
    total = _at(numerator, v)
    for factor in factors:
        total = total / _at(factor, v)
    return total


def _at(polynomial: FloatArray, v: FloatArray) -> ComplexArray:
    """Value at w = jv; even and odd powers apart, so that neither rounds the other."""
    square = -v * v
    even = np.zeros(v.shape)
    odd = np.zeros(v.shape)
    for row in polynomial[0::2][::-1]:
        even = even * square + row
    for row in polynomial[1::2][::-1]:
        odd = odd * square + row
    return even + 1j * v * odd
