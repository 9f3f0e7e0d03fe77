"""The sampled loop of docs/theory.md, 5, in z and at high precision, from its definitions.

Mechanism, hand and actuator as one linear system in continuous time, matrix exponentials for the
held and delayed force, the law as the difference equations say. Nothing of it is taken from the
code under test, and nothing is written in w.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from flint import acb, acb_poly, arb, arb_mat, arb_poly

from tests.reference import TOLERANCE, ReferenceLoop, boundary_gains, stable_by_roots

#: Angles ωT; no pole of a case in these tests is as slow as the lowest.
_LOWEST = 1e-8
_GRID = np.geomspace(1e-6, np.pi, 1200)
_GOLDEN = (arb(5).sqrt() - 1) / 2


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


class Sampled:
    """Polynomials in z of a case: D, N of the open loop N/D, handle H and law."""

    def __init__(self, case: Case) -> None:
        self.case = case
        measured, handle, plant = _plant(case)
        numerator, denominator = _law(case)
        fixed, varied = plant * denominator, measured * numerator
        self.law = (numerator, denominator)
        if case.free:
            fixed, varied = fixed // arb_poly([-1, 1]), varied // arb_poly([-1, 1])
            numerator, plant = numerator // arb_poly([-1, 1]), plant // arb_poly([-1, 1])
            self.force_numerator = plant * numerator * arb_poly([-1, 1])
        else:
            self.force_numerator = plant * numerator
        self.handle_numerator = handle * numerator
        self.loop = ReferenceLoop(fixed=fixed, varied=varied)
        self.closed = fixed + varied

    @cached_property
    def poles(self) -> list[acb]:
        return _roots(self.closed)

    def stable(self) -> bool:
        return stable_by_roots(self.closed)

    def safe_gain(self) -> float:
        """The lowest gain at which a root touches the circle; 0 if tiny gains are unstable."""
        gains = boundary_gains(self.loop)
        first = gains[0].mid() if gains else arb(2)
        if not stable_by_roots(self.loop.at(first / 2)):
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
        """H2 norm of H = N/D, D the closed loop: H·H~ = A/D + A~/D~, of mean 2·a0/d0.

        ~ turns q = 1/z into 1/q; A solves D·A~ + A·D~ = N·N~ power by power of q.
        """
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


def _plant(case: Case) -> tuple[arb_poly, arb_poly, arb_poly]:
    """(measured, handle) numerators over one denominator, position in m from force in N."""
    m, T = arb(case.mass), arb(case.sample_time)
    count = 1 + len(case.modes)
    e = [arb(1), *(arb(mode[2]) for mode in case.modes)]
    h = [arb(1), *(arb(mode[3]) for mode in case.modes)]
    omega = [arb(0), *(2 * arb.pi() * arb(mode[0]) for mode in case.modes)]
    zeta = [arb(0), *(arb(mode[1]) for mode in case.modes)]
    mh, bh, kh = (arb(x) for x in case.hand)

    def matrix(diagonal: list[arb], along_hand: arb) -> arb_mat:
        return arb_mat(
            [
                [
                    (diagonal[i] if i == j else arb(0)) + along_hand * h[i] * h[j]
                    for j in range(count)
                ]
                for i in range(count)
            ]
        )

    inertia = matrix([m] * count, mh)
    friction = matrix(
        [arb(case.damping), *(2 * z * w * m for z, w in zip(zeta[1:], omega[1:], strict=True))], bh
    )
    spring = matrix([w * w * m for w in omega], kh)
    inverse = inertia.inv()
    push = inverse * arb_mat([[x] for x in e])
    states = 2 * count + (1 if case.current_lag else 0)
    size = states + 1
    flow = [[arb(0)] * size for _ in range(size)]
    drag, pull = inverse * friction, inverse * spring
    force = states - 1 if case.current_lag else states
    for i in range(count):
        flow[i][count + i] = arb(1)
        for j in range(count):
            flow[count + i][j] = -pull[i, j]
            flow[count + i][count + j] = -drag[i, j]
        flow[count + i][force] = push[i, 0]
    if case.current_lag:
        flow[force][force] = -1 / arb(case.current_lag)
        flow[force][states] = 1 / arb(case.current_lag)
    whole = int(np.floor(case.delay_samples))
    part = arb(case.delay_samples) - whole
    generator = arb_mat(flow)

    def after(time: arb) -> tuple[arb_mat, arb_mat]:
        moved = (generator * time).exp()
        carried = arb_mat([[moved[i, j] for j in range(states)] for i in range(states)])
        return carried, arb_mat([[moved[i, states]] for i in range(states)])

    step, _ = after(T)
    rest, late = after((1 - part) * T)
    _, early = after(part * T)
    early = rest * early
    # (zI - Φ)^-1 by Faddeev and LeVerrier.
    identity = arb_mat([[arb(int(i == j)) for j in range(states)] for i in range(states)])
    adjugate, characteristic = [identity], [arb(1)]
    for k in range(1, states + 1):
        product = step * adjugate[-1]
        trace = sum((product[i, i] for i in range(states)), arb(0))
        characteristic.append(-trace / k)
        adjugate.append(product + identity * characteristic[-1])

    def read(weights: list[arb]) -> arb_poly:
        row = arb_mat([[*weights, *[arb(0)] * (states - count)]])
        now = [(row * a * late)[0, 0] for a in adjugate[:states]]
        before = [(row * a * early)[0, 0] for a in adjugate[:states]]
        return arb_poly(now[::-1]) * arb_poly([0, 1]) + arb_poly(before[::-1])

    delayed = arb_poly([0, 1]) ** (whole + 1)
    measured, handle, plant = _without_common_delay(
        read(e), read(h), arb_poly(characteristic[::-1]) * delayed
    )
    return measured, handle, plant


def _law(case: Case) -> tuple[arb_poly, ...]:
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
