"""Schur stability for every gain in (0, g], decided from certified roots; undecided is no.

At gain g all poles must certainly lie inside the unit circle. On the way down to zero gain a pole
can leave the circle only through it, at z where -D(z)/N(z) is real: there D(z)·N(1/z) equals its
mirror image. All such z are isolated, and none may belong to a gain in (0, g].
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import RLock
from typing import Literal

import numpy as np
from flint import acb, acb_poly, arb, arb_mat, arb_poly, ctx
from numpy.typing import NDArray

from tune.certificate.affine import FloatArray
from tune.certificate.region import Point, Setting

#: Arrays of balls, of any shape.
Balls = NDArray[np.object_]

#: Bits of every ball. The printed plant loses 2·log2(1/δ) of them: 80 at δ = 1e-12.
_BITS = 400
#: The precision is that of the process: one thread at a time.
_ALONE = RLock()


@contextmanager
def precision() -> Generator[None]:
    """Balls of `_BITS` bits inside, whatever the caller had outside."""
    with _ALONE:
        outside, ctx.prec = ctx.prec, _BITS
        try:
            yield
        finally:
            ctx.prec = outside


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledPlant:
    """Measured position from commanded force, numerator over denominator, in z."""

    numerator: arb_poly  # with the delay
    denominator: arb_poly  # its root z = 1 of free motion taken out where ``integrates``
    integrates: bool  # nothing holds the position


def sampled_plant(point: Point) -> SampledPlant:
    """The plant at one point; to be called within `precision`."""
    # The plain plant is equation (37) as printed, any other the exponential of its matrix.
    return _printed(point) if point.plain else _by_exponential(point)


def _printed(point: Point) -> SampledPlant:
    """b²/m·(z-1)(z-ε) under z(ε-1+δ) + 1-(1+δ)ε, and T²/(2m)·(z+1) over (z-1)² where b = 0."""
    m, b, T = arb(point.mass), arb(point.damping), arb(point.sample_time)
    if point.damping == 0:
        decay = arb(1)
        numerator = arb_poly([1, 1]) * (T * T / (2 * m))
    else:
        delta = b * T / m
        decay = (-delta).exp()
        numerator = arb_poly([1 - (1 + delta) * decay, decay - 1 + delta]) * (m / (b * b))
    late = arb_poly([0] * int(point.delay_samples) + [1])
    return SampledPlant(
        numerator=numerator, denominator=arb_poly([-decay, 1]) * late, integrates=True
    )


def _by_exponential(point: Point) -> SampledPlant:
    """x[k+1] = Φ·x[k] + Γ_old·F[k-d-1] + Γ_new·F[k-d], the new force acting from fT on."""
    T = arb(point.sample_time)
    whole = int(point.delay_samples)
    fraction = arb(point.delay_samples) - whole
    motion, drive, read = _state_space(point)
    size = len(drive)
    augmented = arb_mat([*np.c_[motion, drive].tolist(), [arb(0)] * (size + 1)])

    def held(time: arb) -> tuple[Balls, Balls]:
        """(Φ, Γ) of a time of constant force."""
        both = _array((augmented * time).exp(), size + 1)
        return both[:size, :size], both[:size, size]

    transition, _ = held(T)
    kept, new = held((1 - fraction) * T)
    numerator, delays = _resolvent(transition, read, new), whole
    if fraction != 0:
        old = _resolvent(transition, read, kept @ held(fraction * T)[1])
        numerator, delays = numerator * arb_poly([0, 1]) + old, whole + 1
    denominator = arb_mat(transition.tolist()).charpoly()
    if not point.grounded:
        denominator = denominator // arb_poly([-1, 1])
    return SampledPlant(
        numerator=numerator,
        denominator=denominator * arb_poly([0] * delays + [1]),
        integrates=not point.grounded,
    )


def _state_space(point: Point) -> tuple[Balls, Balls, Balls]:
    """(A, B, C) of (q, q̇ and, with a lag, the actuator's force) from command to encoder."""
    m, modes, grip = arb(point.mass), point.modes, point.hand
    turns = [2 * arb.pi() * arb(mode.frequency_hz) for mode in modes]
    losses = [2 * arb(p.damping_ratio) * w * m for p, w in zip(modes, turns, strict=True)]
    encoder: Balls = np.array([arb(1), *(arb(mode.at_encoder) for mode in modes)], dtype=object)
    handle: Balls = np.array([arb(1), *(arb(mode.at_handle) for mode in modes)], dtype=object)
    hand = (grip.mass, grip.damping, grip.stiffness) if grip else (0.0, 0.0, 0.0)
    own = (
        [m] * len(encoder),
        [arb(point.damping), *losses],
        [arb(point.position_stiffness), *(w * w * m for w in turns)],
    )
    inertia, loss, spring = (
        np.outer(handle, handle) * arb(part) + np.diag(np.array(diagonal, dtype=object))
        for part, diagonal in zip(hand, own, strict=True)
    )
    inverse = _array(arb_mat(inertia.tolist()).inv(), len(encoder))
    count, lagged = len(encoder), point.current_lag > 0
    motion: Balls = np.zeros((2 * count + lagged,) * 2, dtype=object)
    drive: Balls = np.zeros(2 * count + lagged, dtype=object)
    motion[:count, count : 2 * count] = np.eye(count, dtype=int)
    motion[count : 2 * count, :count] = inverse @ spring * -1
    motion[count : 2 * count, count : 2 * count] = inverse @ loss * -1
    (motion[:, -1] if lagged else drive)[count : 2 * count] = inverse @ encoder
    if lagged:
        drive[-1] = 1 / arb(point.current_lag)
        motion[-1, -1] = -drive[-1]
    return motion, drive, np.pad(encoder, (0, len(drive) - count))


def _array(matrix: arb_mat, size: int) -> Balls:
    return np.array([[matrix[i, j] for j in range(size)] for i in range(size)], dtype=object)


def _resolvent(transition: Balls, read: Balls, drive: Balls) -> arb_poly:
    """C·adj(zI - Φ)·Γ by Faddeev and LeVerrier."""
    one = np.eye(len(read), dtype=int)
    adjugate: Balls = one.astype(object)
    coefficients: list[arb] = []
    for order in range(1, len(read) + 1):
        coefficients.append(read @ (adjugate @ drive))
        product = transition @ adjugate
        adjugate = product - one * (np.trace(product) / order)
    return arb_poly(coefficients[::-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoop:
    """D(z) + s·N(z), whose roots are the poles when all effects are multiplied by s."""

    # Where no spring acts, of the effects or of the hand, the pole z = 1 of free motion has been
    # divided out of both.
    open: arb_poly  # D
    feedback: arb_poly  # N
    integrates: bool  # D still has the exact root z = 1, which belongs to zero gain and to no other


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """Force from position, numerator over denominator, in z."""

    numerator: arb_poly  # divided by z - 1 where ``vanishes``
    denominator: arb_poly  # of the estimates that are used
    vanishes: bool  # without a spring the law has a zero at z = 1


def closed_loop(point: Point, setting: Setting) -> ClosedLoop:
    """Plant and law put together, at one point."""
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
    acceleration_top, acceleration_bottom = _filtered(setting, 2, T) if setting.mass else (one, one)
    damper = velocity_top * acceleration_bottom * arb(setting.damping)
    inertia = step * acceleration_top * velocity_bottom * arb(setting.mass)
    denominator = velocity_bottom * acceleration_bottom
    if setting.stiffness:
        spring = denominator * arb(setting.stiffness)
        return Law(
            numerator=spring + step * (damper + inertia), denominator=denominator, vanishes=False
        )
    return Law(numerator=damper + inertia, denominator=denominator, vanishes=True)


def law_in_doubles(setting: Setting, step: float) -> tuple[FloatArray, FloatArray, bool]:
    """Descending coefficients of the law's numerator and denominator, and whether it vanishes."""
    with precision():
        law = law_of(setting, step)
        top, bottom = (
            np.array([float(c) for c in polynomial.coeffs()][::-1])
            for polynomial in (law.numerator, law.denominator)
        )
    return top, bottom, law.vanishes


def shift_to_one(polynomial: arb_poly) -> FloatArray:
    """Descending coefficients in powers of z - 1: those of z cancel at low frequency."""
    return np.array([float(c) for c in polynomial(arb_poly([1, 1])).coeffs()][::-1])


def _velocity(setting: Setting, T: arb) -> tuple[arb_poly, arb_poly]:
    """(numerator without its factor z - 1, denominator) of the velocity estimate."""
    if setting.velocity_window_samples:
        n = setting.velocity_window_samples
        return arb_poly([1 / (n * T)] * n), arb_poly([0] * n + [1])
    return _filtered(setting, 1, T)


def _filtered(setting: Setting, power: int, T: arb) -> tuple[arb_poly, arb_poly]:
    """(numerator without its factor (z - 1)^power, denominator) of a derivative's estimate."""
    cutoff, order, carried = setting.estimate(power)
    top, bottom, lag = arb_poly([1 / T**power]), arb_poly([1]), arb(power) / 2
    if cutoff is None:
        return top, arb_poly([0] * power + [1])
    rate = arb.pi() * (-2 * cutoff) * T
    a, zeta = rate.exp(), arb(setting.filter_damping_ratio)
    turn = -rate * (1 - zeta * zeta).sqrt() if setting.filter_damping_ratio < 1 else arb(0)
    trace, product = 2 * (rate * zeta).exp() * turn.cos(), (2 * rate * zeta).exp()
    pair, single = arb_poly([product, -trace, 1]), arb_poly([-a, 1])
    for factor in [single] if order == 1 else [pair, *[single] * (order - 2)]:
        gain = factor(arb(1))
        top, bottom = top * gain, bottom * factor
        # Σ p/(1-p) is the degree less than the logarithmic slope at one.
        lag += factor.derivative()(arb(1)) / gain - factor.degree()
    # Every pole brings a z, every difference takes one away, and so does what is carried on.
    spare = order - power - carried
    if carried:
        top = top * arb_poly([-lag, 1 + lag])
    return top * arb_poly([0] * max(spare, 0) + [1]), bottom * arb_poly([0] * max(-spare, 0) + [1])


#: Radius to which roots are isolated, as a power of ten: fifty digits and a few more.
_DIGITS = 55
#: The isolation starts from fixed points and may stall on roots of very different size; seen from
#: another origin it does not. Each is tried until one succeeds; the result is certified either way.
_SHIFTS = (0, 1, -1, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the roots say."""

    # "stable", "unstable" or "undecided"; only the first passes
    answer: Literal["stable", "unstable", "undecided"]
    reason: str  # a sentence for people
    radius: float  # largest pole modulus at the full gain, nan if not isolated


def judge(point: Point, setting: Setting, gain: float) -> Verdict:
    """Whether the loop is stable for every gain in (0, gain]."""
    with precision():
        loop = closed_loop(point, setting)
        full = loop.open + arb(gain) * loop.feedback
        poles = _roots(full)
        if poles is None:
            return _undecided("poles at full gain could not be isolated")
        moduli = [abs(pole) for pole in poles]
        radius = max((float(modulus.upper()) for modulus in moduli), default=0.0)
        if any(modulus > 1 for modulus in moduli):
            return Verdict(
                answer="unstable",
                reason=f"pole of modulus {radius:.9g} at full gain",
                radius=radius,
            )
        if not all(modulus < 1 for modulus in moduli):
            return _undecided("a pole touches the unit circle at full gain", radius)
        crossings = _crossing_gains(loop)
        if crossings is None:
            return _undecided("crossings of the unit circle could not be isolated", radius)
        for crossing in crossings:
            if not (crossing <= 0 or crossing > gain):
                at = float(crossing.mid())
                return Verdict(
                    answer="unstable",
                    reason=f"a pole crosses the unit circle at {at:.6g} of the gain asked for",
                    radius=radius,
                )
        return Verdict(answer="stable", reason="all poles inside at every gain", radius=radius)


def _undecided(reason: str, radius: float = float("nan")) -> Verdict:
    return Verdict(answer="undecided", reason=reason, radius=radius)


def _roots(polynomial: arb_poly) -> list[acb] | None:
    coefficients = polynomial.coeffs()
    while coefficients and coefficients[0] == 0:
        coefficients = coefficients[1:]
    if len(coefficients) < 2:
        return []
    for shift in _SHIFTS:
        moved = arb_poly(coefficients)(arb_poly([arb(shift), 1]))
        try:
            roots = acb_poly([acb(c) for c in moved.coeffs()]).roots(tol=arb(10) ** -_DIGITS)
        except (ValueError, ArithmeticError):
            continue
        return [root + arb(shift) for root in roots]
    return None


def _crossing_gains(loop: ClosedLoop) -> list[arb] | None:
    degree = max(loop.open.degree(), loop.feedback.degree())
    open_, feedback = (
        p.coeffs() + [arb(0)] * (degree - p.degree()) for p in (loop.open, loop.feedback)
    )
    difference = arb_poly(open_) * arb_poly(feedback[::-1]) - arb_poly(feedback) * arb_poly(
        open_[::-1]
    )
    # z = 1 and z = -1 mirror onto themselves. Every integrator adds to the former, which belongs
    # to zero gain; the latter is looked at on its own.
    difference = _without(_without(difference, arb(1)), arb(-1))
    coefficients = difference.coeffs()
    while coefficients and coefficients[0].contains(0):
        coefficients = coefficients[1:]
    while coefficients and coefficients[-1].contains(0):
        coefficients = coefficients[:-1]
    points = _roots(arb_poly(coefficients))
    if points is None:
        return None
    gains: list[arb] = []
    for z in [acb(-1), *([] if loop.integrates else [acb(1)]), *points]:
        if not abs(z).overlaps(arb(1)):
            continue
        divisor = loop.feedback(z)
        if divisor.contains(0):
            if loop.open(z).contains(0):
                return None
            continue
        gains.append((-(loop.open(z) / divisor)).real)
    return gains


def _without(polynomial: arb_poly, root: arb) -> arb_poly:
    while polynomial.degree() > 0 and polynomial(root).contains(0):
        polynomial = polynomial // arb_poly([-root, 1])
    return polynomial
