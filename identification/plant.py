"""The exact zero-order-hold plant: what a mass with viscous damping does between two samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

#: Depth of the continued fraction of tanh; |x| <= 2 reaches the last bit well before it.
_DEPTH = 16
#: Above this |δ| the plain formula for χ loses no digits (1 - tanh(2)/2 = 0.52).
_PLAIN = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """Factors of the sampled plant at δ = bT/m, each of the shape of δ and finite at δ = 0.

    In w, with z = (1+w)/(1-w), the position answers the held force by
    (T²/m)·(ψ + χw)(1-w) / (2w·[(1-ε) + (1+ε)w]); docs/theory.md, 1.

    Attributes:
        epsilon: ε = exp(-δ), the pole of the velocity.
        loss: 1 - ε, from expm1.
        psi: ψ = (1-ε)/δ, 1 at δ = 0.
        chi: χ = (1+ε)/δ·(1 - tanh(δ/2)/(δ/2)), δ/6 near 0.
    """

    epsilon: FloatArray
    loss: FloatArray
    psi: FloatArray
    chi: FloatArray

    @classmethod
    def at(cls, delta: ArrayLike) -> Plant:
        """The factors at dimensionless damping δ = bT/m, equation (2); any shape, any sign."""
        delta = np.asarray(delta, dtype=np.float64)
        epsilon = np.exp(-delta)
        loss = -np.expm1(-delta)
        zero = delta == 0
        divisor = np.where(zero, 1.0, delta)
        psi = np.where(zero, 1.0, loss / divisor)
        half = np.clip(delta / 2, -_PLAIN / 2, _PLAIN / 2)
        square = half * half
        fraction = np.full_like(square, 2 * _DEPTH + 1)
        for odd in range(2 * _DEPTH - 1, 2, -2):
            fraction = odd + square / fraction
        # 1 - tanh(x)/x = x²/(F + x²) with F = 3 + x²/(5 + x²/(7 + ...)); divided by δ = 2x.
        near = half / (2 * (fraction + square))
        far = (1 - 2 * np.tanh(delta / 2) / divisor) / divisor
        chi = (1 + epsilon) * np.where(np.abs(delta) <= _PLAIN, near, far)
        return cls(epsilon=epsilon, loss=loss, psi=psi, chi=chi)
