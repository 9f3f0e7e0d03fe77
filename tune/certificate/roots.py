"""Schur stability for every gain in (0, g], decided from certified roots; undecided is no.

At gain g all poles must certainly lie inside the unit circle. On the way down to zero gain a pole
can leave the circle only through it, at z where -D(z)/N(z) is real: there D(z)·N(1/z) equals its
mirror image. All such z are isolated, and none may belong to a gain in (0, g].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from flint import acb, acb_poly, arb, arb_poly

from tune.certificate.polynomial import ClosedLoop, Point, Setting, closed_loop, precision

#: Radius to which roots are isolated, as a power of ten: fifty digits and a few more.
_DIGITS = 55
#: The isolation starts from fixed points and may stall on roots of very different size; seen from
#: another origin it does not. Each is tried until one succeeds; the result is certified either way.
_SHIFTS = (0, 1, -1, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the roots say.

    Attributes:
        answer: "stable", "unstable" or "undecided"; only the first passes.
        reason: a sentence for people.
        radius: largest pole modulus at the full gain, nan if not isolated.
    """

    answer: Literal["stable", "unstable", "undecided"]
    reason: str
    radius: float


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
    open_, feedback = (_filled(p, degree) for p in (loop.open, loop.feedback))
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


def _filled(polynomial: arb_poly, degree: int) -> list[arb]:
    coefficients = polynomial.coeffs()
    return coefficients + [arb(0)] * (degree + 1 - len(coefficients))


def _without(polynomial: arb_poly, root: arb) -> arb_poly:
    while polynomial.degree() > 0 and polynomial(root).contains(0):
        polynomial = polynomial // arb_poly([-root, 1])
    return polynomial
