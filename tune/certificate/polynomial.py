"""The closed loop in z in ball arithmetic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb, arb_poly

from tune.certificate.affine import FloatArray
from tune.certificate.plant import sampled_plant
from tune.certificate.point import ModePoint, Point, Setting
from tune.certificate.precision import BITS, precision

__all__ = [
    "BITS",
    "ClosedLoop",
    "Law",
    "ModePoint",
    "Point",
    "Setting",
    "closed_loop",
    "law_of",
    "precision",
    "shift_to_one",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoop:
    """D(z) + s·N(z), whose roots are the poles when all effects are multiplied by s.

    Where no spring acts, of the effects or of the hand, the pole z = 1 of free motion has been
    divided out of both.

    Attributes:
        open: D.
        feedback: N.
        integrates: D still has the exact root z = 1, which belongs to zero gain and to no other.
    """

    open: arb_poly
    feedback: arb_poly
    integrates: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """Force from position, numerator over denominator, in z.

    Attributes:
        numerator: divided by z - 1 where ``vanishes``.
        denominator: of the estimates that are used.
        vanishes: without a spring the law has a zero at z = 1.
    """

    numerator: arb_poly
    denominator: arb_poly
    vanishes: bool


def closed_loop(point: Point, setting: Setting) -> ClosedLoop:
    """Plant and law put together, at one point.

    The plain plant is equation (37) as printed; any other comes from the exponential of its matrix.
    """
    with precision():
        plant = sampled_plant(point)
        law = law_of(setting, point.sample_time)
        z_less_one = arb_poly([-1, 1])
        denominator = plant.denominator * law.denominator
        feedback = plant.numerator * law.numerator
        if not law.vanishes:
            if plant.integrates:
                denominator = denominator * z_less_one
            return ClosedLoop(open=denominator, feedback=feedback, integrates=plant.integrates)
        if not plant.integrates:
            return ClosedLoop(open=denominator, feedback=feedback * z_less_one, integrates=False)
        # With b = 0 free motion has z = 1 twice; the law's zero takes one of them away.
        damped = point.damping != 0 or (point.hand is not None and point.hand.damping != 0)
        return ClosedLoop(open=denominator, feedback=feedback, integrates=not damped)


def law_of(setting: Setting, sample_time: float) -> Law:
    """K + B·velocity + M·acceleration; only denominators of effects that act are there."""
    T = arb(sample_time)
    z, one = arb_poly([0, 1]), arb_poly([1])
    step = z - one
    velocity_top, velocity_bottom = _velocity(setting, T) if setting.damping else (one, one)
    acceleration_top, acceleration_bottom = (
        _acceleration(setting, T) if setting.mass else (one, one)
    )
    damper = velocity_top * acceleration_bottom * arb(setting.damping)
    inertia = step * acceleration_top * velocity_bottom * arb(setting.mass)
    denominator = velocity_bottom * acceleration_bottom
    if setting.stiffness:
        spring = denominator * arb(setting.stiffness)
        return Law(
            numerator=spring + step * (damper + inertia), denominator=denominator, vanishes=False
        )
    return Law(numerator=damper + inertia, denominator=denominator, vanishes=True)


def shift_to_one(polynomial: arb_poly) -> FloatArray:
    """Descending coefficients in powers of z - 1: those of z cancel at low frequency.

    The polynomial has balls as coefficients, shape (degree + 1,); they keep their units.
    """
    return np.array([float(c) for c in polynomial(arb_poly([1, 1])).coeffs()][::-1])


def _velocity(setting: Setting, T: arb) -> tuple[arb_poly, arb_poly]:
    """(numerator without its factor z - 1, denominator) of the velocity estimate."""
    if setting.velocity_window_samples:
        n = setting.velocity_window_samples
        return arb_poly([1 / (n * T)] * n), arb_poly([0] * n + [1])
    top, bottom = _filter(
        setting.velocity_filter_hz, setting.velocity_filter_order, setting.filter_damping_ratio, T
    )
    # (z - 1)/(Tz) takes away one z of the filter's numerator, where it has one.
    return _over_z(top, bottom, 1, T)


def _acceleration(setting: Setting, T: arb) -> tuple[arb_poly, arb_poly]:
    """(numerator without its factor (z - 1)², denominator) of the acceleration estimate."""
    top, bottom = _filter(
        setting.acceleration_filter_hz,
        setting.acceleration_filter_order,
        setting.filter_damping_ratio,
        T,
    )
    return _over_z(top, bottom, 2, T * T)


def _over_z(
    top: tuple[arb, int], bottom: arb_poly, power: int, scale: arb
) -> tuple[arb_poly, arb_poly]:
    gain, powers = top
    shared = min(powers, power)
    numerator = arb_poly([0] * (powers - shared) + [gain / scale])
    return numerator, bottom * arb_poly([0] * (power - shared) + [1])


def _filter(
    cutoff: float | None, order: int, ratio: float, T: arb
) -> tuple[tuple[arb, int], arb_poly]:
    """((gain, powers of z), denominator) of a low-pass."""
    if cutoff is None:
        return (arb(1), 0), arb_poly([1])
    rate = arb.pi() * (-2 * cutoff) * T
    if order == 1:
        a = rate.exp()
        return (1 - a, 1), arb_poly([-a, 1])
    zeta = arb(ratio)
    turn = -rate * (1 - zeta * zeta).sqrt() if ratio < 1 else arb(0)
    trace = 2 * (rate * zeta).exp() * turn.cos()
    product = (2 * rate * zeta).exp()
    return (1 - trace + product, 2), arb_poly([product, -trace, 1])
