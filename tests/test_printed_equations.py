"""The paper's equations and limits as printed, against the code, where they hold and fail."""

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from flint import arb

from tests import printed
from tests.printed import (
    DIGITS,
    Characteristic,
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
from tests.simulated.experiment import EFFECTS, EffectName
from tune import Effects, Loop, is_stable, largest, safe_gain

#: HomeRehab and the paper's setting.
DEVICE: dict[str, Any] = {"mass": 3.0, "damping": 10.0, "sample_time": 1e-3}
EVERYTHING: dict[EffectName, float] = {"stiffness": 1000.0, "damping": 10.0, "mass": 1.0}
POINTS = (mpmath.mpc(2, 1), mpmath.mpc(-1, 3), mpmath.mpc(0, -2), mpmath.mpc(-3, 0))
DELTAS = (1e-6, 1e-2, 1.0)
#: Which effects each characteristic equation has.
PRESENT: dict[str, tuple[Characteristic, tuple[EffectName, ...]]] = {
    "(4)": (printed.equation_4, ("stiffness",)),
    "(11)": (printed.equation_11, ("damping",)),
    "(17)": (printed.equation_17, ("mass",)),
    "(23)": (printed.equation_23, ("stiffness", "damping")),
    "(26)": (printed.equation_26, ("damping", "mass")),
    "(29)": (printed.equation_29, ("stiffness", "mass")),
    "(37)": (printed.equation_37, ("stiffness", "damping", "mass")),
}


def _setting(effects: tuple[EffectName, ...] = EFFECTS) -> Setting:
    """HomeRehab with some of the paper's setting."""
    K, B, M = (mpmath.mpf(EVERYTHING[name] if name in effects else 0) for name in EFFECTS)
    m, b = mpmath.mpf(3), mpmath.mpf(10)
    return Setting(m=m, b=b, T=mpmath.mpf(0.001), K=K, B=B, M=M)


def test_delta_2_and_the_dimensionless_effects_10_16_22() -> None:
    loop = Loop.from_numbers(**DEVICE)
    alpha, beta, gamma = loop.dimensionless_effects(Effects(**EVERYTHING))
    assert alpha == pytest.approx(1000.0 * 1e-6 / 3.0, rel=1e-15)
    assert beta == pytest.approx(10.0 * 1e-3 / 3.0, rel=1e-15)
    assert gamma == pytest.approx(1.0 / 3.0, rel=1e-15)
    twin = Loop.dimensionless(float(printed.equation_2(_setting())))
    coefficients = [
        each.polynomial(Effects(stiffness=a, damping=b, mass=m))[0]
        for each, (a, b, m) in ((loop, tuple(EVERYTHING.values())), (twin, (alpha, beta, gamma)))
    ]
    np.testing.assert_allclose(coefficients[0], coefficients[1], rtol=1e-12)


@pytest.mark.parametrize("delta", DELTAS)
@pytest.mark.parametrize("number", PRESENT)
def test_characteristic_equations_have_the_polynomial_of_the_loop(
    number: str, delta: float
) -> None:
    """z²(z-1)(z-ε) times the equation is the polynomial in w over (1-w)⁴, but for one factor."""
    equation, names = PRESENT[number]
    values = {"stiffness": 0.3, "damping": 0.7, "mass": 0.4}
    coefficients, _ = Loop.dimensionless(delta).polynomial(
        Effects(**{name: values[name] for name in names})
    )
    with mpmath.workdps(printed.DIGITS):
        ours = [mpmath.mpf(float(c)) for c in coefficients]
        s = Setting.dimensionless(
            delta, *(values[name] if name in names else 0.0 for name in EFFECTS)
        )
        factors: list[Number] = []
        for z in POINTS:
            w = (z - 1) / (z + 1)
            full = z**2 * (z - 1) * (z - mpmath.exp(-s.b)) * equation(s, z)
            value = mpmath.fsum(c * w**power for power, c in enumerate(ours))
            factors.append(value / (1 - w) ** 4 / full)
        for factor in factors[1:]:
            # The polynomial of the loop is in double precision.
            assert abs(factor / factors[0] - 1) < 1e-12


@pytest.mark.parametrize("delta", DELTAS)
@pytest.mark.parametrize("damping", [0.0, 0.7, -0.2])
def test_the_coefficients_31_to_35_and_38_to_42_are_those_of_the_loop(
    delta: float, damping: float
) -> None:
    """All five times the same positive number, e^δ·T²b² in the units of the printed ones."""
    effects = Effects(stiffness=0.3, damping=damping, mass=0.4)
    ours, sizes = Loop.dimensionless(delta).polynomial(effects)
    with mpmath.workdps(printed.DIGITS):
        s = Setting.dimensionless(delta, 0.3, damping, 0.4)
        c = printed.equations_38_to_42(s)
        scale = mpmath.exp(s.b) * s.b**2
        for number, own, size in zip(c, ours, sizes, strict=True):
            assert abs(number / scale - float(own)) < 1e-14 * size
        if damping == 0:
            assert c == printed.equations_31_to_35(s)
            assert printed.equation_36(s) == printed.equation_43(s)


@pytest.mark.parametrize(
    ("name", "approximate", "slope"),
    [("stiffness", "2δ", 1 / 6), ("damping", "2", 2 / 3), ("mass", "2", 1 / 3)],
    ids=["(8), (9)", "(14), (15)", "(20), (21)"],
)
def test_approximations_are_low_by_a_part_of_delta(
    name: EffectName, approximate: str, slope: float
) -> None:
    """Exact over approximate upper limit is 1 + slope·δ + O(δ²): never on the unsafe side."""
    for delta in (1e-5, 1e-4, 1e-3, 1e-2):
        limit = float(largest(Loop.dimensionless(delta), name))
        ratio = limit / (2 * delta if approximate == "2δ" else 2)
        assert ratio > 1
        assert (ratio - 1) / delta == pytest.approx(slope, abs=delta)
    everywhere = np.geomspace(1e-6, 100, 400)
    simple = 2 * everywhere if approximate == "2δ" else 2.0
    assert np.all(largest(Loop.dimensionless(everywhere), name) > simple)


def test_lower_limits_13_is_exact_and_20_low_by_five_sixths_of_delta() -> None:
    """-b < B to the last digit; the exact lower limit of M is -m(1 + 5δ/6 + O(δ²))."""
    for delta in (1e-4, 1e-3, 1e-2, 0.1):
        loop = Loop.dimensionless(delta)
        low = {name: float(safe_gain(loop, Effects(**{name: -1.0}))) for name in EFFECTS[1:]}
        assert low["damping"] == pytest.approx(delta, rel=1e-12)
        assert (low["mass"] - 1) / delta == pytest.approx(5 / 6, abs=delta)


def _printed_43(delta: float, alpha: float, beta: float, gamma: float) -> Number:
    """The left side of (43) with m = T = 1."""
    with mpmath.workdps(DIGITS):
        return equation_43(Setting.dimensionless(delta, alpha, beta, gamma))


@pytest.mark.parametrize(
    ("delta", "alpha", "beta", "gamma", "radius"),
    [(1e-3, 0.0719, -0.42, 8.93, 2.76), (0.0033, 0.0018, -0.0115, 2.01, 1.0012)],
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
@pytest.mark.parametrize(
    ("equation", "effect", "beside"),
    [
        (equation_6, "stiffness", {}),
        (equation_13, "damping", {}),
        (equation_25, "stiffness", {"damping": 1e-3}),
        (equation_25, "stiffness", {"damping": 0.3}),
        (equation_25, "stiffness", {"damping": 1.0}),
        (equation_28, "damping", {"mass": 0.1}),
        (equation_28, "damping", {"mass": 0.5}),
        (equation_28, "damping", {"mass": 1.0}),
    ],
)
def test_upper_limits_6_13_25_28(
    equation: Callable[[Setting], Number],
    effect: EffectName,
    beside: dict[EffectName, float],
    delta: float,
) -> None:
    """One code path against the printed formulas, evaluated in 60 digits with m = T = 1."""
    with mpmath.workdps(DIGITS):
        limit = equation(Setting.dimensionless(delta, *(beside.get(e, 0.0) for e in EFFECTS)))
    found = largest(Loop.dimensionless(delta), effect, Effects(**beside))
    assert float(found) == pytest.approx(float(limit), rel=1e-11 if beside else 1e-12)


@pytest.mark.parametrize("delta", [1e-9, 1e-6, 1e-3, 0.1, 1.0, 2.0])
@pytest.mark.parametrize("B", [0.0, 0.2])
def test_spring_mass_and_all_three_equations_36_and_43(delta: float, B: float) -> None:
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
