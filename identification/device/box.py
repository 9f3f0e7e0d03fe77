"""Box: the simultaneous region of what is not known exactly, and how 95 % intervals widen to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from identification.device.quantities import Quantity
from identification.errors import InvalidInputError
from identification.estimators.estimate import NORMAL_95

#: Probability that the simultaneous box holds every identified quantity.
BOX_CONFIDENCE = 0.999
#: Degrees of freedom from which Hotelling's T² is χ² to six digits.
_MANY = 1e6
#: Precision of its distributions, more than twice that of a number.
_BITS = 128


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Simultaneous region of what is not known exactly; each entry (low, high), SI units.

    Attributes:
        mass: kg.
        damping: N·s/m.
        sample_time: s.
        delay: s.
        position_stiffness: slope of the device's own force by position, N/m: of k·q, and of
            gravity its steepest, of either sign.
    """

    mass: tuple[float, float]
    damping: tuple[float, float]
    sample_time: tuple[float, float]
    delay: tuple[float, float]
    position_stiffness: tuple[float, float] = (0.0, 0.0)


@cache
def widening(count: int, freedom: float, confidence: float) -> float:
    """Factor from the half-width of a 95 % interval to that of the simultaneous box.

    The box bounds the joint confidence ellipsoid: Hotelling's T² with ``freedom`` degrees of
    freedom, χ² where they are many or infinite.

    Args:
        count: quantities that hold at once.
        freedom: degrees of freedom of their covariance.
        confidence: probability that all of them lie in the box.

    Raises:
        InvalidInputError: no more degrees of freedom than quantities.
    """
    if not freedom > count:
        raise InvalidInputError(
            "covariance",
            f"degrees_of_freedom is {freedom:g} for {count} parameters",
            "Identify from a longer log",
        )
    return math.sqrt(_square_radius(count, freedom, confidence)) / NORMAL_95


def _square_radius(count: int, freedom: float, confidence: float) -> float:
    """Quantile of Hotelling's T², or of χ² where the degrees of freedom are many.

    T²/(T² + freedom) is beta distributed (Anderson, An Introduction to Multivariate Statistical
    Analysis, 2003, section 5.2). Halved to the last bit in digits to spare; scipy.special, which
    has such quantiles, takes longer to load than a spring to be certified.
    """
    from flint import arb, ctx

    ball: Any = arb  # its stubs lack the special functions

    def is_below(square: float) -> bool:
        half = ball(count) / 2
        if freedom > _MANY:
            found = (ball(square) / 2).gamma_lower(half, 1)
        else:
            rest = (ball(freedom) - count + 1) / 2
            found = (ball(square) / (ball(square) + freedom)).beta_lower(half, rest, 1)
        return bool(found < confidence)

    with ctx.workprec(_BITS):
        low, high = 0.0, 1.0
        while is_below(high):
            low, high = high, 2 * high
        while low < (middle := (low + high) / 2) < high:
            low, high = (middle, high) if is_below(middle) else (low, middle)
    return high


def widen_interval(quantity: Quantity, factor: float) -> tuple[float, float]:
    """(low, high) of an interval widened about its value."""
    return (
        quantity.value - factor * (quantity.value - quantity.low),
        quantity.value + factor * (quantity.high - quantity.value),
    )


def widen_positive_interval(quantity: Quantity, factor: float) -> tuple[float, float]:
    """(low, high) widened on a logarithmic scale, for what cannot be negative."""
    return (
        quantity.value * (quantity.low / quantity.value) ** factor,
        quantity.value * (quantity.high / quantity.value) ** factor,
    )
