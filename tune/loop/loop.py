"""Loop: the sampled haptic loop after the bilinear transform, a polynomial in w affine in K, B, M.

With z = (1+w)/(1-w) every factor of the loop has exact coefficients (z-1 → 2w, z → 1+w,
z-ε → (1-ε)+(1+ε)w, z-a → (1-a)+(1+a)w, all over 1-w), so the polynomial is a product of factors
and nothing cancels however small δ = bT/m is. Stable means all its roots lie in Re w < 0. One file:
one class and the ways to build it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification import Device
from tune.documents.effects import Effects
from tune.documents.scene import Hand
from tune.loop.coefficients import Terms, Transfer
from tune.loop.factors import Factors
from tune.loop.filters import (
    Filters,
    Law,
    common_denominator,
    first_order_velocity,
    law_of,
    twofold_acceleration,
)
from tune.loop.mechanism import HandNumbers, ModeNumbers
from tune.loop.polynomials import pad_coefficients
from tune.loop.sampled_plant import (
    HoldEquivalent,
    SampledPlant,
    ideal_equivalent,
    split_delay,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """A device, its delay, filters and hand as a polynomial in w, waiting for K, B and M.

    Attributes:
        terms: coefficients by effect, ascending in w.
        sizes: the same with every factor taken absolutely; rounding errors scale with these.
        transfer: plant and control law apart.
        scales: (T²/m, T/m, 1/m): what turns (K, B, M) into (α, β, γ), each of the loop's shape.
        grounded: a spring of the hand, or the device's own force by position, binds the position;
            without one the pole at z = 1 is free motion, and is left out of the judgement where no
            virtual spring is there either.
        factors: the same unexpanded, where known; it makes limits of lightly damped loops exact.
    """

    terms: Terms
    sizes: Terms
    transfer: Transfer
    scales: tuple[FloatArray, FloatArray, FloatArray]
    grounded: bool = False
    factors: Factors | None = None

    def __repr__(self) -> str:
        ground = "position bound" if self.grounded else "position free without a spring"
        return f"Loop(degree {self.degree} in w, shape {self.terms.free.shape[1:]}, {ground})"

    @classmethod
    def from_parts(
        cls,
        device: Device,
        filters: Filters | None = None,
        hand: Hand | None = None,
        *,
        extra_delay_samples: float = 0.0,
    ) -> Loop:
        """The loop of a device at its best estimate.

        Args:
            device: mass, damping, sample time, delay, modes, current lag and the slope of its own
                force by position, with gravity where the position is zero, are read.
            filters: of velocity and acceleration; None is plain backward differences.
            hand: attached at the handle, at its best estimate; None is the device alone.
            extra_delay_samples: on top of the device's delay.

        Raises:
            LoopError: a delay that is negative or too long.
        """
        return cls.from_numbers(
            mass=device.mass.value,
            damping=device.damping.value,
            sample_time=device.sample_time.value,
            delay_samples=device.delay.value / device.sample_time.value + extra_delay_samples,
            filters=filters,
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
        filters: Filters | None = None,
        modes: Sequence[ModeNumbers] = (),
        hand: HandNumbers | None = None,
        current_lag: ArrayLike = 0.0,
        position_stiffness: ArrayLike = 0.0,
    ) -> Loop:
        """Loops for numbers or arrays, broadcast to one shape, that of the loop.

        Args:
            mass: m, kg, positive.
            damping: b, N·s/m.
            sample_time: T, s, positive.
            delay_samples: any number from 0 on; in an array all lie within one sample.
            filters: of velocity and acceleration; None is plain backward differences.
            modes: vibration of the mechanism.
            hand: at the handle; None is the device alone.
            current_lag: time constant of the actuator, s.
            position_stiffness: slope of the device's own force by position, of either sign, N/m.

        Raises:
            LoopError: a mass, sample time, delay, mode, hand or lag that cannot be.
        """
        sampled = SampledPlant.from_numbers(
            mass=mass,
            damping=damping,
            sample_time=sample_time,
            delay_samples=delay_samples,
            modes=modes,
            hand=hand,
            current_lag=current_lag,
            position_stiffness=position_stiffness,
        )
        return cls.around(sampled, filters or Filters())

    @classmethod
    def around(cls, sampled: SampledPlant, filters: Filters) -> Loop:
        """The loops of sampled devices with certain filters."""
        T = sampled.sample_time
        return replace(
            _closed(sampled.plant, law_of(filters, T), sampled.delta),
            scales=(T * T / sampled.mass, T / sampled.mass, 1 / sampled.mass),
            grounded=sampled.grounded,
        )

    @classmethod
    def dimensionless(
        cls,
        delta: ArrayLike,
        delay_samples: int = 0,
        velocity_pole: ArrayLike = 0.0,
        acceleration_pole: ArrayLike = 0.0,
    ) -> Loop:
        """The loop in (δ, α, β, γ): stiffness, damping and mass of its effects are α, β, γ.

        δ and the poles are numbers, or arrays that broadcast to the shape of the loop.
        """
        delta, av, aa = np.broadcast_arrays(
            *(np.asarray(x, float) for x in (delta, velocity_pole, acceleration_pole))
        )
        samples, fraction = split_delay(np.asarray(delay_samples, float))
        assert fraction is None
        law = common_denominator(first_order_velocity(av, 1 - av), twofold_acceleration(aa, 1 - aa))
        return _closed(ideal_equivalent(delta, samples), law, delta)

    @property
    def degree(self) -> int:
        """Degree of the polynomial in w."""
        return self.terms.free.shape[0] - 1

    def has_free_pole(self, effects: Effects) -> bool:
        """Whether no spring, of the effects, a hand or the device, holds the position.

        The factor w of free motion (z = 1) then belongs to the structure and is not judged
        (docs/theory.md, 2).
        """
        return effects.position_free and not self.grounded

    def lowest_power(self, effects: Effects) -> int:
        """The power of w from which coefficients are judged: 1 where `has_free_pole`, else 0."""
        return 1 if self.has_free_pole(effects) else 0

    def dimensionless_effects(
        self, effects: Effects
    ) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
        """(α, β, γ), equations (10), (16), (22), in the loop's shape; absent effects are None."""
        K, B, M = (
            None if value is None else np.asarray(value * scale)
            for value, scale in zip(effects.arrays(), self.scales, strict=True)
        )
        return K, B, M

    def polynomial(self, effects: Effects) -> tuple[FloatArray, FloatArray]:
        """(coefficients, sizes), each (degree+1, *shape); sizes bound what the sum is made of."""
        values = self.dimensionless_effects(effects)
        return (
            _combine(self.terms, values),
            _combine(self.sizes, tuple(None if v is None else np.abs(v) for v in values)),
        )


def _closed(plant: HoldEquivalent, law: Law, delta: FloatArray) -> Loop:
    """The loop of a plant and a law, in (α, β, γ)."""
    laws = (law.alpha, law.beta, law.gamma)
    terms = [plant.denominator.times(law.denominator), *(plant.numerator.times(x) for x in laws)]
    one = np.ones_like(delta)

    def shaped(part: FloatArray) -> FloatArray:
        return part.reshape(len(part), *(1,) * (one.ndim - part.ndim + 1), *part.shape[1:]) * one

    return Loop(
        terms=_terms(*(shaped(term.value) for term in terms)),
        sizes=_terms(*(shaped(term.size) for term in terms)),
        transfer=Transfer(
            plant_numerator=shaped(plant.numerator.value),
            plant_denominator=shaped(plant.denominator.value),
            handle_numerator=shaped(plant.handle.value),
            law_denominator=shaped(law.denominator.value),
            alpha=shaped(law.alpha.value),
            beta=shaped(law.beta.value),
            gamma=shaped(law.gamma.value),
        ),
        scales=(one, one, one),
        factors=Factors(
            early=plant.early,
            late=plant.late,
            blocks=tuple((top.value, bottom.value) for top, bottom in plant.blocks),
            velocity=law.velocity.values(),
            acceleration=law.acceleration.values(),
        ),
    )


def _combine(terms: Terms, values: tuple[FloatArray | None, ...]) -> FloatArray:
    total = terms.free
    for term, value in zip((terms.alpha, terms.beta, terms.gamma), values, strict=True):
        if value is not None:
            total = _lift(total, value.ndim) + _lift(term, value.ndim) * value
    return total


def _lift(coefficients: FloatArray, dimensions: int) -> FloatArray:
    """Room for ``dimensions`` broadcast axes behind the axis of powers."""
    missing = dimensions - (coefficients.ndim - 1)
    if missing <= 0:
        return coefficients
    return coefficients.reshape(coefficients.shape[0], *(1,) * missing, *coefficients.shape[1:])


def _terms(*parts: FloatArray) -> Terms:
    length = max(len(part) for part in parts)
    free, alpha, beta, gamma = (pad_coefficients(part, length) for part in parts)
    return Terms(free=free, alpha=alpha, beta=beta, gamma=gamma)
