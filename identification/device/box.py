"""Box: the simultaneous region of what is not known exactly, and how 95 % intervals widen to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from identification.device.quantities import Quantity
from identification.errors import InvalidInputError
from identification.estimators.intervals import NORMAL_95

#: Probability that the simultaneous box holds every identified quantity.
BOX_CONFIDENCE = 0.999
#: Degrees of freedom from which Hotelling's T² is χ² to six digits.
_MANY = 1e6


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
    from scipy.special import chdtri, fdtri

    if freedom > _MANY:
        radius = np.sqrt(chdtri(count, 1 - confidence))
    elif freedom > count:
        spread = freedom - count + 1
        radius = np.sqrt(count * freedom / spread * fdtri(count, spread, confidence))
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
