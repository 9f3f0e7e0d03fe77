"""Limits against the printed formulas, where those hold, where they fail, and known tables."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from flint import arb

from tests.printed import (
    DIGITS,
    Number,
    Setting,
    equation_6,
    equation_13,
    equation_19,
    equation_25,
    equation_28,
    equation_43,
)
from tests.reference import reference_loop, stable_by_jury
from tests.simulated.experiment import EFFECTS
from tune.documents.scene import Effects
from tune.loop.loop import Loop
from tune.stability.verdict import is_stable, largest


def _printed_43(delta: float, alpha: float, beta: float, gamma: float) -> Number:
    """The left side of (43) with m = T = 1."""
    with mpmath.workdps(DIGITS):
        return equation_43(Setting.dimensionless(delta, alpha, beta, gamma))


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

    with mpmath.workdps(DIGITS):
        for factor, stable in ((1 - mpmath.mpf("1e-11"), True), (1 + mpmath.mpf("1e-11"), False)):
            s = Setting.dimensionless(delta, 0, 0, mpmath.mpf(limit) * factor)
            assert (equation_19(s) > 0) == stable


@pytest.mark.parametrize("delta", [1e-9, 1e-6, 1e-3, 0.1, 1.0, 2.0])
class TestPublishedLimits:
    """One code path against the printed formulas, evaluated in 60 digits with m = T = 1."""

    def test_spring_equation_6(self, delta: float) -> None:
        with mpmath.workdps(DIGITS):
            limit = equation_6(Setting.dimensionless(delta, 0, 0, 0))
        assert float(largest(Loop.dimensionless(delta), "stiffness")) == pytest.approx(
            float(limit), rel=1e-12
        )

    def test_damper_equation_13(self, delta: float) -> None:
        with mpmath.workdps(DIGITS):
            limit = equation_13(Setting.dimensionless(delta, 0, 0, 0))
        assert float(largest(Loop.dimensionless(delta), "damping")) == pytest.approx(
            float(limit), rel=1e-12
        )

    def test_spring_damper_equation_25(self, delta: float) -> None:
        for B in (0.1 * delta, 0.3, 1.0):
            with mpmath.workdps(DIGITS):
                limit = equation_25(Setting.dimensionless(delta, 0, B, 0))
            found = largest(Loop.dimensionless(delta), "stiffness", Effects(damping=B))
            assert float(found) == pytest.approx(float(limit), rel=1e-11)

    def test_mass_damper_equation_28(self, delta: float) -> None:
        for M in (0.1, 0.5, 1.0):
            with mpmath.workdps(DIGITS):
                limit = equation_28(Setting.dimensionless(delta, 0, 0, M))
            found = largest(Loop.dimensionless(delta), "damping", Effects(mass=M))
            assert float(found) == pytest.approx(float(limit), rel=1e-11)

    @pytest.mark.parametrize("B", [0.0, 0.2])
    def test_spring_mass_and_all_three_equations_36_and_43(self, delta: float, B: float) -> None:
        for M in (0.1, 0.5):
            effects = Effects(damping=B, mass=M)
            limit = float(largest(Loop.dimensionless(delta), "stiffness", effects))
            assert _printed_43(delta, limit * (1 - 1e-10), B, M) > 0
            assert _printed_43(delta, limit * (1 + 1e-10), B, M) < 0


def test_limits_that_the_printed_formulas_miss_at_large_delta() -> None:
    """Beyond δ = 3.7208 (spring), 2.3106 (damper) and 1.7022 (mass) a root leaves at z = -1."""
    for index, onset in enumerate((3.7208, 2.3106, 1.7022)):
        for delta in (onset * 1.01, 10.0, 600.0):
            loop = Loop.dimensionless(delta)
            limit = float(largest(loop, EFFECTS[index]))
            reference = reference_loop(delta, *(limit if i == index else 0.0 for i in range(3)))
            assert stable_by_jury(reference.at(arb(1 - 1e-9)))
            assert not stable_by_jury(reference.at(arb(1 + 1e-9)))
            assert abs(reference.at(arb(1))(arb(-1))) < 1e-9 * max(1, delta)
