"""Margins, poles and noise of a sampled loop with 360 digits, from their definitions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from flint import acb, acb_poly, arb, arb_mat, arb_poly

from tests.reference import TOLERANCE, boundary_gains, stable_by_roots
from tests.sampled_loops import Case, law, loop_with, plant

#: Angles ωT; no pole of a case in these tests is as slow as the lowest.
_LOWEST = 1e-8
_GRID = np.geomspace(1e-6, np.pi, 1200)
_GOLDEN = (arb(5).sqrt() - 1) / 2


class Sampled:
    """Polynomials in z of a case: D, N of the open loop N/D, handle H and law."""

    def __init__(self, case: Case) -> None:
        self.case = case
        _, handle, denominator = plant(case)
        numerator, poles = law(case)
        self.law = (numerator, poles)
        step = arb_poly([-1, 1])  # what the free motion has in common
        self.force_numerator = (denominator // step if case.free else denominator) * numerator
        self.handle_numerator = handle * (numerator // step if case.free else numerator)
        self.loop = loop_with(case)
        self.closed = self.loop.fixed + self.loop.varied

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
