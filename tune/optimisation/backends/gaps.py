"""Gaps: unstable gains between stable ones, as a smooth constraint on where they open.

With L the open loop, a gain s is on the boundary where s·L = -1. Below the gain that is asked for
L must not reach the negative real axis at all: a gap opens where the phase of -L, at one of its
least or greatest values over frequency, touches zero. That phase is smooth in the sizes where the
end of the stable gains jumps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Newton steps on the frequency, and the part of it that one may go.
_STEPS, _STRIDE = 6, 0.3
#: An extreme is found where the next step would be less than this part of the frequency.
_FOUND = 1e-6
#: The constraint where nothing is near to touching: kept by a radian.
_CLEAR = -1.0


def gap_phase(
    free: FloatArray,
    law: FloatArray,
    near: FloatArray,
    gain: float,
    broken: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """How far the phase is beyond touching, rad, and at which frequency v.

    Args:
        free: the loop without effects, (degree+1, loops), ascending powers of w.
        law: what the effects add, the same shape.
        near: frequencies to begin at, (candidates, loops), nan where unused.
        gain: that is asked for.
        broken: loops that have a gap.

    Returns:
        of shape (loops,): at most 0 where no gap is open; v is nan where no gap is near.
    """
    near = near[np.any(np.isfinite(near), axis=1)]
    if not len(near):
        return np.full(broken.shape, _CLEAR), np.full(broken.shape, np.nan)
    v = near.copy()
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            slope, curve, _ = _phase(free, law, v)
            step = np.clip(slope / curve, -_STRIDE * v, _STRIDE * v)
            v = v - step
        slope, curve, loop = _phase(free, law, v)
        phase = np.angle(-loop)
        found = (np.abs(slope / curve) <= _FOUND * v) & (np.abs(loop) * gain > 1)
        # Bent away from zero it does not touch yet; bent the other way it crosses twice, which in
        # a loop without a gap it may do at higher gains only.
        open_ = phase * curve < 0
        value = np.where(open_, np.abs(phase), -np.abs(phase))
        value = np.where(found & (open_ == broken), value, -np.inf)
    # Of open gaps the narrowest: others are the bends of the phase far from the axis.
    chosen = np.where(broken, np.argmin(np.where(value > 0, value, np.inf), axis=0), 0)
    chosen = np.where(broken, chosen, np.argmax(value, axis=0))[None]
    best = np.take_along_axis(value, chosen, axis=0)[0]
    place = np.take_along_axis(v, chosen, axis=0)[0]
    near_one = best > _CLEAR
    return np.where(near_one, best, _CLEAR), np.where(near_one, place, np.nan)


def _phase(
    free: FloatArray, law: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """(slope and second derivative to v of the phase of L, L) at w = jv."""
    (a, a1, a2), (b, b1, b2) = (_derivatives(part, v) for part in (free, law))
    slope = np.real(b1 / b - a1 / a)
    curve = -np.imag((b2 / b - (b1 / b) ** 2) - (a2 / a - (a1 / a) ** 2))
    return slope, curve, b / a


def _derivatives(part: FloatArray, v: FloatArray) -> tuple[ComplexArray, ...]:
    """A polynomial and two derivatives to w at w = jv, v of shape (candidates, loops)."""
    w = v * 1j
    value = np.zeros(w.shape, dtype=np.complex128)
    first, second = value.copy(), value.copy()
    for row in part[::-1]:
        second = second * w + 2 * first
        first = first * w + value
        value = value * w + row
    return value, first, second
