"""The closed loop in z, as printed, in ball arithmetic."""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb, arb_poly, ctx

#: Bits of every ball. The printed plant loses 2·log2(1/δ) of them: 80 at δ = 1e-12.
BITS = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One way the device may be: kg, N·s/m, s, whole samples of delay."""

    mass: float
    damping: float
    sample_time: float
    delay_samples: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What the controller plays: N/m, N·s/m, kg, and filter cut-offs in Hz or None."""

    stiffness: float
    damping: float
    mass: float
    velocity_filter_hz: float | None
    acceleration_filter_hz: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoop:
    """D(z) + s·N(z), whose roots are the poles when all effects are multiplied by s.

    Where no spring acts, the pole z = 1 of free motion has been divided out of both.

    Attributes:
        open: D.
        feedback: N.
        integrates: D still has the exact root z = 1, which belongs to zero gain and to no other.
    """

    open: arb_poly
    feedback: arb_poly
    integrates: bool


def closed_loop(point: Point, setting: Setting) -> ClosedLoop:
    """Equation (37) with a delay of d samples and filtered velocity and acceleration.

    Velocity (1-a)(z-1)/(T(z-a)), acceleration ((1-a)(z-1)/(T(z-a)))², a = exp(-2π·f·T), a = 0
    without a filter. The plant is b²/m·(z-1)(z-ε) under z(ε-1+δ) + 1-(1+δ)ε, and T²/(2m)·(z+1)
    over (z-1)² where b = 0. Only denominators of effects that act are multiplied through.
    """
    with _precision():
        m, b, T = arb(point.mass), arb(point.damping), arb(point.sample_time)
        z, one = arb_poly([0, 1]), arb_poly([1])
        step = z - one
        if point.damping == 0:
            decay = arb(1)
            plant = arb_poly([1, 1]) * (T * T / (2 * m))
        else:
            delta = b * T / m
            decay = (-delta).exp()
            numerator = arb_poly([1 - (1 + delta) * decay, decay - 1 + delta])
            plant = numerator * (m / (b * b))
        av, aa = (_pole(f, T) for f in (setting.velocity_filter_hz, setting.acceleration_filter_hz))
        behind_velocity = z - av if setting.damping else one
        behind_acceleration = (z - aa) * (z - aa) if setting.mass else one
        rate = (1 - av) / T
        rate_of_rate = ((1 - aa) / T) ** 2
        spring = behind_velocity * behind_acceleration * arb(setting.stiffness)
        damper = behind_acceleration * (arb(setting.damping) * rate)
        inertia = behind_velocity * (arb(setting.mass) * rate_of_rate)
        denominator = z**point.delay_samples * (z - decay) * behind_velocity * behind_acceleration
        if setting.stiffness:
            law = spring + damper * step + inertia * step * step
            return ClosedLoop(open=denominator * step, feedback=plant * law, integrates=True)
        law = damper + inertia * step
        return ClosedLoop(open=denominator, feedback=plant * law, integrates=point.damping == 0)


def _pole(cutoff: float | None, sample_time: arb) -> arb:
    if cutoff is None:
        return arb(0)
    return (arb.pi() * (-2 * cutoff) * sample_time).exp()


class _precision:  # noqa: N801 - reads as a phrase: with _precision()
    """Balls of BITS bits inside, whatever the caller had outside."""

    def __enter__(self) -> None:
        self._outside = ctx.prec
        ctx.prec = BITS

    def __exit__(self, *_: object) -> None:
        ctx.prec = self._outside


precision = _precision
