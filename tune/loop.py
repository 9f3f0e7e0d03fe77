"""Loop: the sampled haptic loop as a real polynomial in w, affine in K, B and M.

With z = (1+w)/(1-w) every factor of the loop has exact coefficients (z-1 → 2w, z → 1+w,
z-ε → (1-ε)+(1+ε)w, z-a → (1-a)+(1+a)w, all over 1-w), so the polynomial is a product of factors
and nothing cancels however small δ = bT/m is. Stable means all its roots lie in Re w < 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification import Device, Plant
from tune.effects import Effects
from tune.errors import LoopError

FloatArray = NDArray[np.float64]

#: A delay within this part of a sample of a whole number is that number; clocks are not better.
WHOLE = 1e-6
#: Samples. From 23 on, doubles no longer hold the coefficients of the polynomial in w and every
#: verdict would be no; a loop that late is refused instead.
LONGEST_DELAY = 22


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """First-order low-passes of the estimated velocity and acceleration; None is no filter.

    Velocity is (1-a)(z-1)/(T(z-a)) with a = exp(-2π·f·T); acceleration is the square of that
    expression with its own cut-off. Without a filter a = 0: plain backward differences.

    Attributes:
        velocity_hz: cut-off of the velocity estimate, Hz, or None.
        acceleration_hz: cut-off of the acceleration estimate, Hz, or None.
    """

    velocity_hz: float | None = None
    acceleration_hz: float | None = None

    def poles(self, sample_time: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """(velocity, acceleration) poles a = exp(-2π·f·T), of the shape of sample_time (s)."""
        step = np.asarray(sample_time, dtype=np.float64)

        def pole(cutoff: float | None) -> FloatArray:
            return np.zeros_like(step) if cutoff is None else np.exp(-2 * np.pi * cutoff * step)

        return pole(self.velocity_hz), pole(self.acceleration_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """Coefficients of 1, α, β and γ in the loop polynomial, each (degree+1, *shape), by power."""

    free: FloatArray
    alpha: FloatArray
    beta: FloatArray
    gamma: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """A device, its delay and its filters as a polynomial in w, waiting for K, B and M.

    Attributes:
        terms: coefficients by effect, ascending in w.
        sizes: the same with every factor taken absolutely; rounding errors scale with these.
        controller: the control law over its denominator: α, β, γ numerators of force from
            position, and as ``free`` the plant's denominator with the delay; for transfer
            functions other than the stability polynomial.
        scales: (T²/m, T/m, 1/m): what turns (K, B, M) into (α, β, γ), each of the loop's shape.
    """

    terms: Terms
    sizes: Terms
    controller: Terms
    scales: tuple[FloatArray, FloatArray, FloatArray]

    @classmethod
    def from_parts(
        cls,
        device: Device,
        filters: Filters | None = None,
        hand: None = None,
        *,
        extra_delay_samples: int = 0,
    ) -> Loop:
        """The loop of a device at its best estimate.

        Args:
            device: mass, damping, sample time and delay are read.
            filters: of velocity and acceleration; None is plain backward differences.
            hand: an attached hand is not modelled yet; only None is accepted.
            extra_delay_samples: whole samples on top of the device's delay.

        Raises:
            LoopError: a hand, or a delay that is not a whole number of samples.
        """
        if hand is not None:
            raise LoopError(f"hand {hand!r} is not modelled yet; give None, the device alone")
        samples = whole_samples(device.delay.value, device.sample_time.value)
        return cls.from_numbers(
            mass=device.mass.value,
            damping=device.damping.value,
            sample_time=device.sample_time.value,
            delay_samples=samples + extra_delay_samples,
            filters=filters,
        )

    @classmethod
    def from_numbers(
        cls,
        *,
        mass: ArrayLike,
        damping: ArrayLike,
        sample_time: ArrayLike,
        delay_samples: int = 0,
        filters: Filters | None = None,
    ) -> Loop:
        """Loops for arrays of mass (kg), damping (N·s/m) and sample time (s), broadcast."""
        m, b, T = np.broadcast_arrays(*(np.asarray(x, float) for x in (mass, damping, sample_time)))
        if not (np.all(m > 0) and np.all(T > 0)):
            raise LoopError(f"mass and sample time must be positive, not {m.min():g}, {T.min():g}")
        poles = (filters or Filters()).poles(T)
        loop = cls.dimensionless(b * T / m, delay_samples, *poles)
        return cls(
            terms=loop.terms,
            sizes=loop.sizes,
            controller=loop.controller,
            scales=(T * T / m, T / m, 1 / m),
        )

    @classmethod
    def dimensionless(
        cls,
        delta: ArrayLike,
        delay_samples: int = 0,
        velocity_pole: ArrayLike = 0.0,
        acceleration_pole: ArrayLike = 0.0,
    ) -> Loop:
        """The loop in (δ, α, β, γ): stiffness, damping and mass of its effects are α, β, γ."""
        if delay_samples < 0:
            raise LoopError(f"delay must not be negative, not {delay_samples} samples")
        if delay_samples > LONGEST_DELAY:
            raise LoopError(
                f"delay is {delay_samples} samples, at most {LONGEST_DELAY} can be judged"
            )
        delta, av, aa = np.broadcast_arrays(
            *(np.asarray(x, float) for x in (delta, velocity_pole, acceleration_pole))
        )
        plant = Plant.at(delta)
        one = np.ones_like(delta)
        terms, controller = _assemble(plant, delay_samples, av, aa, _signed)
        return cls(
            terms=terms,
            sizes=_assemble(plant, delay_samples, av, aa, np.abs)[0],
            controller=controller,
            scales=(one, one, one),
        )

    @property
    def degree(self) -> int:
        """Degree of the polynomial in w."""
        return self.terms.free.shape[0] - 1

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


def whole_samples(delay: float, sample_time: float) -> int:
    """A delay in s as a whole number of samples. Raises LoopError when it is not one."""
    samples = delay / sample_time
    if abs(samples - round(samples)) > WHOLE * max(1.0, samples):
        raise LoopError(
            f"delay {delay:g} s is {samples:g} samples of {sample_time:g} s; only whole samples "
            f"are modelled yet. Use {np.ceil(samples) * sample_time:g} s, the next longer one"
        )
    return round(samples)


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


def _signed(values: FloatArray) -> FloatArray:
    return values


def _assemble(
    plant: Plant,
    delay: int,
    av: FloatArray,
    aa: FloatArray,
    read: Callable[[FloatArray], FloatArray],
) -> tuple[Terms, Terms]:
    """(loop, controller) of docs/theory.md, 1: ideal plant, delay, two filter poles.

    2w·[(1-ε)+(1+ε)w]·(1+w)^d·D + (ψ+χw)(1-w)^(1+d)·[α·D + β·(1-av)·2w·D/Dv + γ·(1-aa)²·4w²·D/Da²]
    with Dv = (1-av)+(1+av)w, Da likewise, and D their least common multiple Da²·Dv, or Da² where
    the two poles are one and the same.
    """

    def line(constant: FloatArray, slope: FloatArray) -> FloatArray:
        return read(np.stack([constant, slope]))

    zero, one = np.zeros_like(av), np.ones_like(av)
    w = line(zero, 2 * one)
    velocity, acceleration = line(1 - av, 1 + av), line(1 - aa, 1 + aa)
    shared = np.array_equal(av, aa)
    without_velocity = [acceleration] if shared else [acceleration, acceleration]
    without_acceleration = [] if shared else [velocity]
    denominator = _product(acceleration, acceleration, *without_acceleration)
    plant_denominator = _product(w, line(plant.loss, 1 + plant.epsilon), *[line(one, one)] * delay)
    laws = (
        denominator,
        _product(*without_velocity, w) * (1 - av),
        _product(*without_acceleration, w, w) * (1 - aa) ** 2,
    )
    held = _product(line(plant.psi, plant.chi), *[line(one, -one)] * (1 + delay))
    return (
        _terms(_product(plant_denominator, denominator), *(_product(held, law) for law in laws)),
        _terms(plant_denominator, *laws),
    )


def _terms(*parts: FloatArray) -> Terms:
    length = max(len(part) for part in parts)
    free, alpha, beta, gamma = (_padded(part, length) for part in parts)
    return Terms(free=free, alpha=alpha, beta=beta, gamma=gamma)


def _product(*factors: FloatArray) -> FloatArray:
    """Product of polynomials along the first axis."""
    total = factors[0]
    for factor in factors[1:]:
        grown = np.zeros((len(total) + len(factor) - 1, *total.shape[1:]))
        for power, coefficient in enumerate(factor):
            grown[power : power + len(total)] += total * coefficient
        total = grown
    return total


def _padded(part: FloatArray, length: int) -> FloatArray:
    missing = length - len(part)
    return np.concatenate([part, np.zeros((missing, *part.shape[1:]))]) if missing else part
