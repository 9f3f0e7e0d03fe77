"""The general loop in z, 360 digits: state space, matrix exponential, characteristic polynomials.

Written from the equations of motion and the definition of the hold, by another route than the code
under test: coordinates are not decoupled, nothing is split into fractions, and no w occurs.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb, acb_poly, arb, arb_mat, arb_poly

from tests.reference import TOLERANCE, ReferenceLoop


@dataclass(frozen=True, slots=True, kw_only=True)
class GeneralCase:
    """One loop in SI units.

    Attributes:
        modes: (frequency in Hz, damping ratio, at encoder, at handle) of each.
        hand: (mass, damping, stiffness), or None.
        delay: in samples.
        velocity: ("none",), ("low-pass", Hz, order, damping ratio) or ("window", samples).
        acceleration: ("none",) or ("low-pass", Hz, order, damping ratio).
    """

    mass: float
    damping: float
    sample_time: float
    delay: float = 0.0
    modes: tuple[tuple[float, float, float, float], ...] = ()
    hand: tuple[float, float, float] | None = None
    lag: float = 0.0
    velocity: tuple[str | float, ...] = ("none",)
    acceleration: tuple[str | float, ...] = ("none",)


def general_loop(
    case: GeneralCase, stiffness: float | None, damping: float | None, mass: float | None
) -> ReferenceLoop:
    """P(z; s) along s·(K, B, M); an effect that is None is absent.

    Without any spring the root z = 1 of free motion is left out.
    """
    numerator, denominator = plant(case)
    z, one, T = arb_poly([0, 1]), arb_poly([1]), arb(case.sample_time)
    difference = z - one
    # (difference to this power, the rest of the numerator, denominator) of each effect.
    terms: list[tuple[arb, int, arb_poly, arb_poly]] = []
    if stiffness is not None:
        terms.append((arb(stiffness), 0, one, one))
    if damping is not None:
        terms.append((arb(damping) / T, 1, *_velocity(case, z)))
    if mass is not None:
        terms.append((arb(mass) / T**2, 2, *_low_pass(case.acceleration, case.sample_time, z, 2)))
    free = stiffness is None and (case.hand is None or case.hand[2] == 0)
    drop = 1 if free else 0
    common = one
    for *_, part in terms:
        common = common * part
    varied = arb_poly([0])
    for k, (size, power, top, _) in enumerate(terms):
        rest = top * difference ** (power - drop)
        for j, (*_, other) in enumerate(terms):
            if j != k:
                rest = rest * other
        varied = varied + size * rest
    if free:
        assert denominator(arb(1)).contains(0)
        denominator = denominator // difference
    return ReferenceLoop(fixed=denominator * common, varied=numerator * varied)


def plant(case: GeneralCase) -> tuple[arb_poly, arb_poly]:
    """(numerator, denominator) in z of position over force."""
    count = 1 + len(case.modes)
    m, b, T = arb(case.mass), arb(case.damping), arb(case.sample_time)
    encoder = [arb(1), *(arb(mode[2]) for mode in case.modes)]
    handle = [arb(1), *(arb(mode[3]) for mode in case.modes)]
    grip = [arb(x) for x in (case.hand or (0.0, 0.0, 0.0))]
    omegas = [arb(0), *(2 * arb.pi() * arb(mode[0]) for mode in case.modes)]
    ratios = [arb(0), *(arb(mode[1]) for mode in case.modes)]
    losses = [b, *(2 * z * w * m for z, w in zip(ratios[1:], omegas[1:], strict=True))]

    def matrix(own: list[arb], share: arb) -> arb_mat:
        return arb_mat(
            [
                [share * handle[i] * handle[j] + (own[i] if i == j else 0) for j in range(count)]
                for i in range(count)
            ]
        )

    inverse = matrix([m] * count, grip[0]).inv()
    loss = inverse * matrix(losses, grip[1])
    stiff = inverse * matrix([w * w * m for w in omegas], grip[2])
    pull = inverse * arb_mat([[x] for x in encoder])
    zero, lagging = arb(0), case.lag > 0
    # States: coordinates, their rates, and the force behind its lag.
    rows = [
        [arb(1) if j == count + i else zero for j in range(2 * count)] + [zero] * lagging
        for i in range(count)
    ]
    rows += [
        [-stiff[i, j] for j in range(count)]
        + [-loss[i, j] for j in range(count)]
        + [pull[i, 0]] * lagging
        for i in range(count)
    ]
    force = [zero] * count + [zero if lagging else pull[i, 0] for i in range(count)]
    if lagging:
        rows.append([zero] * (2 * count) + [-1 / arb(case.lag)])
        force.append(1 / arb(case.lag))
    whole = int(case.delay)
    fraction = arb(case.delay) - whole
    phi, full = _held(rows, force, T)
    _, new = _held(rows, force, (1 - fraction) * T)
    reading = arb_mat([[*encoder, *[zero] * (len(rows) - count)]])
    bare = phi.charpoly()
    z = arb_poly([0, 1])
    now = (phi - new * reading).charpoly() - bare
    if case.delay == whole:
        return now, bare * z**whole
    before = (phi - (full - new) * reading).charpoly() - bare
    return now * z + before, bare * z ** (whole + 1)


def _held(rows: list[list[arb]], force: list[arb], time: arb) -> tuple[arb_mat, arb_mat]:
    """What a time does to the states, and a force of one held through it."""
    size = len(rows)
    both = [[x * time for x in [*row, f]] for row, f in zip(rows, force, strict=True)]
    moved = arb_mat([*both, [arb(0)] * (size + 1)]).exp()
    return (
        arb_mat([[moved[i, j] for j in range(size)] for i in range(size)]),
        arb_mat([[moved[i, size]] for i in range(size)]),
    )


def _velocity(case: GeneralCase, z: arb_poly) -> tuple[arb_poly, arb_poly]:
    """(numerator without the factor z - 1, denominator) of T times the velocity."""
    if case.velocity[0] == "window":
        count = int(case.velocity[1])
        return arb_poly([arb(1) / count] * count), z**count
    return _low_pass(case.velocity, case.sample_time, z, 1)


def _low_pass(
    filter_: tuple[str | float, ...], sample_time: float, z: arb_poly, power: int
) -> tuple[arb_poly, arb_poly]:
    """A filter times z^-power."""
    if filter_[0] == "none":
        return arb_poly([1]), z**power
    _, cutoff, order, ratio = filter_
    angle = 2 * arb.pi() * arb(cutoff) * arb(sample_time)
    if order == 1:
        a = (-angle).exp()
        return arb_poly([1 - a]), (z - arb_poly([a])) * z ** (power - 1)
    p = (-2 * arb(ratio) * angle).exp()
    t = 2 * (-arb(ratio) * angle).exp() * (angle * (1 - arb(ratio) ** 2).sqrt()).cos()
    gain = arb_poly([1 - t + p])
    return gain * z ** (2 - power), z * z - t * z + arb_poly([p])


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
