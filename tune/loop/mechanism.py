"""Modal model of the mechanism in continuous time: rigid mass, modes and a hand.

In units of the mass and the sample time, d0 = s² + δs + k is the rigid mass on its damper and on
the slope of its own force by position, di = s² + 2ζΩs + Ω² a
mode and h = μs² + ηs + κ the hand. With participations e at the encoder and p at the handle (1 for
the rigid mass) position over force is N/D, handle over force H/D,

    D = Π di + h·Σ pi² Π_{j≠i} dj                                  (matrix determinant lemma)
    N = Σ ei² Π_{j≠i} dj + h·Σ_{i<j} (ei·pj - ej·pi)² Π_{l≠i,j} dl     (Sherman-Morrison, Lagrange)
    H = Σ ei·pi Π_{j≠i} dj

Without a negative damping or slope every term of D and N is positive: nothing cancels. D is then
split into real quadratic factors and N, H into partial fractions over them. Close poles make the
terms of those large, and with them the sizes of what is put together from them. One file: modes,
hand and rigid mass are joined in one sum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification import Mode
from tune.documents.errors import LoopError
from tune.documents.scene import Hand
from tune.loop.polynomials import Polynomial
from tune.loop.quadratics import split_fractions, split_into_quadratics

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeNumbers:
    """One vibration mode: numbers, or arrays of shapes that broadcast.

    Attributes:
        frequency_hz: ω/2π, Hz.
        damping_ratio: ζ, not negative.
        at_encoder: e.
        at_handle: h.
    """

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

    def numbers(self) -> tuple[ArrayLike, ...]:
        """All four, as listed: numbers, or arrays of shapes that broadcast."""
        return self.frequency_hz, self.damping_ratio, self.at_encoder, self.at_handle


@dataclass(frozen=True, slots=True, kw_only=True)
class HandNumbers:
    """A hand at the handle; numbers, or arrays of shapes that broadcast.

    Attributes:
        mass: kg.
        damping: N·s/m.
        stiffness: N/m.
    """

    mass: ArrayLike
    damping: ArrayLike
    stiffness: ArrayLike

    @classmethod
    def of(cls, hand: Hand) -> HandNumbers:
        """The best estimate of a hand."""
        return cls(mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value)

    def numbers(self) -> tuple[ArrayLike, ...]:
        """All three, as listed: numbers, or arrays of shapes that broadcast."""
        return self.mass, self.damping, self.stiffness


@dataclass(frozen=True, slots=True, kw_only=True)
class Vibration:
    """A mode in units of the sample time, arrays of one shape.

    Attributes:
        damping: 2ζΩ, without unit.
        stiffness: Ω², without unit; Ω = ωT.
        encoder: e.
        handle: p.
    """

    damping: FloatArray
    stiffness: FloatArray
    encoder: FloatArray
    handle: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Grip:
    """A hand in units of mass and sample time, arrays of one shape: μ, η, κ."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """(r0 + r1·s)/(s² + a·s + b) of the motion, arrays of one shape.

    Attributes:
        a: damping of the block.
        b: stiffness of the block.
        blur: factor on the sizes of whatever comes of a and b.
        encoder: r0, r1 of the encoder.
        handle: r0, r1 of the handle.
    """

    a: FloatArray
    b: FloatArray
    blur: FloatArray
    encoder: Polynomial
    handle: Polynomial


def vibration_of(numbers: Sequence[FloatArray], T: FloatArray) -> Vibration:
    """The numbers of a mode at a sample time, s. Raises LoopError where it cannot be.

    Frequency (Hz), damping ratio and both participations have the shape of the loop, as has the
    sample time.
    """
    frequency, ratio, encoder, handle = numbers
    if not (np.all(frequency > 0) and np.all(ratio >= 0)):
        raise LoopError(
            "a mode needs a positive frequency and a damping ratio that is not negative, not "
            f"{np.min(frequency):g} Hz and {np.min(ratio):g}"
        )
    angle = 2 * np.pi * frequency * T
    return Vibration(
        damping=2 * ratio * angle, stiffness=angle * angle, encoder=encoder, handle=handle
    )


def grip_of(numbers: Sequence[FloatArray], m: FloatArray, T: FloatArray) -> Grip:
    """The numbers of a hand beside mass (kg) and sample time (s). Raises LoopError if negative.

    Mass, damping (N·s/m) and stiffness (N/m) have the shape of the loop, as have m and T.
    """
    mass, damping, stiffness = numbers
    if not (np.all(mass >= 0) and np.all(damping >= 0) and np.all(stiffness >= 0)):
        raise LoopError(
            "mass, damping and stiffness of a hand must not be negative, not "
            f"{np.min(mass):g} kg, {np.min(damping):g} N·s/m and {np.min(stiffness):g} N/m"
        )
    return Grip(mass=mass / m, damping=damping * T / m, stiffness=stiffness * T * T / m)


def parts_of(
    delta: FloatArray, spring: FloatArray, modes: Sequence[Vibration], grip: Grip | None
) -> tuple[Part, ...]:
    """The blocks of a mechanism; without a hand the rigid mass and each mode are their own.

    All arrays have the shape of the loop and no unit.

    Args:
        delta: δ = bT/m.
        spring: kT²/m of the device's own force by position, of either sign.
        modes: in units of the sample time.
        grip: in units of mass and sample time, or None.
    """
    one, zero = np.ones_like(delta), np.zeros_like(delta)
    if grip is None:
        rigid = Polynomial.exact(one, zero)
        return (
            Part(a=delta, b=spring, blur=one, encoder=rigid, handle=rigid),
            *(
                Part(
                    a=mode.damping,
                    b=mode.stiffness,
                    blur=one,
                    encoder=Polynomial.exact(mode.encoder**2, zero),
                    handle=Polynomial.exact(mode.encoder * mode.handle, zero),
                )
                for mode in modes
            ),
        )
    if not modes:
        mass = 1 + grip.mass
        share = Polynomial.exact(1 / mass, zero)
        damping, stiffness = delta + grip.damping, spring + grip.stiffness
        return (
            Part(
                a=damping / mass,
                b=stiffness / mass,
                # A negative damping or slope of the device may cancel that of the hand.
                blur=np.maximum(
                    _cancelled(damping, np.abs(delta) + grip.damping),
                    _cancelled(stiffness, np.abs(spring) + grip.stiffness),
                ),
                encoder=share,
                handle=share,
            ),
        )
    return _coupled(delta, spring, modes, grip)


def _cancelled(total: FloatArray, sizes: FloatArray) -> FloatArray:
    """By how much the sizes of what was added exceed the sum; 1 where nothing cancelled."""
    return np.maximum(1.0, sizes / np.where(total == 0, 1.0, np.abs(total)))


def _coupled(
    delta: FloatArray, spring: FloatArray, modes: Sequence[Vibration], grip: Grip
) -> tuple[Part, ...]:
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
        *(hand.times(others(i)).scaled(handle[i] ** 2) for i in range(count)),
    )
    numerator = others(0).plus(
        *(others(i).scaled(encoder[i] ** 2) for i in range(1, count)),
        *(
            hand.times(others(i, j)).scaled((encoder[i] * handle[j] - encoder[j] * handle[i]) ** 2)
            for i in range(count)
            for j in range(i + 1, count)
        ),
    )
    seen = others(0).plus(*(others(i).scaled(encoder[i] * handle[i]) for i in range(1, count)))
    lead = denominator.value[-1]
    quadratics = split_into_quadratics(denominator.scaled(1 / lead))
    first = split_fractions(numerator.scaled(1 / lead), quadratics)
    second = split_fractions(seen.scaled(1 / lead), quadratics)
    return tuple(
        Part(
            a=factor.a,
            b=factor.b,
            blur=factor.blur,
            encoder=at_encoder,
            handle=at_handle,
        )
        for factor, at_encoder, at_handle in zip(quadratics, first, second, strict=True)
    )
