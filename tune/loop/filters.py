"""Filters: estimators of velocity and acceleration, as factors in w (bilinear transform)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tune.documents.errors import LoopError
from tune.loop.polynomials import DIFFERENCE, LATE, ONE, Polynomial

if TYPE_CHECKING:
    from tune.documents.effects import Effects
    from tune.documents.profile import LoopProfile

FloatArray = NDArray[np.float64]

#: Samples. Each adds one to the degree; beyond some 80 doubles no longer hold the polynomial.
LONGEST_WINDOW = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """Low-passes of the estimated velocity and acceleration; None is no filter.

    Velocity is a backward difference (z-1)/(T·z) times its filter, acceleration the square of the
    difference times its own. Order 1 is (1-a)·z/(z-a) with a = exp(-2π·f·T). Order 2 is
    (1-t+p)·z²/(z²-t·z+p) with poles exp(-2π·f·T·(ζ ± j√(1-ζ²))); at ζ = 1 that is order 1 twice.
    A window of n samples takes the velocity as (z^n - 1)/(n·T·z^n).

    Attributes:
        velocity_filter_hz: cut-off f of the velocity estimate, Hz, or None.
        acceleration_filter_hz: cut-off f of the acceleration estimate, Hz, or None.
        velocity_filter_order: 1 or 2.
        acceleration_filter_order: 1 or 2.
        filter_damping_ratio: ζ in (0, 1] of second-order filters: 1 two equal poles, 0.7071
            Butterworth.
        velocity_window_samples: n, samples of a moving window instead of a low-pass, or None.

    Raises:
        LoopError: a cut-off that is not positive, an order, ratio or window that does not exist,
            a window together with a cut-off.
    """

    velocity_filter_hz: float | None = None
    acceleration_filter_hz: float | None = None
    velocity_filter_order: Literal[1, 2] = 1
    acceleration_filter_order: Literal[1, 2] = 2
    filter_damping_ratio: float = 1.0
    velocity_window_samples: int | None = None

    def __post_init__(self) -> None:
        for name in ("velocity_filter_hz", "acceleration_filter_hz"):
            cutoff = getattr(self, name)
            if cutoff is not None and not 0 < cutoff < np.inf:
                raise LoopError(f"{name} must be positive, not {cutoff:g}; None is no filter")
        for name in ("velocity_filter_order", "acceleration_filter_order"):
            if getattr(self, name) not in {1, 2}:
                raise LoopError(f"{name} must be 1 or 2, not {getattr(self, name)!r}")
        if not 0 < self.filter_damping_ratio <= 1:
            raise LoopError(
                f"filter_damping_ratio must be in (0, 1], not {self.filter_damping_ratio:g}"
            )
        if self.velocity_window_samples is not None:
            if not 1 <= self.velocity_window_samples <= LONGEST_WINDOW:
                raise LoopError(
                    f"velocity_window_samples must be 1 to {LONGEST_WINDOW} samples, not "
                    f"{self.velocity_window_samples}"
                )
            if self.velocity_filter_hz is not None:
                raise LoopError(
                    f"velocity_window_samples {self.velocity_window_samples} and "
                    f"velocity_filter_hz {self.velocity_filter_hz:g} exclude each other; give one "
                    "of them"
                )


def used_filters(filters: Filters, effects: Effects) -> Filters:
    """The filters of the effects that are there; the others would only add poles of their own."""
    if effects.damping is None:
        filters = replace(filters, velocity_filter_hz=None, velocity_window_samples=None)
    if effects.mass is None:
        filters = replace(filters, acceleration_filter_hz=None)
    return filters


def filters_of(loop: LoopProfile) -> Filters:
    """The filters that a profile names."""
    return Filters(**loop.filter_settings())


class Estimator(NamedTuple):
    """A transfer function in w: numerator over the product of its factors, times T or T²."""

    numerator: Polynomial
    factors: tuple[Polynomial, ...]


class Law(NamedTuple):
    """The control law over one denominator: numerators of α, β and γ; and its estimators."""

    denominator: Polynomial
    alpha: Polynomial
    beta: Polynomial
    gamma: Polynomial
    velocity: Estimator
    acceleration: Estimator


def law_of(filters: Filters, sample_time: FloatArray) -> Law:
    """The law of filters at some sample times, of any shape."""
    return common_denominator(_velocity(filters, sample_time), _acceleration(filters, sample_time))


def common_denominator(velocity: Estimator, acceleration: Estimator) -> Law:
    """Both estimates over the least common multiple of their denominators."""
    missing = list(velocity.factors)
    only_acceleration: list[Polynomial] = []
    for factor in acceleration.factors:
        shared = next((k for k, other in enumerate(missing) if factor.same_as(other)), None)
        if shared is None:
            only_acceleration.append(factor)
        else:
            missing.pop(shared)
    denominator = ONE.times(*acceleration.factors, *missing)
    return Law(
        denominator=denominator,
        alpha=denominator,
        beta=velocity.numerator.times(*only_acceleration),
        gamma=acceleration.numerator.times(*missing),
        velocity=velocity,
        acceleration=acceleration,
    )


def first_order_velocity(pole: FloatArray, loss: FloatArray) -> Estimator:
    """(1-a)(z-1)/(z-a); ``loss`` is 1 - a."""
    return Estimator(DIFFERENCE.scaled(loss), (Polynomial.exact(loss, 1 + pole),))


def twofold_acceleration(pole: FloatArray, loss: FloatArray) -> Estimator:
    """The square of the first-order velocity; ``loss`` is 1 - a."""
    line = Polynomial.exact(loss, 1 + pole)
    return Estimator(DIFFERENCE.times(DIFFERENCE).scaled(loss * loss), (line, line))


def _velocity(filters: Filters, sample_time: FloatArray) -> Estimator:
    window = filters.velocity_window_samples
    if window is not None:
        # (1+w)^n - (1-w)^n: the odd powers, twice.
        odd = [2 * comb(window, k) * (k % 2) / window for k in range(window + 1)]
        return Estimator(numerator=Polynomial.exact(*odd), factors=(LATE,) * window)
    if filters.velocity_filter_hz is None:
        return Estimator(numerator=DIFFERENCE, factors=(LATE,))
    angle = 2 * np.pi * filters.velocity_filter_hz * sample_time
    if filters.velocity_filter_order == 1:
        return first_order_velocity(np.exp(-angle), -np.expm1(-angle))
    factors, gain = _second_order(filters, angle)
    return Estimator(DIFFERENCE.times(LATE).scaled(gain), factors)


def _acceleration(filters: Filters, sample_time: FloatArray) -> Estimator:
    twice = DIFFERENCE.times(DIFFERENCE)
    if filters.acceleration_filter_hz is None:
        return Estimator(numerator=twice, factors=(LATE, LATE))
    angle = 2 * np.pi * filters.acceleration_filter_hz * sample_time
    if filters.acceleration_filter_order == 1:
        loss = -np.expm1(-angle)
        line = Polynomial.exact(loss, 1 + np.exp(-angle))
        return Estimator(numerator=twice.scaled(loss), factors=(LATE, line))
    factors, gain = _second_order(filters, angle)
    return Estimator(numerator=twice.scaled(gain), factors=factors)


def _second_order(filters: Filters, angle: FloatArray) -> tuple[tuple[Polynomial, ...], FloatArray]:
    """Factors of z² - t·z + p, and 1 - t + p."""
    ratio = filters.filter_damping_ratio
    if ratio == 1.0:
        loss = -np.expm1(-angle)
        line = Polynomial.exact(loss, 1 + np.exp(-angle))
        return (line, line), loss * loss
    pair = _oscillation(ratio * angle, np.sqrt((1 - ratio) * (1 + ratio)) * angle)
    return (pair,), pair.value[0]


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
