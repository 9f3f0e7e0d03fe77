"""The general loop against 360-digit arithmetic."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from flint import arb, arb_poly

from tests.general_loops import compare, draw_case, draw_ray, loop_of, without_filters
from tests.reference import crossings, stable_by_jury
from tests.sampled_loops import Case, loop_along, plant
from tests.simulated.experiment import EFFECTS
from tests.thinned import thinned
from tune.documents.scene import Effects
from tune.stability.criterion import ULPS, UNIT
from tune.stability.verdict import largest, stable_values


def _accept(tally: Counter[str], count: int) -> None:
    assert tally["wrong"] == 0, tally
    assert tally["wrong intervals"] == 0, tally
    assert tally["intervals"] == count
    assert tally["draw stable"] >= 0.3 * tally["draw"], tally
    assert tally["near"] >= 1.5 * count, tally
    assert tally["near stable"] >= 0.1 * tally["near"], tally
    # 1e-9 from the boundary is meant to be decided, not merely not wrong.
    assert tally["near undecided"] <= max(2, 2e-3 * tally["near"]), tally
    assert tally["draw undecided"] <= 1e-3 * tally["draw"], tally


@pytest.mark.parametrize("count", thinned([75, 150], 1))
def test_verdicts_and_margins_against_360_digits(count: int) -> None:
    _accept(compare(count, seed=1), count)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(25))
def test_verdicts_and_margins_against_360_digits_long(seed: int) -> None:
    _accept(compare(2_000, seed=100 + seed), 2_000)


def test_intervals_in_one_coordinate_end_where_360_digits_change_sides() -> None:
    rng = np.random.default_rng(11)
    ends = 0
    for _ in range(60):
        case = draw_case(rng)
        k, b, m = draw_ray(rng, case)
        others = Effects(stiffness=k, damping=b, mass=m)
        name = EFFECTS[int(rng.integers(3))]
        low, high = stable_values(loop_of(case), name, others)
        for end in np.ravel([low, high]):
            if not 0 < end < np.inf:
                continue
            sides: list[bool] = []
            for factor in (1 - 1e-9, 1 + 1e-9):
                # Absent effects stay absent: the pole of free motion is not asked for.
                values = dict(zip(EFFECTS, (k, b, m), strict=True))
                values[name] = float(end) * factor
                reference = loop_along(case, *values.values())
                sides.append(stable_by_jury(reference.at(arb(1))))
            assert sides[0] != sides[1], (case, name, others, end)
            ends += 1
    assert ends > 40


def test_what_only_a_mode_damps_is_right_to_six_digits() -> None:
    """Neither device nor hand damped: a limit below a micronewton a metre."""
    case = Case(
        mass=0.8867971407624056,
        damping=0.0,
        sample_time=0.0004781793265835689,
        delay_samples=4.92123431421505,
        modes=((921.7719055287816, 0.03217871237458136, 0.836262837133392, -0.4787695160788501),),
        hand=(0.04449676578842037, 0.0, 111.86542948705485),
        velocity_filter_hz=21.023882775083973,
    )
    limit = float(crossings(loop_along(case, 1.0, None, None))[0].mid())
    assert limit < 1e-6
    assert float(largest(loop_of(case), "stiffness")) == pytest.approx(limit, rel=1e-6)


def _in_w(polynomial: arb_poly, degree: int) -> list[arb]:
    """Coefficients of (1-w)^degree·p((1+w)/(1-w))."""
    total = arb_poly([0])
    for power, coefficient in enumerate(polynomial.coeffs()):
        term = arb_poly([1, 1]) ** power * arb_poly([1, -1]) ** (degree - power)
        total = total + coefficient * term
    found = list(total.coeffs())
    return found + [arb(0)] * (degree + 1 - len(found))


def test_coefficients_are_right_to_a_few_units_of_their_sizes() -> None:
    """What every verdict relies on: errors well below ULPS units of roundoff of the sizes."""
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(60):
        case = without_filters(draw_case(rng))
        loop = loop_of(case)
        numerator, _, denominator = plant(case)
        degree = denominator.degree()
        unit = arb(case.mass) / arb(case.sample_time) ** 2
        square = arb_poly([0, 0, 1])  # of the two plain differences
        for truth, value, size in (
            (denominator * square, loop.terms.free, loop.sizes.free),
            (numerator * square * unit, loop.terms.alpha, loop.sizes.alpha),
        ):
            exact = _in_w(truth, degree + 2)
            errors = np.array(
                [float(abs(arb(float(v)) - e).mid()) for v, e in zip(value, exact, strict=True)]
            )
            # A coefficient that is zero by structure is a ball around zero in the reference.
            errors[errors < 1e-100] = 0.0
            assert np.all(np.abs(value) <= size * (1 + 1e-12))
            assert np.all(size[errors > 0] > 0)
            worst = max(worst, float(np.max(errors / np.where(size > 0, size, 1.0))))
    assert worst <= 0.5 * ULPS * UNIT
