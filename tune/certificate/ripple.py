"""Encoder ripple by integrating |C/(1+GC)|² around the unit circle: a second opinion."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from flint import arb_poly

from tune.certificate.affine import ComplexArray
from tune.certificate.plant import sampled_plant
from tune.certificate.point import Point, Setting
from tune.certificate.polynomial import law_of, shift_to_one
from tune.certificate.precision import precision

#: Points on the half circle. The integrand is smooth; the mean converges like r^points for a
#: slowest pole of radius r, and the number is raised until two agree.
_FEWEST = 1 << 12
_MOST = 1 << 22
_AGREE = 1e-6


@lru_cache(maxsize=256)
def ripple_by_integration(point: Point, setting: Setting, resolution: float) -> float:
    """Force ripple, N rms, from white quantisation noise of variance resolution²/12.

    It is inf where it is too large for a double to hold.

    Where nothing holds the position and there is no spring, plant and law share z = 1, which is
    divided out. Polynomials are moved to powers of z - 1 before they become doubles: at low
    frequency those of z cancel.
    """
    with precision():
        plant, law = sampled_plant(point), law_of(setting, point.sample_time)
        zero = arb_poly([-1, 1])
        top = law.numerator * plant.denominator
        bottom = law.denominator * plant.denominator
        fed_back = law.numerator * plant.numerator
        if plant.integrates or law.vanishes:
            top = top * zero
        if plant.integrates and not law.vanishes:
            bottom = bottom * zero
        if law.vanishes and not plant.integrates:
            fed_back = fed_back * zero
        numerator, denominator = (shift_to_one(p) for p in (top, bottom + fed_back))
    value, count = np.nan, _FEWEST
    while count <= _MOST:
        angle = (np.arange(count) + 0.5) * (np.pi / count)
        away: ComplexArray = np.expm1(1j * angle)
        with np.errstate(all="ignore"):
            response = np.polyval(numerator, away) / np.polyval(denominator, away)
            energy = float(np.mean(np.abs(response) ** 2))
        if not np.isfinite(energy):
            return float("inf")
        previous, count = value, count * 4
        value = float(np.sqrt(energy / 12) * resolution)
        if abs(value - previous) <= _AGREE * value:
            break
    return value
