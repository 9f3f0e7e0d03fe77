"""Box: the simultaneous region of what is not known exactly, and how 95 % intervals widen to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from identification.device.quantities import Quantity
from identification.errors import InvalidInputError
from identification.estimators.intervals import NORMAL_95

#: Probability that the simultaneous box holds every identified quantity.
BOX_CONFIDENCE = 0.999
#: Degrees of freedom from which Hotelling's T² is χ² to six digits.
_MANY = 1e6
#: Bits of balls in which quantiles are found, twice those of a double, and the halvings that bring
#: an octave down to the last bit of one. scipy's take a third of a second to import.
_BITS, _HALVINGS = 128, 56


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
    tail = 1 - confidence
    if freedom > _MANY:
        radius = np.sqrt(_chi_square_beyond(tail, count))
    elif freedom > count:
        spread = freedom - count + 1
        radius = np.sqrt(count * freedom / spread * _f_ratio_beyond(tail, count, spread))
    else:
        raise InvalidInputError(
            "covariance",
            f"degrees_of_freedom is {freedom:g} for {count} parameters",
            "Identify from a longer log",
        )
    return float(radius) / NORMAL_95


def widened(quantity: Quantity, factor: float) -> tuple[float, float]:
    """(low, high) of an interval widened about its value."""
    return (
        quantity.value - factor * (quantity.value - quantity.low),
        quantity.value + factor * (quantity.high - quantity.value),
    )


def widened_positive(quantity: Quantity, factor: float) -> tuple[float, float]:
    """(low, high) widened on a logarithmic scale, for what cannot be negative."""
    return (
        quantity.value * (quantity.low / quantity.value) ** factor,
        quantity.value * (quantity.high / quantity.value) ** factor,
    )


def _chi_square_beyond(tail: float, count: float) -> float:
    """The x that χ² of so many degrees of freedom exceeds with probability ``tail``."""
    half = _ball(count) / 2
    return _root(lambda x: (x / 2).gamma_upper(half, 1), tail)


def _f_ratio_beyond(tail: float, above: float, below: float) -> float:
    """The x that F of so many degrees of freedom above and below exceeds with probability tail."""
    first, second = _ball(above) / 2, _ball(below) / 2
    return _root(lambda x: (below / (below + above * x)).beta_lower(second, first, 1), tail)


def _ball(value: float) -> Any:
    """A number as a ball; the types that flint ships lack its special functions."""
    from flint import arb

    return arb(value)


def _root(falling: Callable[[Any], Any], value: float) -> float:
    """The x > 0 at which a falling function takes a value, to the last bit."""
    from flint import ctx

    with ctx.workprec(_BITS):
        low = high = 1.0
        while falling(_ball(high)) > value:
            low, high = high, 2 * high
        while not falling(_ball(low)) > value:
            low, high = low / 2, low
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if falling(_ball(middle)) > value:
                low = middle
            else:
                high = middle
        return high
