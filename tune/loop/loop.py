"""The sampled haptic loop after the bilinear transform, a polynomial in w affine in K, B, M.

With z = (1+w)/(1-w) every factor of the loop has exact coefficients (z-1 → 2w, z → 1+w,
z-ε → (1-ε)+(1+ε)w, z-a → (1-a)+(1+a)w, all over 1-w), so the polynomial is a product of factors
and nothing cancels however small δ = bT/m is. Stable means all its roots lie in Re w < 0.

The damping of a lightly damped root is a small part of every coefficient of the expanded
polynomial; where it decides, the coefficients know a boundary to seven digits only. `Factors` lose
nothing of it. `ClosedLoop` is what poles and frequency responses are read from: a frequency ω is
v = tan(ωT/2), w = jv, and v runs from 0 to ∞ (Nyquist).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from math import comb
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from identification import Device
from tune.documents import LoopError, estimators
from tune.documents.estimators import DIFFERENCES, Derivative, FilterKind, filter_of, idle_settings
from tune.documents.scene import Effects, Hand
from tune.loop.plant import (
    HandNumbers,
    HoldEquivalent,
    ModeNumbers,
    SampledPlant,
    ideal_equivalent,
    split_delay,
)
from tune.loop.polynomials import (
    DIFFERENCE,
    LATE,
    ONE,
    ComplexArray,
    FloatArray,
    Polynomial,
    pad_coefficients,
    part_of,
    product,
    slope,
    spread,
)

if TYPE_CHECKING:
    from tune.documents.profile import LoopProfile

#: Samples. Each adds one to the degree; beyond some 80 doubles no longer hold the polynomial.
LONGEST_WINDOW = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """Filters of the estimated velocity and acceleration; None is no filter.

    Velocity is a backward difference (z-1)/(T·z) times its filter, acceleration the square of the
    difference times its own; a window of n samples takes the velocity as (z^n - 1)/(n·T·z^n). Kinds
    and orders are those of `tune.documents.estimators`.

    Attributes:
        velocity_filter_hz, acceleration_filter_hz: cut-offs f, Hz, or None.
        velocity_filter, acceleration_filter: low-pass or tracking.
        velocity_filter_order, acceleration_filter_order: poles, or states.
        filter_damping_ratio: ζ in (0, 1] of pairs of poles: 1 two equal poles, 0.7071 Butterworth.
        velocity_window_samples: n, samples of a moving window instead of a filter, or None.

    Raises:
        LoopError: what is no number, a cut-off that is not positive, an order, ratio or window that
            does not exist, a window together with a cut-off.
    """

    velocity_filter_hz: float | None = None
    acceleration_filter_hz: float | None = None
    velocity_filter: FilterKind = "low-pass"
    acceleration_filter: FilterKind = "low-pass"
    velocity_filter_order: int = 1
    acceleration_filter_order: int = 2
    filter_damping_ratio: float = 1.0
    velocity_window_samples: int | None = None

    def __post_init__(self) -> None:
        for name in (each.name for each in fields(self) if not isinstance(each.default, str)):
            kind, what = (Integral, "whole ") if name.endswith("samples") else (Real, "")
            if not isinstance(value := getattr(self, name), kind | None):
                raise LoopError(f"{name} must be one {what}number, not {value!r}")
        for which in estimators.DERIVATIVES:
            kind, cutoff, order = filter_of(self, which)
            if cutoff is not None and not 0 < cutoff < np.inf:
                seen = f"{which}_filter_hz must be positive, not {cutoff:g}"
                raise LoopError(f"{seen}; None is no filter")
            if wrong := estimators.strange_order(which, kind, order):
                raise LoopError(wrong)
        ratio, count = self.filter_damping_ratio, self.velocity_window_samples
        if not 0 < ratio <= 1:
            raise LoopError(f"filter_damping_ratio must be in (0, 1], not {ratio:g}")
        if count is not None and not 1 <= count <= LONGEST_WINDOW:
            raise LoopError(f"velocity_window_samples must be 1 to {LONGEST_WINDOW}, not {count}")
        if count is not None and self.velocity_filter_hz is not None:
            raise LoopError(
                f"velocity_window_samples {count} and velocity_filter_hz "
                f"{self.velocity_filter_hz:g} exclude each other; give one of them"
            )


def used_filters(filters: Filters, effects: Effects) -> Filters:
    """The filters of the effects that are there; the others would only add poles of their own."""
    acting = {"damping": effects.damping is not None, "mass": effects.mass is not None}
    return replace(filters, **idle_settings(filters, **acting))


def filters_of(loop: LoopProfile) -> Filters:
    """The filters that a profile names."""
    return Filters(**loop.filter_settings())


class _Estimator(NamedTuple):
    """A transfer function in w: numerator over the product of its factors, times T or T²."""

    numerator: Polynomial
    factors: tuple[Polynomial, ...]


class Law(NamedTuple):
    """The control law over one denominator, α's numerator too; those of β and γ; its estimators."""

    denominator: Polynomial
    beta: Polynomial
    gamma: Polynomial
    velocity: _Estimator
    acceleration: _Estimator


def _common_denominator(velocity: _Estimator, acceleration: _Estimator) -> Law:
    """Both estimates over the least common multiple of their denominators."""
    missing = list(velocity.factors)
    only_acceleration: list[Polynomial] = []
    for factor in acceleration.factors:
        alike = [np.array_equal(factor.value, other.value) for other in missing]
        if any(alike):
            missing.pop(alike.index(True))
        else:
            only_acceleration.append(factor)
    denominator = ONE.times(*acceleration.factors, *missing)
    return Law(
        denominator=denominator,
        beta=velocity.numerator.times(*only_acceleration),
        gamma=acceleration.numerator.times(*missing),
        velocity=velocity,
        acceleration=acceleration,
    )


@lru_cache(maxsize=64)
def _law_at(filters: Filters, sample_time: float) -> Law:
    return _law(filters, np.array(sample_time))


def _law(filters: Filters, sample_time: FloatArray) -> Law:
    """The law of filters at some sample times, of any shape."""

    def behind(which: Derivative) -> _Estimator:
        """The differences behind their filter."""
        kind, cutoff, order = filter_of(filters, which)
        times = DIFFERENCES[which]
        numerator = ONE.times(*[DIFFERENCE] * times)
        if cutoff is None:
            return _Estimator(numerator, (LATE,) * times)
        angle = 2 * np.pi * cutoff * sample_time
        factors, gain, lag = _low_pass(order, filters.filter_damping_ratio, angle)
        late = order - times
        if estimators.leads(which, kind, order):
            # 1 + ℓ·(z-1)/z → (1 + (1+2ℓ)w)/(1+w), the lag of the differences in it.
            numerator = numerator.times(Polynomial.exact(1.0, 1 + times + 2 * lag))
            late -= 1
        numerator = numerator.times(*[LATE] * max(late, 0))
        return _Estimator(numerator.scaled(gain), (*(LATE,) * max(-late, 0), *factors))

    window = filters.velocity_window_samples
    if window is None:
        velocity = behind("velocity")
    else:
        # (1+w)^n - (1-w)^n: the odd powers, twice.
        odd = [2 * comb(window, k) * (k % 2) / window for k in range(window + 1)]
        velocity = _Estimator(Polynomial.exact(*odd), (LATE,) * window)
    return _common_denominator(velocity, behind("acceleration"))


def _low_pass(
    order: int, ratio: float, angle: FloatArray
) -> tuple[tuple[Polynomial, ...], FloatArray, FloatArray]:
    """Factors of z - a and z² - t·z + p, the product of 1 - a and 1 - t + p, lag in samples."""
    loss = -np.expm1(-angle)
    line, single = Polynomial.exact(loss, 1 + np.exp(-angle)), 1 / np.expm1(angle)
    if order >= 2 and ratio < 1:
        turned = np.sqrt((1 - ratio) * (1 + ratio))
        pair = _oscillation(ratio * angle, turned * angle)
        lag = 2 * (1 / np.expm1(angle * complex(ratio, turned))).real + (order - 2) * single
        return (pair, *(line,) * (order - 2)), pair.value[0] * loss ** (order - 2), lag
    gain = loss if order == 1 else loss * loss * loss ** (order - 2)
    return (line,) * order, gain, order * single


def _oscillation(decay: FloatArray, angle: FloatArray) -> Polynomial:
    """z² - t·z + p of poles exp(-decay ± j·angle): (1-t+p) + 2(1-p)w + (1+t+p)w²."""
    loss, left = -np.expm1(-decay), np.exp(-decay)
    near = loss * loss + 4 * left * np.sin(angle / 2) ** 2
    far = loss * loss + 4 * left * np.cos(angle / 2) ** 2
    value = np.stack([near, -2 * np.expm1(-2 * decay), far])
    # The rounding of the angle, against which 1 ± t + p may be small.
    slack = 2 * left * np.abs(angle * np.sin(angle))
    slack = np.stack([slack, np.zeros_like(slack), slack])
    return Polynomial(value=value, size=np.abs(value) + slack)


class Terms(NamedTuple):
    """Coefficients of 1, α, β and γ in the loop polynomial, each (degree+1, *shape), by power."""

    free: FloatArray
    alpha: FloatArray
    beta: FloatArray
    gamma: FloatArray


class Transfer(NamedTuple):
    """Plant and control law apart, for transfer functions other than the stability polynomial.

    Each is (its degree+1, *shape), ascending in w. Position from force is (T²/m) times
    plant_numerator/plant_denominator, the delay included; force from position is -(m/T²) times
    (alpha·α + beta·β + gamma·γ)/law_denominator. Hence the terms of the loop: free is
    plant_denominator·law_denominator, that of each effect plant_numerator times its numerator.
    """

    plant_numerator: FloatArray
    plant_denominator: FloatArray
    law_denominator: FloatArray
    alpha: FloatArray
    beta: FloatArray
    gamma: FloatArray


#: Real and imaginary parts. Their arithmetic gives one number what it gives it among many; that of
#: complex arrays does not, in the last digit.
Parts = tuple[FloatArray, FloatArray]


def multiplied(a: Parts, b: Parts) -> Parts:
    """The product of complex numbers."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def divided(a: Parts, b: Parts) -> Parts:
    """The quotient of complex numbers."""
    size = b[0] * b[0] + b[1] * b[1]
    return (a[0] * b[0] + a[1] * b[1]) / size, (a[1] * b[0] - a[0] * b[1]) / size


class Factors(NamedTuple):
    """Plant and estimators as they are built, without any expanded product."""

    hold: HoldEquivalent
    law: Law

    def plant(self, v: FloatArray) -> Parts:
        """Position over force at w = jv, over T²/m; v is (points, *more, *shape)."""
        total = np.zeros(v.shape), np.zeros(v.shape)
        for numerator, denominator in self.hold.blocks:
            real, imaginary = divided(_at(numerator, v), _at(denominator, v))
            total = total[0] + real, total[1] + imaginary
        early = np.ones(v.shape), -v
        late = divided(early, (early[0], v))
        for factor in (late,) * self.hold.late + (early,) * (self.hold.early - self.hold.late):
            total = multiplied(total, factor)
        return total

    def laws(self, v: FloatArray) -> tuple[Parts, Parts, Parts]:
        """Force over position at w = jv of unit α, β and γ, of the shape of v, without the sign."""
        return (
            (np.ones(v.shape), np.zeros(v.shape)),
            _estimate(self.law.velocity, v),
            _estimate(self.law.acceleration, v),
        )


def _estimate(estimator: _Estimator, v: FloatArray) -> Parts:
    total = _at(estimator.numerator, v)
    for factor in estimator.factors:
        total = divided(total, _at(factor, v))
    return total


def _at(polynomial: Polynomial, v: FloatArray) -> Parts:
    """Value at w = jv; even and odd powers apart, so that neither rounds the other."""
    square = -v * v
    even = np.zeros(v.shape)
    odd = np.zeros(v.shape)
    for row in polynomial.value[0::2][::-1]:
        even = even * square + row
    for row in polynomial.value[1::2][::-1]:
        odd = odd * square + row
    return even, v * odd


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
        sampled = SampledPlant.of(device, hand, extra_delay_samples)
        return cls.around(sampled, filters or Filters())

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
        # Devices that are sampled alike share a law.
        step = float(T.flat[0])
        law = _law_at(filters, step) if np.all(step == T) else _law(filters, T)
        return replace(
            _closed(sampled.plant, law, sampled.delta),
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
        velocity = _Estimator(DIFFERENCE.scaled(1 - av), (Polynomial.exact(1 - av, 1 + av),))
        line = Polynomial.exact(1 - aa, 1 + aa)
        twice = DIFFERENCE.times(DIFFERENCE).scaled((1 - aa) * (1 - aa))
        law = _common_denominator(velocity, _Estimator(twice, (line, line)))
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


def part_of_loops(loop: Loop, part: slice, behind: int) -> Loop:
    """Some of the loops of an array, along the axis that is so many from its end."""

    def rows(whole: Any) -> Any:
        """Those of arrays and polynomials, in tuples however deep."""
        if whole is None or isinstance(whole, int):
            return whole
        if isinstance(whole, Polynomial):
            return Polynomial(value=rows(whole.value), size=rows(whole.size))
        if hasattr(whole, "_make"):
            return whole._make(map(rows, whole))
        if isinstance(whole, tuple):
            return tuple(map(rows, cast("tuple[Any, ...]", whole)))
        return part_of(whole, part, behind, leading=1)

    one, two, three = (part_of(scale, part, behind) for scale in loop.scales)
    return replace(
        loop,
        terms=rows(loop.terms),
        sizes=rows(loop.sizes),
        transfer=rows(loop.transfer),
        scales=(one, two, three),
        factors=rows(loop.factors),
    )


def _closed(plant: HoldEquivalent, law: Law, delta: FloatArray) -> Loop:
    """The loop of a plant and a law, in (α, β, γ)."""
    laws = (law.denominator, law.beta, law.gamma)
    terms = [plant.denominator.times(law.denominator), *(plant.numerator.times(x) for x in laws)]
    one = np.ones_like(delta)

    def shaped(part: FloatArray) -> FloatArray:
        return spread(part, one.shape) * one

    return Loop(
        terms=_padded(*(shaped(term.value) for term in terms)),
        sizes=_padded(*(shaped(term.size) for term in terms)),
        transfer=Transfer(
            *(shaped(part.value) for part in (plant.numerator, plant.denominator)),
            *(shaped(part.value) for part in (law.denominator, *laws)),
        ),
        scales=(one, one, one),
        factors=Factors(plant, law),
    )


def _combine(terms: Terms, values: tuple[FloatArray | None, ...]) -> FloatArray:
    total = terms.free
    for term, value in zip(terms[1:], values, strict=True):
        if value is not None:
            added = spread(term, value.shape) * value
            total = spread(total, value.shape) + spread(added, total.shape[1:])
    return total


def _padded(*parts: FloatArray) -> Terms:
    length = max(len(part) for part in parts)
    return Terms(*(pad_coefficients(part, length) for part in parts))


def stack_loops(loops: Sequence[Loop]) -> Loop:
    """Loops of shape (corners,), all grounded or all free, as one of shape (all corners,)."""
    if len(loops) == 1:
        return loops[0]
    # A loop of lower degree is multiplied by (1+w) as often as it takes. Its new poles lie at w =
    # -1, z = 0, where nothing is ever in doubt, and no verdict, limit or margin changes.
    degree = max(loop.degree for loop in loops)
    lifts = [degree - loop.degree for loop in loops]

    def joined(parts: Sequence[FloatArray], *, lift: bool = True) -> FloatArray:
        raised = list(parts)
        for place, times in enumerate(lifts if lift else ()):
            for _ in range(times):
                raised[place] = product(raised[place], LATE.value)
        length = max(len(one) for one in raised)
        return np.concatenate([pad_coefficients(one, length) for one in raised], axis=1)

    # Only what belongs to the plant is raised; the law stays as it is.
    transfers = zip(*(loop.transfer for loop in loops), strict=True)
    stiffness, damping, mass = map(
        np.concatenate, zip(*(loop.scales for loop in loops), strict=True)
    )
    return Loop(
        terms=Terms(*map(joined, zip(*(loop.terms for loop in loops), strict=True))),
        sizes=Terms(*map(joined, zip(*(loop.sizes for loop in loops), strict=True))),
        transfer=Transfer(*(joined(parts, lift=k < 2) for k, parts in enumerate(transfers))),
        scales=(stiffness, damping, mass),
        grounded=loops[0].grounded,
    )


#: Newton steps on the roots that the eigenvalues gave to six digits or more.
_POLISHES = 3
#: A longer step, relative, belongs to a cluster, where Newton's method is not to be trusted.
_LONGEST_STEP = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoop:
    """One device with its effects: open loop L = N/D, closed D + N, sensitivity S = D/(D+N)."""

    open: FloatArray  # D, shape (degree+1,), ascending in w
    added: FloatArray  # N, what the effects add, likewise
    closed: FloatArray  # D + N, likewise
    sample_time: float  # s; 1 for a dimensionless loop

    def poles(self) -> ComplexArray:
        """Poles in w, shape (degree,); a pole at z = -1 is infinite."""
        roots = np.full(len(self.closed) - 1, np.inf, dtype=np.complex128)
        found = _polished(np.roots(self.closed[::-1]).astype(np.complex128), self.closed)
        roots[: found.size] = found
        return roots


def closed_loop(loop: Loop, effects: Effects) -> ClosedLoop:
    """A loop of shape () with single values of effects."""
    closed, _ = loop.polynomial(effects)
    nothing_free = loop.terms._replace(free=np.zeros_like(closed))
    added = _combine(nothing_free, loop.dimensionless_effects(effects))
    # Where nothing holds the position the pole of free motion, w = 0, is divided out of D and N.
    drop = loop.lowest_power(effects)
    return ClosedLoop(
        open=loop.terms.free[drop:],
        added=added[drop:],
        closed=closed[drop:],
        sample_time=float(loop.scales[0] / loop.scales[1]),
    )


def _polished(roots: ComplexArray, polynomial: FloatArray) -> ComplexArray:
    """Roots improved by Newton's method on the polynomial itself."""
    derivative = slope(polynomial)
    for _ in range(_POLISHES):
        with np.errstate(all="ignore"):
            step = np.polynomial.polynomial.polyval(roots, polynomial)
            step = step / np.polynomial.polynomial.polyval(roots, derivative)
            good = np.abs(step) < _LONGEST_STEP * np.abs(roots)
        roots = np.where(good, roots - np.where(good, step, 0), roots)
    return roots
