"""Exact position of a mass with viscous damping under a held force, for any rate p = b/m."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.estimators.held import Held

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Below this |δ| the φ-functions are summed as series, above it taken from expm1.
_SERIES_BELOW = 0.5
#: Terms of the series: 0.5^17/17! is below the last bit.
_TERMS = 17


def phi(delta: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """φ1 = (1 - e^(-δ))/δ and φ2 = (1 - φ1)/δ, finite at δ = 0; any shape.

    Complex, so that an imaginary step far below rounding gives exact derivatives (Squire and
    Trapp, SIAM Review 40, 1998, p. 110), which a quotient near δ = 0 would not.
    """
    delta = np.asarray(delta, dtype=np.complex128)
    near = np.abs(delta) < _SERIES_BELOW
    small = np.where(near, delta, 0.0)
    # φ2 = Σ (-δ)^k/(k+2)!, by Horner; φ1 = 1 - δ·φ2.
    total = np.zeros_like(small)
    for k in range(_TERMS, 1, -1):
        total = (1 - small * total) / k
    large = np.where(near, 1.0, delta)
    first = -np.expm1(-large) / large
    return (
        np.where(near, 1 - small * total, first),
        np.where(near, total, (1 - first) / large),
    )


def response(column: Held, rate: complex, step: float) -> ComplexArray:
    """Position at n samples of q̈ + p·q̇ = column, starting at zero and at rest.

    Args:
        column: n - 1 intervals, force per mass.
        rate: p, 1/s, any sign, complex for derivatives.
        step: T, s.
    """
    speed, place = _push(rate, np.asarray(step))
    velocity = column.late * speed
    position = column.late * place
    fraction = np.broadcast_to(np.asarray(column.fraction), column.late.shape)
    turns = np.flatnonzero((fraction > 0) & (column.early != column.late))
    if turns.size:
        extra = (column.early - column.late)[turns]
        # A scalar fraction needs its φ-functions once, not once for each interval.
        span = step * (fraction[turns[:1]] if np.ndim(column.fraction) == 0 else fraction[turns])
        early_speed, early_place = _push(rate, span)
        left = step - span
        coast, _ = _push(rate, left)
        velocity[turns] += extra * early_speed * (1 - rate * coast)
        position[turns] += extra * (early_place + early_speed * coast)
    return _cascade(velocity, position, rate, step, start=0.0)


def coasting(count: int, rate: complex, step: float) -> ComplexArray:
    """(1 - e^(-pt))/p at ``count`` samples: position after unit velocity at the first."""
    nothing = np.zeros(count - 1, dtype=np.complex128)
    return _cascade(nothing, nothing, rate, step, start=1.0)


def _push(rate: complex, span: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Velocity and position after a unit force per mass for ``span`` s, from rest.

    The first is also the distance coasted in that time per unit of velocity.
    """
    first, second = phi(np.asarray(rate * span, dtype=np.complex128))
    return span * first, span**2 * second


def _cascade(
    velocity: ComplexArray, position: ComplexArray, rate: complex, step: float, *, start: float
) -> ComplexArray:
    """Positions from what each interval adds to velocity and to position."""
    from scipy.signal import lfilter

    coast = complex(_push(rate, np.asarray(step))[0])
    decay = 1 - rate * coast
    added = np.concatenate(([start], velocity))
    speed = np.asarray(lfilter([1.0], [1.0, -decay], added), dtype=np.complex128)
    return np.concatenate(([0.0], np.cumsum(coast * speed[:-1] + position)))
