"""Delay margin: the crossing against 60-digit roots, nothing unstable before it, known limits."""

from __future__ import annotations

import numpy as np
import pytest

from tests.margin_cases import draw, effects_of, loop_of
from tests.sampled_loops import Case
from tests.sampled_reference import Sampled
from tune.documents.scene import Effects
from tune.loop.loop import Loop
from tune.margins import delay_margin
from tune.stability.verdict import largest

#: Samples looked for; random loops that bear more are many.
MOST = 5.0
#: The crossing lies within this, relative.
AGREEMENT = 1e-9


def _compare(count: int, seed: int, *, between: int, plain: bool = False) -> int:
    """Check random loops; how many of them turn unstable within MOST."""
    rng = np.random.default_rng(seed)
    crossings = 0
    for _ in range(count):
        case = draw(rng, plain=plain)
        margin = delay_margin(
            lambda further, case=case: loop_of(case.later(further)), effects_of(case), most=MOST
        )
        assert margin.every_gain <= margin.full_gain

        def every(further: float, case: Case = case) -> bool:
            return Sampled(case.later(further)).safe_gain() > 1

        def full(further: float, case: Case = case) -> bool:
            return Sampled(case.later(further)).stable()

        for found, stable in ((margin.every_gain, every), (margin.full_gain, full)):
            assert all(stable(float(x)) for x in np.linspace(0, found, between + 2)[:-1]), case
            if found < MOST:
                crossings += 1
                assert stable(found * (1 - AGREEMENT)), case
                assert not stable(found * (1 + AGREEMENT)), case
    return crossings


@pytest.mark.long
def test_delay_margins_of_random_loops() -> None:
    assert _compare(3, seed=3, between=8) >= 1


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_delay_margins_of_random_loops_long(seed: int) -> None:
    assert _compare(200, seed=100 + seed, between=40, plain=bool(seed % 2)) >= 100


@pytest.mark.parametrize(
    ("effect", "tables"),
    [
        # docs/theory.md, 5: limits with one and two samples of delay, m = 3 kg, b = 10, 1 ms.
        ("stiffness", (6673.0, 4006.0)),
        ("damping", (2493.0, 1615.0)),
        pytest.param("mass", (3.71, 3.33), marks=pytest.mark.long),
    ],
)
def test_a_limit_with_delay_has_that_delay_as_its_margin(
    effect: str, tables: tuple[float, float]
) -> None:
    def at(samples: float) -> Loop:
        return Loop.from_numbers(mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=samples)

    for samples, printed in zip((1, 2), tables, strict=True):
        limit = float(largest(at(samples), effect))  # type: ignore[arg-type]
        assert limit == pytest.approx(printed, rel=2e-3)
        margin = delay_margin(at, Effects(**{effect: limit}))
        # A delay within 1e-9 samples of a whole number is taken for that number.
        assert margin.every_gain == pytest.approx(samples, abs=2e-9)


def test_small_spring_bears_the_delay_that_its_damping_pays_for() -> None:
    """K < b/(T/2 + delay) within 2 % (theory.md, 5): 10 ms less half a sample at K = 1000."""

    def at(samples: float) -> Loop:
        return Loop.from_numbers(mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=samples)

    margin = delay_margin(at, Effects(stiffness=1000.0))
    assert margin.full_gain == pytest.approx(9.5, rel=0.02)
    assert margin.every_gain == margin.full_gain


def test_lower_gains_can_be_what_delay_destabilises() -> None:
    """Stable at full gain and not below: the two margins differ (theory.md, 4, two intervals)."""

    def at(samples: float) -> Loop:
        # In units of the mass and the sample time.
        return Loop.from_numbers(mass=1.0, damping=0.0057, sample_time=1.0, delay_samples=samples)

    effects = Effects(stiffness=0.752, damping=0.211, mass=0.576)
    margin = delay_margin(at, effects)
    assert margin.every_gain == 0.0
    assert 0.0 < margin.full_gain < 0.5


def test_an_unstable_island_between_two_stable_half_samples_is_found() -> None:
    """A damper on a 350 Hz mode, 0.1 % beyond its least limit: unstable for 0.04 samples only."""
    case = Case(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        added_damping=201.66 * 1.001,
        modes=((350.0, 0.01, 1.0, -1.0),),
    )
    stable = [Sampled(case.later(delay)).stable() for delay in (0.0, 0.39, 0.418, 0.45, 0.5, 1.0)]
    assert stable == [True, True, False, True, True, True]
    margin = delay_margin(lambda further: loop_of(case.later(further)), effects_of(case), most=1.0)
    for found in (margin.every_gain, margin.full_gain):
        assert Sampled(case.later(found * (1 - AGREEMENT))).stable()
        assert not Sampled(case.later(found * (1 + AGREEMENT))).stable()


def test_nothing_to_look_for_is_refused() -> None:
    with pytest.raises(ValueError, match="most must be positive"):
        delay_margin(lambda _: Loop.dimensionless(0.1), Effects(damping=0.1), most=0.0)
