"""Zero-order hold of a second-order system with a fractional delay, as factors in w.

For x'' + a·x' + b·x = u in units of the sample time, with the force F[k-1] until the fraction f of
the step and F[k] after it, z·(z² - t·z + p)·x = (b1·z² + b2·z + b3)·F. In w, over (1-w)²,

    (b1+b2+b3) + 2(b1-b3)w + (b1-b2+b3)w²

With the impulse response g(v) and its mirror image e(v) = exp(-a(1-v))·g(v), b1 is the integral of
g from 0 to 1-f, b3 that of e from 0 to f, the first coefficient that of g + e from 0 to 1, and the
last that of g - e less what the fraction moves. All integrands are positive up to half an
oscillation, so that sums over nodes lose nothing, whether the poles are real, complex, equal or
zero. Poles far outside what the nodes can follow have closed forms without cancellation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tune.loop.polynomials import Polynomial

FloatArray = NDArray[np.float64]

#: Gauss-Legendre nodes on a step; 24 integrate exp(20·v) and sin(20·v) to the last bit.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
#: Poles beyond this (per sample) are left to the closed forms.
_NEAR = 20.0
#: b from which 1/b·(1 - ...) cancels no more than a digit where a pole is beyond ``_NEAR``.
_STIFF = 16.0


class _Block(NamedTuple):
    """Factors in w of one second-order system: z² - t·z + p, and numerators of x and x'.

    These are of degree 2 with a fraction and 1 without, where 1+w cancelled.
    """

    denominator: Polynomial
    position: Polynomial
    rate: Polynomial


@dataclass(frozen=True, slots=True, kw_only=True)
class _Motion:
    """The impulse response g(v) for arrays of a and b; poles -slow and -fast, or σ ± jθ."""

    damping: FloatArray
    decay: FloatArray
    angle: FloatArray
    slow: FloatArray
    fast: FloatArray
    real: NDArray[np.bool_]

    @classmethod
    def of(cls, a: FloatArray, b: FloatArray) -> _Motion:
        decay = a / 2
        square = b - decay * decay
        real = square < 0
        root = np.sqrt(np.abs(square))
        fast = decay + np.copysign(root, decay)
        slow = np.where(real, b / np.where(real, fast, 1.0), 0.0)
        return cls(
            damping=a,
            decay=decay,
            angle=np.where(real, 0.0, root),
            slow=slow,
            fast=np.where(real, fast, 0.0),
            real=real,
        )

    def impulse(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(g, size) at v; the size covers the rounding of exponent and angle."""
        apart = np.where(self.real, self.fast - self.slow, 1.0)
        turning = np.where(self.angle > 0, self.angle, 1.0)
        wave = np.where(self.angle > 0, np.sin(self.angle * v) / turning, v)
        exponent = np.where(self.real, self.slow, self.decay) * v
        left = np.exp(-exponent)
        value = left * np.where(self.real, -np.expm1(-apart * v) / apart, wave)
        slack = np.where(self.real, 0.0, left * v * np.abs(np.cos(self.angle * v)))
        return value, np.abs(value) * (1 + np.abs(exponent)) + slack

    def mirror(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(e, size) at v, e = exp(-a(1-v))·g(v)."""
        value, size = self.impulse(v)
        left = np.exp(-self.damping * (1 - v))
        return left * value, left * size

    def stiff(self) -> NDArray[np.bool_]:
        """Where a pole is beyond what the nodes follow."""
        return np.where(self.real, np.abs(self.fast), np.hypot(self.decay, self.angle)) > _NEAR


def block(a: FloatArray, b: FloatArray, fraction: FloatArray | None) -> _Block:
    """Factors for arrays of a and b of one shape; fraction f, None for whole samples."""
    motion = _Motion.of(a, b)
    whole, whole_size = _integral(motion, "sum", np.zeros_like(a), np.ones_like(a))
    skew, skew_size = _integral(motion, "difference", np.zeros_like(a), np.ones_like(a))
    denominator = _denominator(motion, b * whole, b * whole_size)
    if fraction is None:
        g, size = motion.impulse(np.ones_like(a))
        return _Block(
            denominator=denominator,
            position=_polynomial((whole, skew), (whole_size, skew_size)),
            rate=_polynomial((np.zeros_like(a), 2 * g), (np.zeros_like(a), 2 * size)),
        )
    f = np.broadcast_to(fraction, a.shape)
    first, first_size = _integral(motion, "impulse", np.zeros_like(f), 1 - f)
    last, last_size = _integral(motion, "mirror", np.zeros_like(f), f)
    # b1 - b2 + b3 from whichever end of the step is nearer: at f = 0 it is the integral of g - e,
    # at f = 1 minus that.
    early = f <= 0.5
    lost, lost_size = _integral(motion, "impulse", 1 - f, f)
    kept, kept_size = _integral(motion, "mirror", f, 1 - f)
    bend = np.where(early, skew - 2 * (lost - last), -skew + 2 * (first - kept))
    bend_size = skew_size + 2 * np.where(early, lost_size + last_size, first_size + kept_size)
    g, g_size = motion.impulse(1 - f)
    e, e_size = motion.mirror(f)
    return _Block(
        denominator=denominator,
        position=_polynomial(
            (whole, 2 * (first - last), bend), (whole_size, 2 * (first_size + last_size), bend_size)
        ),
        rate=_polynomial(
            (np.zeros_like(a), 2 * (g + e), 2 * (g - e)),
            (np.zeros_like(a), 2 * (g_size + e_size), 2 * (g_size + e_size)),
        ),
    )


def _polynomial(values: tuple[FloatArray, ...], sizes: tuple[FloatArray, ...]) -> Polynomial:
    return Polynomial(value=np.stack(values), size=np.stack(sizes))


def _denominator(motion: _Motion, near: FloatArray, near_size: FloatArray) -> Polynomial:
    left = np.exp(-motion.decay)
    real = (1 + np.exp(-motion.slow)) * (1 + np.exp(-motion.fast))
    bent = np.expm1(-motion.decay) ** 2 + 4 * left * np.cos(motion.angle / 2) ** 2
    # The rounding of the angle, against which 1 + t + p may be small.
    slack = 2 * left * np.abs(motion.angle * np.sin(motion.angle))
    far = np.where(motion.real, real, bent)
    middle = -2 * np.expm1(-motion.damping)
    return Polynomial(
        value=np.stack([near, middle, far]), size=np.stack([near_size, np.abs(middle), far + slack])
    )


def _integral(
    motion: _Motion, kind: str, low: FloatArray, span: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(integral, size) of g, e, g + e or g - e from ``low`` over ``span``."""
    v = low + span * (1 + _NODES.reshape(-1, *(1,) * low.ndim)) / 2
    value, size = motion.impulse(v)
    rest = motion.damping * (1 - v)
    if kind == "mirror":
        factor = np.exp(-rest)
    elif kind == "sum":
        factor = 1 + np.exp(-rest)
    elif kind == "difference":
        factor = -np.expm1(-rest)
    else:
        factor = np.ones_like(v)
    weights = _WEIGHTS.reshape(-1, *(1,) * low.ndim) * span / 2
    near = np.sum(weights * factor * value, axis=0)
    near_size = np.sum(weights * np.abs(factor) * size, axis=0)
    stiff = motion.stiff()
    if not np.any(stiff):
        return near, near_size
    g, g_size = _closed(motion, low, span, mirrored=False)
    e, e_size = _closed(motion, low, span, mirrored=True)
    far = {"impulse": g, "mirror": e, "sum": g + e, "difference": g - e}[kind]
    far_size = {"impulse": g_size, "mirror": e_size}.get(kind, g_size + e_size)
    return np.where(stiff, far, near), np.where(stiff, far_size, near_size)


def _closed(
    motion: _Motion, low: FloatArray, span: FloatArray, *, mirrored: bool
) -> tuple[FloatArray, FloatArray]:
    """(integral, size) of g, or of e, where a pole is far."""
    b = np.where(motion.real, motion.slow * motion.fast, motion.decay**2 + motion.angle**2)
    b = np.where(b < _STIFF, 1.0, b)  # 1 where the closed forms do not divide by it
    apart = np.where(motion.real, motion.fast - motion.slow, 1.0)
    slow, fast = _decayed(motion.slow, span), _decayed(motion.fast, span)
    if mirrored:
        slow = np.exp(-motion.slow * (1 - low - span) - motion.fast) * slow
        fast = np.exp(-motion.fast * (1 - low - span) - motion.slow) * fast
    else:
        slow, fast = np.exp(-motion.slow * low) * slow, np.exp(-motion.fast * low) * fast

    def step(t: FloatArray) -> FloatArray:
        if mirrored:
            left = np.exp(-motion.damping * (1 - t))
            return -left * (_cosine(motion, t) - motion.decay * motion.impulse(t)[0]) / b
        return (1 - _cosine(motion, t) - motion.decay * motion.impulse(t)[0]) / b

    stiff = b > 1
    between = fast - slow if mirrored else slow - fast
    value = np.where(stiff, step(low + span) - step(low), between / apart)
    return value, np.where(stiff, (2 + 2 * motion.decay) / b, (slow + fast) / np.abs(apart))


def _decayed(rate: FloatArray, span: FloatArray) -> FloatArray:
    """Integral of exp(-rate·v) over a span from zero."""
    return np.where(rate == 0, span, -np.expm1(-rate * span) / np.where(rate == 0, 1.0, rate))


def _cosine(motion: _Motion, t: FloatArray) -> FloatArray:
    """exp(-σt)·cos θt."""
    real = (np.exp(-motion.slow * t) + np.exp(-motion.fast * t)) / 2
    return np.where(motion.real, real, np.exp(-motion.decay * t) * np.cos(motion.angle * t))
