"""The sampled plant in w: mechanism, current lag, zero-order hold, and a delay of any length.

The device as a controller meets it, before it has any filters. One file: one plant, ideal or
general.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification import Plant
from tune.documents.errors import LoopError
from tune.loop.mechanism import (
    Grip,
    HandNumbers,
    ModeNumbers,
    Part,
    Vibration,
    grip_of,
    parts_of,
    vibration_of,
)
from tune.loop.polynomials import EARLY, LATE, ONE, Polynomial
from tune.loop.zero_order_hold import block

FloatArray = NDArray[np.float64]

#: Samples. A delay this close to a whole number of samples is that number: 0.0003 s over 0.0001 s
#: is 2.9999999999999996 in doubles.
WHOLE = 1e-9
#: Samples. From 23 on, doubles no longer hold the coefficients of the polynomial in w and every
#: verdict would be no; a loop that late is refused instead.
LONGEST_DELAY = 22


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldEquivalent:
    """Zero-order-hold equivalent: position from held force, over T²/m, as polynomials in w.

    Attributes:
        numerator: of the encoder.
        handle: of the handle.
        denominator: of both.
        early: power of 1-w in the numerator.
        late: power of 1+w in the denominator.
        blocks: (numerator, denominator) of the terms whose sum is left.
    """

    numerator: Polynomial
    handle: Polynomial
    denominator: Polynomial
    early: int
    late: int
    blocks: tuple[tuple[Polynomial, Polynomial], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledPlant:
    """Position from force of devices, which any filters may be put around.

    Attributes:
        plant: in w, over T²/m.
        delta: δ = bT/m, of the shape that all that was given broadcasts to.
        mass: kg, of the same shape.
        sample_time: s, of the same shape.
        grounded: the position is bound, by a spring of the hand or by the device's own force.
    """

    plant: HoldEquivalent
    delta: FloatArray
    mass: FloatArray
    sample_time: FloatArray
    grounded: bool

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
        """For numbers or arrays, broadcast to one shape; as `Loop.from_numbers`, which says more.

        Raises:
            LoopError: a mass, sample time, delay, mode, hand or lag that cannot be.
        """
        given = [mass, damping, sample_time, delay_samples, current_lag, position_stiffness]
        given += [number for mode in modes for number in mode.numbers()]
        given += () if hand is None else hand.numbers()
        m, b, T, delay, lag, k, *rest = np.broadcast_arrays(*(np.asarray(x, float) for x in given))
        if not (np.all(m > 0) and np.all(T > 0)):
            raise LoopError(f"mass and sample time must be positive, not {m.min():g}, {T.min():g}")
        samples, fraction = split_delay(delay)
        if not np.all(lag >= 0):
            raise LoopError(f"current_lag must not be negative, not {lag.min():g} s")
        vibrations = [vibration_of(rest[4 * k : 4 * k + 4], T) for k in range(len(modes))]
        grip = None if hand is None else grip_of(rest[-3:], m, T)
        delta, sprung = b * T / m, bool(np.any(k != 0))
        plain = fraction is None and not vibrations and grip is None
        if plain and not sprung and not np.any(lag):
            plant = ideal_equivalent(delta, samples)
        else:
            plant = _general_equivalent(
                delta,
                samples,
                fraction,
                spring=k * T * T / m,
                modes=vibrations,
                grip=grip,
                lag=lag / T if np.any(lag) else None,
            )
        return cls(
            plant=plant,
            delta=delta,
            mass=m,
            sample_time=T,
            grounded=sprung or (grip is not None and bool(np.any(grip.stiffness > 0))),
        )


def split_delay(delay: FloatArray) -> tuple[int, FloatArray | None]:
    """Delays in samples as (whole samples, fraction of each or None where all are whole).

    Delays have the shape of the loop, and so have the fractions.

    Raises:
        LoopError: delays that are negative, too long, or more than a sample apart.
    """
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
    """Rigid mass and damper, (ψ+χw)(1-w) / (2w·[(1-ε)+(1+ε)w]), whole samples late.

    δ has the shape of the loop and no unit; positions are over T²/m.
    """
    plant = Plant.at(delta)
    top = Polynomial.exact(plant.psi, plant.chi)
    bottom = Polynomial.exact(0.0, 2.0).times(Polynomial.exact(plant.loss, 1 + plant.epsilon))
    numerator = _repeated(EARLY, samples + 1).times(top)
    return HoldEquivalent(
        numerator=numerator,
        handle=numerator,
        denominator=_repeated(LATE, samples).times(bottom),
        early=samples + 1,
        late=samples,
        blocks=((top, bottom),),
    )


def _general_equivalent(
    delta: FloatArray,
    samples: int,
    fraction: FloatArray | None,
    *,
    spring: FloatArray,
    modes: Sequence[Vibration],
    grip: Grip | None,
    lag: FloatArray | None,
) -> HoldEquivalent:
    """Any mechanism behind any delay; arrays of one shape.

    Args:
        delta: δ = bT/m.
        samples: whole samples of delay.
        fraction: of a sample more, in [0, 1], or None.
        spring: kT²/m of the device's own force by position.
        modes: in units of the sample time.
        grip: in units of mass and sample time, or None.
        lag: time constant of the actuator over the sample time, not negative, or None.
    """
    parts = parts_of(delta, spring, modes, grip)
    numerators: list[Polynomial] = []
    handles: list[Polynomial] = []
    denominators: list[Polynomial] = []
    at_lag: list[tuple[Polynomial, Polynomial]] = []
    for part in parts:
        factors = block(part.a, part.b, fraction)
        encoder, handle = part.encoder, part.handle
        if lag is not None:
            encoder, encoder_lag = _behind_lag(part, part.encoder, lag)
            handle, handle_lag = _behind_lag(part, part.handle, lag)
            at_lag.append((encoder_lag, handle_lag))
        for found, share in ((numerators, encoder), (handles, handle)):
            both = _weighted(factors.position, share, 0).plus(_weighted(factors.rate, share, 1))
            found.append(_blurred(both, part.blur))
        denominators.append(_blurred(factors.denominator, part.blur))
    if lag is not None:
        held, line = _lag_factors(lag, fraction)
        denominators.append(line)
        for found, which in ((numerators, 0), (handles, 1)):
            share = at_lag[0][which].plus(*(each[which] for each in at_lag[1:]))
            found.append(held.times(share))
    late = samples if fraction is None else samples + 1
    early = _repeated(EARLY, samples + 1)
    return HoldEquivalent(
        numerator=early.times(_over_all(numerators, denominators)),
        handle=early.times(_over_all(handles, denominators)),
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
    return polynomial.times(
        Polynomial(value=share.value[power : power + 1], size=share.size[power : power + 1])
    )


def _over_all(numerators: list[Polynomial], denominators: list[Polynomial]) -> Polynomial:
    """The numerator of the sum of fractions over the product of all denominators."""
    terms = [
        numerator.times(*(other for j, other in enumerate(denominators) if j != k))
        for k, numerator in enumerate(numerators)
    ]
    return terms[0].plus(*terms[1:])


def _blurred(polynomial: Polynomial, blur: FloatArray) -> Polynomial:
    return Polynomial(value=polynomial.value, size=polynomial.size * blur)


def _behind_lag(part: Part, share: Polynomial, lag: FloatArray) -> tuple[Polynomial, Polynomial]:
    """(r0 + r1·s)/(s²+as+b)/(1+τs) as a fraction over each; the second is a constant.

    With n = 1 - aτ + bτ²: r0' = (r0(1 - aτ) + r1·bτ)/n, r1' = (r1 - r0·τ)/n, and over 1+τs
    (r0·τ² - r1·τ)/n.
    """
    (r0, r1), (s0, s1) = share.value, share.size
    a, b = part.a, part.b
    common = 1 - a * lag + b * lag * lag
    sizes = 1 + np.abs(a) * lag + np.abs(b) * lag * lag
    blur = sizes / np.abs(common)
    value = np.stack([r0 * (1 - a * lag) + r1 * b * lag, r1 - r0 * lag]) / common
    size = np.stack(
        [
            s0 * (1 + np.abs(a) * lag) + s1 * np.abs(b) * lag,
            s1 + s0 * lag,
        ]
    )
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
