"""The loop of the paper in z, equation (37) with its factors, in 360-digit ball arithmetic.

Written from the paper and from the definition of the zero-order hold, not from the code under
test: at this precision the cancellation of the printed form does not matter. Its boundaries are
compared with those of `tests.sampled_loops`, which knows no closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb, acb_poly, arb, arb_poly, ctx

ctx.prec = 1200

#: Radius to which roots are isolated.
TOLERANCE = arb(10) ** -60


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceLoop:
    """P(z; s) = fixed(z) + s·varied(z) along the ray s·(α, β, γ)."""

    fixed: arb_poly
    varied: arb_poly

    def at(self, gain: arb) -> arb_poly:
        return self.fixed + gain * self.varied


def reference_loop(
    delta: float,
    alpha: float,
    beta: float,
    gamma: float,
    *,
    delay: int = 0,
    velocity_pole: float = 0.0,
    acceleration_pole: float = 0.0,
) -> ReferenceLoop:
    """The closed loop by its textbook z-transforms; alpha == 0 leaves the free pole z = 1 out."""
    d = arb(delta)
    if delta == 0:
        numerator = arb_poly([arb(1) / 2, arb(1) / 2])
        epsilon = arb(1)
    else:
        epsilon = (-d).exp()
        numerator = arb_poly([(1 - (1 + d) * epsilon) / d**2, (epsilon - 1 + d) / d**2])
    z, one = arb_poly([0, 1]), arb_poly([1])
    velocity = z - arb(velocity_pole)
    acceleration = z - arb(acceleration_pole)
    step = z - one
    # Only the denominators that are there, so that no factor is shared by all terms.
    dv = velocity if beta else one
    da = acceleration * acceleration if gamma else one
    plant = z**delay * (z - epsilon) * dv * da
    spring = arb(alpha) * dv * da
    damper = arb(beta) * (1 - arb(velocity_pole)) * da
    inertia = arb(gamma) * (1 - arb(acceleration_pole)) ** 2 * dv
    if alpha:
        controller = spring + damper * step + inertia * step * step
        return ReferenceLoop(fixed=plant * step, varied=numerator * controller)
    return ReferenceLoop(fixed=plant, varied=numerator * (damper + inertia * step))


def stable_by_roots(polynomial: arb_poly) -> bool:
    """All roots of the polynomial certainly inside the unit circle, or certainly not all.

    By isolated roots; ``stable_by_jury`` tells the same without any, and a test compares both.
    """
    coefficients = list(polynomial.coeffs())
    lowest = next(k for k, c in enumerate(coefficients) if c != 0)
    roots = acb_poly([acb(c) for c in coefficients[lowest:]]).roots(tol=TOLERANCE)
    moduli = [abs(root) for root in roots]
    if any(modulus > 1 for modulus in moduli):
        return False
    if all(modulus < 1 for modulus in moduli):
        return True
    raise ArithmeticError(f"a root touches the unit circle: {moduli}")


def boundary_gains(loop: ReferenceLoop) -> list[arb]:
    """Every s > 0 at which a root of P(z; s) lies on the unit circle, from roots in z.

    ``crossings`` finds the same from roots in cos of the angle, and a test compares both. On the
    circle fixed(z)/varied(z) is real, so z is a root of fixed(z)·varied(1/z) minus its
    mirror image.
    """
    degree = max(loop.fixed.degree(), loop.varied.degree())
    fixed = _coefficients(loop.fixed, degree)
    varied = _coefficients(loop.varied, degree)
    product = arb_poly(fixed) * arb_poly(varied[::-1])
    mirror = arb_poly(varied) * arb_poly(fixed[::-1])
    difference = product - mirror
    for point in (arb(1), arb(-1)):
        # Structural roots: z = ±1 mirror onto themselves; the integrators of the plant add more.
        while difference(point).contains(0):
            difference = difference // arb_poly([-point, 1])
    coefficients = [*difference.coeffs()]
    while coefficients[0].contains(0):
        coefficients.pop(0)
    while coefficients[-1].contains(0):
        coefficients.pop()
    roots = acb_poly([acb(c) for c in coefficients]).roots(tol=TOLERANCE)
    gains: list[arb] = []
    for root in [acb(-1), *roots]:
        if root.imag < 0 or not abs(root).overlaps(arb(1)):
            continue  # conjugates cross at the same gain
        gain = -loop.fixed(root) / loop.varied(root)
        if gain.real > 0:
            gains.append(gain.real)
    return sorted(gains, key=lambda gain: float(gain.mid()))


def crossings(loop: ReferenceLoop) -> list[arb]:
    """Every s > 0 at which a root of P(z; s) lies on the unit circle.

    On the circle fixed(z)·varied(1/z) is real: its imaginary part, a polynomial in cos of the
    angle times the sine, is zero there; z = ±1 stand for themselves.
    """
    degree = max(loop.fixed.degree(), loop.varied.degree())
    fixed = [arb(c) for c in loop.fixed.coeffs()]
    varied = [arb(c) for c in loop.varied.coeffs()]
    fixed += [arb(0)] * (degree + 1 - len(fixed))
    varied += [arb(0)] * (degree + 1 - len(varied))
    product = arb_poly(fixed) * arb_poly(varied[::-1])
    mirror = arb_poly(varied) * arb_poly(fixed[::-1])
    sines = list((product - mirror).coeffs())[degree + 1 :]
    # Σ c_k sin(kθ) = sin θ · Σ c_k U_{k-1}(cos θ), Chebyshev polynomials of the second kind.
    x2 = arb_poly([0, 2])
    before, now = arb_poly([0]), arb_poly([1])
    total = arb_poly([0])
    for c in sines:
        total = total + c * now
        before, now = now, x2 * now - before
    for point in (arb(1), arb(-1)):
        while total.degree() > 0 and total(point).contains(0):
            total = total // arb_poly([-point, 1])
    coefficients = list(total.coeffs())
    while coefficients and coefficients[-1].contains(0):
        coefficients.pop()
    gains: list[arb] = []
    for root in [*roots_of(coefficients), acb(1), acb(-1)]:
        if not root.imag.contains(0) or abs(root.real) > 1:
            continue
        cosine = arb(root.real)
        place = acb(cosine, (1 - cosine * cosine).sqrt()) if abs(cosine) < 1 else acb(cosine)
        below = loop.varied(place)
        if below.contains(0):
            continue
        gain = (-loop.fixed(place) / below).real
        if gain > 0:
            gains.append(gain)
    return sorted(gains, key=lambda gain: float(gain.mid()))


def roots_of(coefficients: list[arb]) -> list[acb]:
    """All roots, once each; turned where the library's own starting points lead nowhere."""
    lowest = next(k for k, c in enumerate(coefficients) if not c.contains(0))
    zero = [acb(0)] if lowest else []
    coefficients = coefficients[lowest:]
    turn = acb(1)
    for _ in range(5):
        turned = [acb(c) * turn**power for power, c in enumerate(coefficients)]
        try:
            return zero + [root * turn for root in acb_poly(turned).roots(tol=TOLERANCE)]
        except ValueError:
            turn *= acb(arb(3) / 5, arb(4) / 5)
    raise ArithmeticError("the roots cannot be isolated")


def stable_by_jury(polynomial: arb_poly) -> bool:
    """All roots inside the unit circle, by the recursion of Schur and Cohn in balls."""
    c = [arb(x) for x in polynomial.coeffs()][::-1]
    while len(c) > 1:
        ratio = c[-1] / c[0]
        if abs(ratio) > 1:
            return False
        if not abs(ratio) < 1:
            raise ArithmeticError(f"a root touches the unit circle: {ratio}")
        c = [x - ratio * y for x, y in zip(c[:-1], c[:0:-1], strict=True)]
    return True


def _coefficients(polynomial: arb_poly, degree: int) -> list[arb]:
    found = [arb(c) for c in polynomial.coeffs()]
    return found + [arb(0)] * (degree + 1 - len(found))
