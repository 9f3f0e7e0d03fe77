"""The sampled plant in w: modes and a hand, current lag, zero-order hold, a delay of any length.

The device as a controller meets it, before it has any filters; docs/theory.md, 1. In units of the
mass and the sample time, d0 = s² + δs + k is the rigid mass on its damper and on the slope of its
own force by position, di a mode and h the hand: position over force is N/D, which are split into
real quadratic factors and partial fractions over them. Without a negative damping or slope nothing
cancels. Close poles make the terms of fractions large, and with them the sizes of what is put
together from them.

The hold of each factor, with the force F[k-1] until the fraction f of the step and F[k] after it,
is z·(z² - t·z + p)·x = (b1·z² + b2·z + b3)·F, in w over (1-w)²

    (b1+b2+b3) + 2(b1-b3)w + (b1-b2+b3)w²

by integrals of the impulse response g(v) and its mirror image e(v) = exp(-a(1-v))·g(v), positive up
to half an oscillation: sums over nodes lose nothing, be poles real, complex, equal or zero. Poles
far outside what the nodes can follow have closed forms without cancellation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification import Device, Mode, Plant
from tune.documents import LoopError
from tune.documents.scene import Hand
from tune.loop.polynomials import (
    EARLY,
    LATE,
    ONE,
    FloatArray,
    Polynomial,
    Quadratic,
    split_fractions,
    split_into_quadratics,
)

#: Gauss-Legendre nodes on a step; 24 integrate exp(20·v) and sin(20·v) to the last bit.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
#: Poles beyond this (per sample) are left to the closed forms.
_NEAR = 20.0
#: b from which 1/b·(1 - ...) cancels no more than a digit where a pole is beyond ``_NEAR``.
_STIFF = 16.0


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


def _block(
    a: FloatArray, b: FloatArray, fraction: FloatArray | None
) -> tuple[Polynomial, Polynomial, Polynomial]:
    """Factors in w of second-order systems: z² - t·z + p, and numerators of x and x'.

    For arrays of a and b of one shape. The numerators are of degree 2 with a fraction f, and of
    degree 1 without, where 1+w cancelled.
    """
    motion = _Motion.of(a, b)
    total, total_size = _integral(motion, "sum", np.zeros_like(a), np.ones_like(a))
    skew, skew_size = _integral(motion, "difference", np.zeros_like(a), np.ones_like(a))
    left = np.exp(-motion.decay)
    real = (1 + np.exp(-motion.slow)) * (1 + np.exp(-motion.fast))
    bent = np.expm1(-motion.decay) ** 2 + 4 * left * np.cos(motion.angle / 2) ** 2
    # The rounding of the angle, against which 1 + t + p may be small.
    slack = 2 * left * np.abs(motion.angle * np.sin(motion.angle))
    far = np.where(motion.real, real, bent)
    middle = -2 * np.expm1(-a)
    sizes = b * total_size, np.abs(middle), far + slack
    denominator = _polynomial((b * total, middle, far), sizes)
    if fraction is None:
        g, size = motion.impulse(np.ones_like(a))
        return (
            denominator,
            _polynomial((total, skew), (total_size, skew_size)),
            _polynomial((np.zeros_like(a), 2 * g), (np.zeros_like(a), 2 * size)),
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
    return (
        denominator,
        _polynomial(
            (total, 2 * (first - last), bend), (total_size, 2 * (first_size + last_size), bend_size)
        ),
        _polynomial(
            (np.zeros_like(a), 2 * (g + e), 2 * (g - e)),
            (np.zeros_like(a), 2 * (g_size + e_size), 2 * (g_size + e_size)),
        ),
    )


def _polynomial(values: tuple[FloatArray, ...], sizes: tuple[FloatArray, ...]) -> Polynomial:
    return Polynomial(value=np.stack(values), size=np.stack(sizes))


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
    # Added node by node: the order of a sum depends on how many others there are.
    near = np.add.accumulate(weights * factor * value)[-1]
    near_size = np.add.accumulate(weights * np.abs(factor) * size)[-1]
    farthest = np.where(motion.real, np.abs(motion.fast), np.hypot(motion.decay, motion.angle))
    stiff = farthest > _NEAR
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


class ModeNumbers(NamedTuple):
    """One vibration mode, SI units, e and p; numbers, or arrays of shapes that broadcast."""

    frequency_hz: ArrayLike
    damping_ratio: ArrayLike
    at_encoder: ArrayLike
    at_handle: ArrayLike

    @classmethod
    def of(cls, mode: Mode) -> ModeNumbers:
        """The best estimate of a device's mode."""
        return cls(
            frequency_hz=mode.frequency_hz.value,
            damping_ratio=mode.damping_ratio.value,
            at_encoder=mode.at_encoder,
            at_handle=mode.at_handle,
        )


class HandNumbers(NamedTuple):
    """A hand at the handle, SI units; numbers, or arrays of shapes that broadcast."""

    mass: ArrayLike
    damping: ArrayLike
    stiffness: ArrayLike

    @classmethod
    def of(cls, hand: Hand) -> HandNumbers:
        """The best estimate of a hand."""
        return cls(mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value)


class _Vibration(NamedTuple):
    """A mode in units of the sample time: 2ζΩ, Ω², e and p, arrays of one shape."""

    damping: FloatArray
    stiffness: FloatArray
    encoder: FloatArray
    handle: FloatArray


class _Grip(NamedTuple):
    """A hand in units of mass and sample time, arrays of one shape: μ, η, κ."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray


#: (r0 + r1·s)/(s² + a·s + b) of the motion at the encoder, the numerator behind.
_Part = tuple[Quadratic, Polynomial]


def _vibration_of(numbers: Sequence[FloatArray], T: FloatArray) -> _Vibration:
    frequency, ratio, encoder, handle = numbers
    if not (np.all(frequency > 0) and np.all(ratio >= 0)):
        raise LoopError(
            "a mode needs a positive frequency and a damping ratio that is not negative, not "
            f"{np.min(frequency):g} Hz and {np.min(ratio):g}"
        )
    angle = 2 * np.pi * frequency * T
    return _Vibration(2 * ratio * angle, angle * angle, encoder, handle)


def _grip_of(numbers: Sequence[FloatArray], m: FloatArray, T: FloatArray) -> _Grip:
    mass, damping, stiffness = numbers
    if not (np.all(mass >= 0) and np.all(damping >= 0) and np.all(stiffness >= 0)):
        raise LoopError(
            "mass, damping and stiffness of a hand must not be negative, not "
            f"{np.min(mass):g} kg, {np.min(damping):g} N·s/m and {np.min(stiffness):g} N/m"
        )
    return _Grip(mass / m, damping * T / m, stiffness * T * T / m)


def _parts_of(
    delta: FloatArray, spring: FloatArray, modes: Sequence[_Vibration], grip: _Grip | None
) -> tuple[_Part, ...]:
    """Blocks of a mechanism; without a hand the rigid mass and each mode are their own."""
    one, zero = np.ones_like(delta), np.zeros_like(delta)
    if grip is None:
        rigid = Quadratic(delta, spring, one), Polynomial.exact(one, zero)
        own = (Quadratic(mode.damping, mode.stiffness, one) for mode in modes)
        shares = (Polynomial.exact(mode.encoder**2, zero) for mode in modes)
        return rigid, *zip(own, shares, strict=True)
    if not modes:
        mass = 1 + grip.mass
        share = Polynomial.exact(1 / mass, zero)
        damping, stiffness = delta + grip.damping, spring + grip.stiffness
        # A negative damping or slope of the device may cancel that of the hand.
        blur = np.maximum(
            _cancelled(damping, np.abs(delta) + grip.damping),
            _cancelled(stiffness, np.abs(spring) + grip.stiffness),
        )
        return ((Quadratic(damping / mass, stiffness / mass, blur), share),)
    return _coupled(delta, spring, modes, grip)


def _cancelled(total: FloatArray, sizes: FloatArray) -> FloatArray:
    """By how much the sizes of what was added exceed the sum; 1 where nothing cancelled."""
    return np.maximum(1.0, sizes / np.where(total == 0, 1.0, np.abs(total)))


def _coupled(
    delta: FloatArray, spring: FloatArray, modes: Sequence[_Vibration], grip: _Grip
) -> tuple[_Part, ...]:
    one = np.ones_like(delta)
    own = [Polynomial.exact(spring, delta, one)]
    own += [Polynomial.exact(mode.stiffness, mode.damping, one) for mode in modes]
    encoder = [one, *(mode.encoder for mode in modes)]
    handle = [one, *(mode.handle for mode in modes)]
    hand = Polynomial.exact(grip.stiffness, grip.damping, grip.mass)
    count = len(own)

    def others(*without: int) -> Polynomial:
        return Polynomial.exact(one).times(*(own[k] for k in range(count) if k not in without))

    # Each sum starts with its longest polynomial, so that all have room.
    denominator = others().plus(
        *(hand.times(others(i)).scaled(handle[i] ** 2) for i in range(count))
    )
    numerator = others(0).plus(
        *(others(i).scaled(encoder[i] ** 2) for i in range(1, count)),
        *(
            hand.times(others(i, j)).scaled((encoder[i] * handle[j] - encoder[j] * handle[i]) ** 2)
            for i in range(count)
            for j in range(i + 1, count)
        ),
    )
    lead = denominator.value[-1]
    quadratics = split_into_quadratics(denominator.scaled(1 / lead))
    shares = split_fractions(numerator.scaled(1 / lead), quadratics)
    return tuple(zip(quadratics, shares, strict=True))


#: Samples. A delay this close to a whole number of samples is that number: 0.0003 s over 0.0001 s
#: is 2.9999999999999996 in doubles.
WHOLE = 1e-9
#: Samples. From 23 on, doubles no longer hold the coefficients of the polynomial in w and every
#: verdict would be no; a loop that late is refused instead.
LONGEST_DELAY = 22


class HoldEquivalent(NamedTuple):
    """Position at the encoder from held force, over T²/m, in w."""

    numerator: Polynomial
    denominator: Polynomial
    early: int  # power of 1-w in the numerator
    late: int  # power of 1+w in the denominator
    # (numerator, denominator) of each; what is left of position is their sum
    blocks: tuple[tuple[Polynomial, Polynomial], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledPlant:
    """Position from force of devices, which any filters may be put around."""

    plant: HoldEquivalent
    delta: FloatArray  # bT/m; of the shape that all that was given broadcasts to
    mass: FloatArray  # likewise
    sample_time: FloatArray  # likewise
    grounded: bool  # a position that is bound, by a spring of the hand or the device's own force

    @classmethod
    def of(cls, device: Device, hand: Hand | None, extra_delay_samples: float) -> SampledPlant:
        """The device at its best estimate, alone or in a hand; see `Loop.from_parts`."""
        return cls.from_numbers(
            mass=device.mass.value,
            damping=device.damping.value,
            sample_time=device.sample_time.value,
            delay_samples=device.delay.value / device.sample_time.value + extra_delay_samples,
            modes=tuple(ModeNumbers.of(mode) for mode in device.modes),
            hand=None if hand is None else HandNumbers.of(hand),
            current_lag=0.0 if device.current_lag is None else device.current_lag.value,
            position_stiffness=device.slope_at_zero,
        )

    @classmethod
    def from_numbers(
        cls,
        *,
        mass: ArrayLike,
        damping: ArrayLike,
        sample_time: ArrayLike,
        delay_samples: ArrayLike = 0.0,
        modes: Sequence[ModeNumbers] = (),
        hand: HandNumbers | None = None,
        current_lag: ArrayLike = 0.0,
        position_stiffness: ArrayLike = 0.0,
    ) -> SampledPlant:
        """For numbers or arrays, broadcast to one shape; see `Loop.from_numbers`."""
        given = [mass, damping, sample_time, delay_samples, current_lag, position_stiffness]
        given += [number for mode in modes for number in mode]
        given += () if hand is None else hand
        m, b, T, delay, lag, k, *rest = np.broadcast_arrays(*(np.asarray(x, float) for x in given))
        if not m.size:
            raise LoopError(f"arrays of shape {m.shape} hold no device; give at least one")
        if not (np.all(m > 0) and np.all(T > 0)):
            raise LoopError(f"mass and sample time must be positive, not {m.min():g}, {T.min():g}")
        samples, fraction = split_delay(delay)
        if not np.all(lag >= 0):
            raise LoopError(f"current_lag must not be negative, not {lag.min():g} s")
        vibrations = [_vibration_of(rest[4 * k : 4 * k + 4], T) for k in range(len(modes))]
        grip = None if hand is None else _grip_of(rest[-3:], m, T)
        delta, sprung = b * T / m, bool(np.any(k != 0))
        plain = fraction is None and not vibrations and grip is None
        if plain and not sprung and not np.any(lag):
            plant = ideal_equivalent(delta, samples)
        else:
            parts = _parts_of(delta, k * T * T / m, vibrations, grip)
            lagged = lag / T if np.any(lag) else None
            plant = _general_equivalent(parts, samples, fraction, lagged)
        return cls(
            plant=plant,
            delta=delta,
            mass=m,
            sample_time=T,
            grounded=sprung or (grip is not None and bool(np.any(grip.stiffness > 0))),
        )


def split_delay(delay: FloatArray) -> tuple[int, FloatArray | None]:
    """Delays in samples as (whole samples, fraction of each or None where all are whole)."""
    least, most = float(np.min(delay)), float(np.max(delay))
    if not least >= 0:
        raise LoopError(f"delay must not be negative, not {least:g} samples")
    if not most <= LONGEST_DELAY:
        raise LoopError(f"delay is {most:g} samples, at most {LONGEST_DELAY} can be judged")
    near = np.round(delay)
    delay = np.where(np.abs(delay - near) <= WHOLE, near, delay)
    samples = int(np.floor(np.min(delay)))
    fraction = delay - samples
    if np.max(fraction) > 1:
        raise LoopError(
            f"delays from {least:g} to {most:g} samples have different whole parts; "
            "build a loop for each whole part"
        )
    return samples, fraction if np.any(fraction > 0) else None


def ideal_equivalent(delta: FloatArray, samples: int) -> HoldEquivalent:
    """Rigid mass and damper, (ψ+χw)(1-w) / (2w·[(1-ε)+(1+ε)w]), whole samples late."""
    plant = Plant.at(delta)
    top = Polynomial.exact(plant.psi, plant.chi)
    bottom = Polynomial.exact(0.0, 2.0).times(Polynomial.exact(plant.loss, 1 + plant.epsilon))
    return HoldEquivalent(
        numerator=_repeated(EARLY, samples + 1).times(top),
        denominator=_repeated(LATE, samples).times(bottom),
        early=samples + 1,
        late=samples,
        blocks=((top, bottom),),
    )


def _general_equivalent(
    parts: Sequence[_Part], samples: int, fraction: FloatArray | None, lag: FloatArray | None
) -> HoldEquivalent:
    """Any mechanism behind any delay, the time constant of the actuator in samples."""
    numerators: list[Polynomial] = []
    denominators: list[Polynomial] = []
    at_lag: list[Polynomial] = []
    for factor, whole in parts:
        denominator, position, rate = _block(factor.a, factor.b, fraction)
        share = whole
        if lag is not None:
            share, behind = _behind_lag(factor, whole, lag)
            at_lag.append(behind)
        both = _weighted(position, share, 0).plus(_weighted(rate, share, 1))
        numerators.append(_blurred(both, factor.blur))
        denominators.append(_blurred(denominator, factor.blur))
    if lag is not None:
        held, line = _lag_factors(lag, fraction)
        denominators.append(line)
        numerators.append(held.times(at_lag[0].plus(*at_lag[1:])))
    late = samples if fraction is None else samples + 1
    # The numerator of the sum of fractions over the product of all denominators.
    first, *others = (
        numerator.times(*denominators[:k], *denominators[k + 1 :])
        for k, numerator in enumerate(numerators)
    )
    return HoldEquivalent(
        numerator=_repeated(EARLY, samples + 1).times(first.plus(*others)),
        denominator=_repeated(LATE, late).times(*denominators),
        early=samples + 1,
        late=late,
        blocks=tuple(zip(numerators, denominators, strict=True)),
    )


@cache
def _repeated(factor: Polynomial, times: int) -> Polynomial:
    """A power of 1 + w or 1 - w. Integers, and so exact."""
    return ONE.times(*[factor] * times)


def _weighted(polynomial: Polynomial, share: Polynomial, power: int) -> Polynomial:
    """One coefficient of a share times a polynomial."""
    one = slice(power, power + 1)
    return polynomial.times(Polynomial(value=share.value[one], size=share.size[one]))


def _blurred(polynomial: Polynomial, blur: FloatArray) -> Polynomial:
    return Polynomial(value=polynomial.value, size=polynomial.size * blur)


def _behind_lag(
    factor: Quadratic, share: Polynomial, lag: FloatArray
) -> tuple[Polynomial, Polynomial]:
    """(r0 + r1·s)/(s²+as+b)/(1+τs) as a fraction over each; the second is a constant."""
    (r0, r1), (s0, s1) = share.value, share.size
    a, b, _ = factor
    # With n = 1 - aτ + bτ²: r0' = (r0(1 - aτ) + r1·bτ)/n, r1' = (r1 - r0·τ)/n, and over 1+τs (r0·τ²
    # - r1·τ)/n.
    common = 1 - a * lag + b * lag * lag
    sizes = 1 + np.abs(a) * lag + np.abs(b) * lag * lag
    blur = sizes / np.abs(common)
    value = np.stack([r0 * (1 - a * lag) + r1 * b * lag, r1 - r0 * lag]) / common
    size = np.stack([s0 * (1 + np.abs(a) * lag) + s1 * np.abs(b) * lag, s1 + s0 * lag])
    rest = (r0 * lag * lag - r1 * lag) / common
    rest_size = s0 * lag * lag + s1 * lag
    return (
        Polynomial(value=value, size=size * blur / np.abs(common)),
        Polynomial(value=rest[None], size=(rest_size * blur / np.abs(common))[None]),
    )


def _lag_factors(lag: FloatArray, fraction: FloatArray | None) -> tuple[Polynomial, Polynomial]:
    """(numerator, denominator) of 1/(1+τs) under the held force."""
    rate = 1 / np.where(lag > 0, lag, np.finfo(float).tiny)
    loss, left = -np.expm1(-rate), np.exp(-rate)
    line = Polynomial.exact(loss, 1 + left)
    if fraction is None:
        return Polynomial.exact(loss), line
    # From the force before: exp(-rate·(1-f)) - exp(-rate); from the new one 1 - exp(-rate·(1-f)).
    new = -np.expm1(-rate * (1 - fraction))
    old = np.exp(-rate * (1 - fraction)) * -np.expm1(-rate * fraction)
    value = np.stack(np.broadcast_arrays(loss, new - old))
    return Polynomial(value=value, size=np.stack(np.broadcast_arrays(loss, new + old))), line
