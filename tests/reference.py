"""The sampled loop in z with 360 digits: as printed, from its definitions, its margins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from flint import acb, acb_poly, arb, arb_mat, arb_poly, ctx

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


def crossings(loop: ReferenceLoop) -> list[arb]:
    """Every s > 0 at which a root of P(z; s) lies on the unit circle."""
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


@dataclass(frozen=True, kw_only=True)
class Case:
    """One device, its law and its effects; 0 or None is absent, ``stiffness`` 0 is no spring."""

    mass: float
    damping: float
    sample_time: float
    delay_samples: float = 0.0
    stiffness: float = 0.0
    added_damping: float = 0.0
    added_mass: float = 0.0
    velocity_filter_hz: float | None = None
    velocity_filter_order: int = 1
    velocity_window_samples: int | None = None
    acceleration_filter_hz: float | None = None
    acceleration_filter_order: int = 2
    filter_damping_ratio: float = 1.0
    modes: tuple[tuple[float, float, float, float], ...] = ()
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)
    current_lag: float = 0.0

    def later(self, samples: float) -> Case:
        return replace(self, delay_samples=self.delay_samples + samples)

    @property
    def free(self) -> bool:
        return not self.stiffness and not self.hand[2]


def loop_along(
    case: Case, stiffness: float | None, damping: float | None, mass: float | None
) -> ReferenceLoop:
    """P(z; s) of a case along s·(K, B, M), whatever effects it has; None is absent."""
    return loop_with(
        replace(
            case, stiffness=stiffness or 0.0, added_damping=damping or 0.0, added_mass=mass or 0.0
        )
    )


def loop_with(case: Case) -> ReferenceLoop:
    """P(z; s) along s times the effects of a case."""
    measured, denominator = plant(case)
    numerator, poles = law(case)
    fixed, varied = denominator * poles, measured * numerator
    if case.free:
        assert denominator(arb(1)).contains(0)
        fixed, varied = fixed // arb_poly([-1, 1]), varied // arb_poly([-1, 1])
    return ReferenceLoop(fixed=fixed, varied=varied)


def plant(case: Case) -> tuple[arb_poly, arb_poly]:
    """Numerator over denominator in z, position at the encoder in m from force in N."""
    count = 1 + len(case.modes)
    m, b, T = arb(case.mass), arb(case.damping), arb(case.sample_time)
    encoder = [arb(1), *(arb(mode[2]) for mode in case.modes)]
    handle = [arb(1), *(arb(mode[3]) for mode in case.modes)]
    grip = [arb(x) for x in case.hand]
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
    zero, lagging = arb(0), case.current_lag > 0
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
        rows.append([zero] * (2 * count) + [-1 / arb(case.current_lag)])
        force.append(1 / arb(case.current_lag))
    whole = int(case.delay_samples)
    fraction = arb(case.delay_samples) - whole
    phi, full = _held(rows, force, T)
    _, new = _held(rows, force, (1 - fraction) * T)
    bare = phi.charpoly()
    z = arb_poly([0, 1])

    # Of a reading: det(z - Φ + g·row) is det(z - Φ)·(1 + row·(z - Φ)⁻¹·g).
    row = arb_mat([[*encoder, *[zero] * (len(rows) - count)]])
    now = (phi - new * row).charpoly() - bare
    if case.delay_samples == whole:
        return now, bare * z**whole
    return now * z + (phi - (full - new) * row).charpoly() - bare, bare * z ** (whole + 1)


def _held(rows: list[list[arb]], force: list[arb], time: arb) -> tuple[arb_mat, arb_mat]:
    """What a time does to the states, and a force of one held through it."""
    size = len(rows)
    both = [[x * time for x in [*row, f]] for row, f in zip(rows, force, strict=True)]
    moved = arb_mat([*both, [arb(0)] * (size + 1)]).exp()
    return (
        arb_mat([[moved[i, j] for j in range(size)] for i in range(size)]),
        arb_mat([[moved[i, size]] for i in range(size)]),
    )


def law(case: Case) -> tuple[arb_poly, ...]:
    """Force from position, sign turned: numerator over denominator, only what is there."""
    T, z, one = arb(case.sample_time), arb_poly([0, 1]), arb_poly([1])
    step = z - one

    def second_order(hertz: float) -> tuple[arb, arb_poly]:
        zeta = arb(case.filter_damping_ratio)
        rate = 2 * arb.pi() * arb(hertz) * T
        decay = (-rate * zeta).exp()
        trace = 2 * decay * (rate * (1 - zeta * zeta).sqrt()).cos()
        return 1 - trace + decay * decay, arb_poly([decay * decay, -trace, 1])

    nv, dv = step * (1 / T), z
    if case.velocity_window_samples is not None:
        n = case.velocity_window_samples
        nv, dv = (z**n - one) * (1 / (n * T)), z**n
    elif case.velocity_filter_hz is not None and case.velocity_filter_order == 1:
        a = (-2 * arb.pi() * arb(case.velocity_filter_hz) * T).exp()
        nv, dv = ((1 - a) / T) * step, z - a
    elif case.velocity_filter_hz is not None:
        gain, poles = second_order(case.velocity_filter_hz)
        nv, dv = (gain / T) * step * z, poles
    na, da = (1 / T**2) * step * step, z * z
    if case.acceleration_filter_hz is not None and case.acceleration_filter_order == 2:
        gain, poles = second_order(case.acceleration_filter_hz)
        na, da = (gain / T**2) * step * step, poles
    elif case.acceleration_filter_hz is not None:
        a = (-2 * arb.pi() * arb(case.acceleration_filter_hz) * T).exp()
        na, da = ((1 - a) / T**2) * step * step, z * (z - a)
    if not case.added_damping:
        nv, dv = arb_poly([0]), one
    if not case.added_mass:
        na, da = arb_poly([0]), one
    numerator = (
        dv * da * arb(case.stiffness)
        + nv * da * arb(case.added_damping)
        + na * dv * arb(case.added_mass)
    )
    return _without_common_delay(numerator, dv * da)


def _without_common_delay(*polynomials: arb_poly) -> tuple[arb_poly, ...]:
    """Polynomials without the powers of z that they all share."""
    while all(polynomial[0] == 0 for polynomial in polynomials):
        polynomials = tuple(arb_poly(polynomial.coeffs()[1:]) for polynomial in polynomials)
    return polynomials


#: Angles ωT; no pole of a case in these tests is as slow as the lowest.
_LOWEST = 1e-8
_GRID = np.geomspace(1e-6, np.pi, 1200)
_GOLDEN = (arb(5).sqrt() - 1) / 2


class Sampled:
    """Polynomials in z of a case: D, N of the open loop N/D, and the law."""

    def __init__(self, case: Case) -> None:
        self.case = case
        _, denominator = plant(case)
        numerator, poles = law(case)
        self.law = (numerator, poles)
        step = arb_poly([-1, 1])  # what the free motion has in common
        self.force_numerator = (denominator // step if case.free else denominator) * numerator
        self.loop = loop_with(case)
        self.closed = self.loop.fixed + self.loop.varied

    @cached_property
    def poles(self) -> list[acb]:
        return _roots(self.closed)

    def stable(self) -> bool:
        return stable_by_jury(self.closed)

    def safe_gain(self) -> float:
        """The lowest gain at which a root touches the circle; 0 if tiny gains are unstable."""
        gains = crossings(self.loop)
        first = gains[0].mid() if gains else arb(2)
        if not stable_by_jury(self.loop.at(first / 2)):
            return 0.0
        return float(first) if gains else float("inf")

    def in_s(self) -> list[tuple[float, float]]:
        """(decay in 1/s, damping ratio) of each pole."""
        found: list[tuple[float, float]] = []
        for z in self.poles:
            # A negative real pole lies on the cut of the logarithm.
            angle = arb.pi() if z.imag.contains(0) and z.real < 0 else z.arg()
            s = acb(abs(z).log(), angle) / arb(self.case.sample_time)
            found.append((float(-s.real.mid()), float((-s.real / abs(s)).mid())))
        return found

    def largest(self, measure: Callable[[acb], arb]) -> tuple[float, float]:
        """(largest value, its frequency in Hz) of a function of z on the circle."""

        def at(angle: arb) -> arb:
            return measure(acb(angle.cos(), angle.sin())).mid()

        angles = self.angles()
        values = np.array([float(at(arb(float(angle)))) for angle in angles])
        best, where = arb(values.max() - 1), arb(0)
        for index in np.argsort(values)[::-1][:4]:
            low = arb(float(angles[max(index - 1, 0)]))
            high = arb(float(angles[min(index + 1, len(angles) - 1)]))
            for _ in range(160):
                a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
                a, b = a.mid(), b.mid()
                low, high = (low, b) if at(a) > at(b) else (a, high)
            for angle in (low, arb(float(angles[index]))):
                if at(angle) > best:
                    best, where = at(angle), angle
        hertz = where / (2 * arb.pi() * arb(self.case.sample_time))
        return float(best.mid()), float(hertz.mid())

    def phase_margin(self) -> float:
        """Least angle of -L where |L| = 1, degrees; inf where there is no such place."""

        def open_loop(angle: arb) -> acb:
            z = acb(angle.cos(), angle.sin())
            return self.loop.varied(z) / self.loop.fixed(z)

        angles = self.angles()
        above = np.array([bool(abs(open_loop(arb(float(a)))) > 1) for a in angles])
        margins = [np.inf]
        for index in np.flatnonzero(above[1:] != above[:-1]):
            low, high = arb(float(angles[index])), arb(float(angles[index + 1]))
            for _ in range(150):
                middle = ((low + high) / 2).mid()
                if bool(abs(open_loop(middle)) > 1) == above[index]:
                    low = middle
                else:
                    high = middle
            margins.append(abs(float((-open_loop(low)).log().imag.mid())) * 180 / np.pi)
        return min(margins)

    def angles(self) -> np.ndarray:  # type: ignore[type-arg]
        """A grid of angles, dense around every pole, to start searches from."""
        around = [_GRID, np.array([float(arb.pi().mid())])]
        for z in self.poles:
            reach = float(abs(abs(z).log()).mid()) * 1.3 ** np.arange(-12, 13)
            centre = abs(float(acb(z.mid()).arg().mid()))
            around += [centre + reach, centre - reach, np.array([centre])]
        angles = np.unique(np.concatenate(around))
        return angles[(angles > _LOWEST) & (angles <= np.pi)]

    def noise_gain(self, numerator: arb_poly) -> float:
        """H2 norm of H = N/D, D the closed loop: H·H~ = A/D + A~/D~, of mean 2·a0/d0."""
        count = self.closed.degree() + 1
        d = [self.closed[count - 1 - k] for k in range(count)]
        n = [numerator[count - 1 - k] for k in range(count)]

        def shifted(values: list[arb], power: int) -> arb:
            return values[power] if 0 <= power < count else arb(0)

        system = [
            [shifted(d, i + k) + shifted(d, i - k) for i in range(count)] for k in range(count)
        ]
        wanted = [[sum((n[i + k] * n[i] for i in range(count - k)), arb(0))] for k in range(count)]
        first = arb_mat(system).solve(arb_mat(wanted))[0, 0]
        return float((2 * first / d[0]).sqrt().mid())


def _roots(polynomial: arb_poly) -> list[acb]:
    coefficients = [acb(c) for c in polynomial.coeffs()]
    while coefficients[0].contains(0):
        coefficients.pop(0)
    return list(acb_poly(coefficients).roots(tol=TOLERANCE))
