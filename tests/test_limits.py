"""Limits against the printed formulas, where those hold, where they fail, and known tables."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from flint import arb

from tests.reference import reference_loop, stable_by_roots
from tune.documents.effects import EFFECT_NAMES, Effects
from tune.loop.filters import Filters
from tune.loop.loop import Loop
from tune.stability.verdict import is_stable, largest


def _printed_43(delta: float, alpha: float, beta: float, gamma: float) -> mpmath.mpf:
    """Equations (38) to (43) as printed, with m = T = 1, in 60 digits."""
    with mpmath.workdps(60):
        d, K, B, M = (mpmath.mpf(x) for x in (delta, alpha, beta, gamma))
        b, T, m = d, mpmath.mpf(1), mpmath.mpf(1)
        e = mpmath.exp(d)
        c0 = (e - 1) * K * T**3 * b
        c1 = 2 * (e - 1) * (T**2 * b**2 + B * T**2 * b - K * T**2 * m) + 2 * K * T**3 * b * e
        c2 = (
            2 * (e - 1) * (2 * M * T * b - K * T**2 * m - 2 * B * T * m)
            + 2 * (e + 1) * B * T**2 * b
            + 2 * T**2 * b**2 * (3 * e - 1)
            + 2 * K * T**3 * b
        )
        c3 = (
            2 * (e - 1) * (K * T**2 * m - B * T**2 * b - 4 * M * m)
            + 2 * T**2 * b**2 * (3 * e + 1)
            + 8 * M * T * b
            - 2 * K * T**3 * b * e
        )
        c4 = 2 * (e - 1) * (4 * M * m + 2 * B * T * m + K * T**2 * m) + (e + 1) * (
            2 * T**2 * b**2 - 4 * M * T * b - K * T**3 * b - 2 * B * T**2 * b
        )
        return c1 * c2 * c3 - c4 * c1**2 - c0 * c3**2


@pytest.mark.parametrize(
    ("delta", "alpha", "beta", "gamma", "radius"),
    [
        (1e-3, 0.0719, -0.42, 8.93, 2.76),
        (0.0033, 0.0018, -0.0115, 2.01, 1.0012),
    ],
)
def test_loops_that_pass_the_printed_criterion_but_are_unstable(
    delta: float, alpha: float, beta: float, gamma: float, radius: float
) -> None:
    assert _printed_43(delta, alpha, beta, gamma) > 0
    loop = reference_loop(delta, alpha, beta, gamma).at(arb(1))
    moduli = [
        float(abs(complex(root))) for root in np.roots([float(c) for c in loop.coeffs()][::-1])
    ]
    assert max(moduli) == pytest.approx(radius, rel=2e-3)
    assert not is_stable(
        Loop.dimensionless(delta), Effects(stiffness=alpha, damping=beta, mass=gamma)
    )


@pytest.mark.parametrize("delta", [1e-9, 1e-6, 1e-3, 0.1, 1.0, 1.7])
def test_mass_equation_19(delta: float) -> None:
    """Up to δ = 1.7022; beyond it a root leaves at z = -1 first, which is tested below."""
    limit = float(largest(Loop.dimensionless(delta), "mass"))

    def printed(M: mpmath.mpf) -> mpmath.mpf:
        d = mpmath.mpf(delta)
        e, x = mpmath.exp(d), mpmath.expm1(d)
        return (M + d) * (M * d * x - M * x**2 + d**2 * e**2) - M * d * e * x

    with mpmath.workdps(60):
        M = mpmath.mpf(limit)
        assert printed(M * (1 - mpmath.mpf("1e-11"))) > 0
        assert printed(M * (1 + mpmath.mpf("1e-11"))) < 0


@pytest.mark.parametrize("delta", [1e-9, 1e-6, 1e-3, 0.1, 1.0, 2.0])
class TestPublishedLimits:
    """One code path against the printed formulas, evaluated in 60 digits with m = T = 1."""

    def test_spring_equation_6(self, delta: float) -> None:
        with mpmath.workdps(60):
            d = mpmath.mpf(delta)
            limit = d**2 * mpmath.expm1(d) / (mpmath.expm1(d) - d)
        assert float(largest(Loop.dimensionless(delta), "stiffness")) == pytest.approx(
            float(limit), rel=1e-12
        )

    def test_damper_equation_13(self, delta: float) -> None:
        with mpmath.workdps(60):
            d = mpmath.mpf(delta)
            limit = d**2 * mpmath.exp(d) / (mpmath.expm1(d) - d)
        assert float(largest(Loop.dimensionless(delta), "damping")) == pytest.approx(
            float(limit), rel=1e-12
        )

    def test_spring_damper_equation_25(self, delta: float) -> None:
        for B in (0.1 * delta, 0.3, 1.0):
            with mpmath.workdps(60):
                d, damping = mpmath.mpf(delta), mpmath.mpf(B)
                e, x = mpmath.exp(d), mpmath.expm1(d)
                top = damping - damping * e + d**2 * e + damping * d
                bottom = damping - damping * e + d**2 * e + damping * d * e
                limit = d * (damping + d) * x * top / ((x - d) * bottom)
            found = largest(Loop.dimensionless(delta), "stiffness", Effects(damping=B))
            assert float(found) == pytest.approx(float(limit), rel=1e-11)

    def test_mass_damper_equation_28(self, delta: float) -> None:
        for M in (0.1, 0.5, 1.0):
            with mpmath.workdps(60):
                d, mass = mpmath.mpf(delta), mpmath.mpf(M)
                e, x = mpmath.exp(d), mpmath.expm1(d)
                inner = mass * d * x - mass * x**2 + d**2 * e**2
                top = (d + mass) * inner - mass * d * e * x
                limit = d * top / ((x - d) * (-mass * x + mass * d * e + d**2 * e))
            found = largest(Loop.dimensionless(delta), "damping", Effects(mass=M))
            assert float(found) == pytest.approx(float(limit), rel=1e-11)

    @pytest.mark.parametrize("B", [0.0, 0.2])
    def test_spring_mass_and_all_three_equations_36_and_43(self, delta: float, B: float) -> None:
        for M in (0.1, 0.5):
            effects = Effects(damping=B, mass=M)
            limit = float(largest(Loop.dimensionless(delta), "stiffness", effects))
            assert _printed_43(delta, limit * (1 - 1e-10), B, M) > 0
            assert _printed_43(delta, limit * (1 + 1e-10), B, M) < 0


@pytest.mark.parametrize(
    ("delay", "cutoff", "stiffness", "damping", "mass"),
    [
        (0, None, "20011", "6013", "6.01"),
        (1, None, "6673", "2493", "3.71"),
        (2, None, "4006", "1615", "3.33"),
        (0, 50.0, "20011", "6068", "38.7"),
        (1, 50.0, "6673", "2148", "14.7"),
        (1, 20.0, "6673", "2110", "34.1"),
    ],
)
def test_known_limits_of_homerehab(
    delay: int, cutoff: float | None, stiffness: str, damping: str, mass: str
) -> None:
    """The table of known limits for m = 3 kg, b = 10 N·s/m, T = 1 ms, to the digits printed."""
    loop = Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=delay,
        filters=Filters(velocity_filter_hz=cutoff, acceleration_filter_hz=cutoff),
    )
    found = [float(largest(loop, name)) for name in EFFECT_NAMES]
    assert [f"{found[0]:.0f}", f"{found[1]:.0f}", f"{found[2]:.3g}"] == [stiffness, damping, mass]


def test_limits_that_the_printed_formulas_miss_at_large_delta() -> None:
    """Beyond δ = 3.7208 (spring), 2.3106 (damper) and 1.7022 (mass) a root leaves at z = -1."""
    for index, onset in enumerate((3.7208, 2.3106, 1.7022)):
        for delta in (onset * 1.01, 10.0, 600.0):
            loop = Loop.dimensionless(delta)
            limit = float(largest(loop, EFFECT_NAMES[index]))
            reference = reference_loop(delta, *(limit if i == index else 0.0 for i in range(3)))
            assert stable_by_roots(reference.at(arb(1 - 1e-9)))
            assert not stable_by_roots(reference.at(arb(1 + 1e-9)))
            assert abs(reference.at(arb(1))(arb(-1))) < 1e-9 * max(1, delta)
