"""The general loop against 360-digit arithmetic, its known limits, and what cannot be a loop."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identification import load_device, quantity
from tests.general_loops import (
    HAND,
    HOMEREHAB,
    MODE,
    compare,
    draw_case,
    draw_ray,
    effects_at,
    loop_of,
)
from tests.reference import Case, crossings, loop_along
from tests.simulated.experiment import EFFECTS
from tests.thinned import thinned
from tune import Effects, Filters, Loop, LoopError, is_stable, largest, safe_gain, verdict
from tune.documents.scene import Hand
from tune.loop.plant import HandNumbers


@pytest.mark.parametrize(
    ("delay", "filters", "limits"),
    [
        (0, Filters(), (20_011, 6_013, 6.01)),
        (1, Filters(), (6_673, 2_493, 3.71)),
        (2, Filters(), (4_006, 1_615, 3.33)),
        (0, Filters(velocity_filter_hz=50.0, acceleration_filter_hz=50.0), (20_011, 6_068, 38.7)),
        (1, Filters(velocity_filter_hz=50.0, acceleration_filter_hz=50.0), (6_673, 2_148, 14.7)),
        (1, Filters(velocity_filter_hz=20.0, acceleration_filter_hz=20.0), (6_673, 2_110, 34.1)),
    ],
)
def test_known_limits_of_a_device_like_the_paper_s(
    delay: int, filters: Filters, limits: tuple[float, float, float]
) -> None:
    loop = Loop.from_numbers(**HOMEREHAB, delay_samples=delay, filters=filters)
    k, b, m = (float(largest(loop, name)) for name in EFFECTS)
    assert (round(k), round(b)) == limits[:2]
    assert f"{m:.3g}" == f"{limits[2]:.3g}"


def test_a_spring_of_the_hand_holds_the_position() -> None:
    loop = Loop.from_numbers(**HOMEREHAB, delay_samples=1, hand=HAND)
    assert loop.grounded
    assert is_stable(loop, Effects(damping=5.0))
    # A negative stiffness up to the hand's is stable; from there on it is not.
    edge = float(np.asarray(HAND.stiffness))
    assert is_stable(loop, Effects(stiffness=-edge * (1 - 1e-9), damping=5.0))
    assert verdict(loop, Effects(stiffness=-edge * (1 + 1e-9), damping=5.0)) == -1


@pytest.mark.parametrize("delay", [1.0, 0.4, 2.7])
@pytest.mark.parametrize(
    ("mass", "damping", "modes", "hand"),
    [
        (3.0, 10.0, (), (0.05, 300.0, 900.0)),
        (1e-3, 25.0, (), (0.0, 0.0, 0.0)),
        (1e-3, 12.0, (), (1e-4, 15.0, 300.0)),
        (3.0, 10.0, ((5000.0, 0.02, 2.0, -1.2), (700.0, 0.9, 0.3, 0.2)), (0.1, 5.0, 300.0)),
    ],
    ids=["an overdamped hand", "nearly no mass", "nearly none in a hand", "far oscillations"],
)
def test_poles_far_from_an_oscillation_below_the_sampling_are_right(
    mass: float,
    damping: float,
    modes: tuple[tuple[float, float, float, float], ...],
    hand: tuple[float, float, float],
    delay: float,
) -> None:
    """Real poles, of 25 a sample, and oscillations of several turns a sample: 360 digits."""
    case = Case(
        mass=mass,
        damping=damping,
        sample_time=1e-3,
        delay_samples=delay,
        current_lag=2e-4,
        modes=modes,
        hand=hand,
    )
    for ray in ((1.0, None, None), (None, 1.0, None)):
        limits = [float(gain.mid()) for gain in crossings(loop_along(case, *ray))]
        name = "stiffness" if ray[0] else "damping"
        assert float(largest(loop_of(case), name)) == pytest.approx(limits[0], rel=1e-11)


def test_from_parts_reads_the_device_and_the_hand() -> None:
    device = load_device("homerehab")
    mass, damping, stiffness = (quantity(each) for each in (0.1, 5.0, 300.0))
    hand = Hand(mass=mass, damping=damping, stiffness=stiffness)
    filters = Filters(velocity_filter_hz=50.0)
    loop = Loop.from_parts(device, filters, hand, extra_delay_samples=0.25)
    numbers = Loop.from_numbers(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=device.sample_time.value,
        delay_samples=device.delay.value / device.sample_time.value + 0.25,
        filters=filters,
        hand=HandNumbers(
            mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value
        ),
    )
    assert loop.grounded
    for mine, theirs in ((loop.terms, numbers.terms), (loop.sizes, numbers.sizes)):
        np.testing.assert_array_equal(mine.free, theirs.free)
        np.testing.assert_array_equal(mine.alpha, theirs.alpha)


def test_a_quotient_that_should_be_whole_is_whole() -> None:
    """0.0003/0.0001 is 2.9999999999999996 in doubles."""
    quotient = 0.0003 / 0.0001
    assert quotient < 3
    exact = Loop.from_numbers(**HOMEREHAB, delay_samples=3)
    assert Loop.from_numbers(**HOMEREHAB, delay_samples=quotient).degree == exact.degree


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"delay_samples": -1e-3}, "negative"),
        ({"delay_samples": 22.5}, "22"),
        ({"delay_samples": np.array([0.5, 1.75])}, "whole part"),
        ({"delay_samples": np.nan}, "delay"),
        ({"mass": 0.0}, "mass"),
        ({"current_lag": -1e-3}, "current_lag"),
        ({"modes": (MODE._replace(frequency_hz=0.0),)}, "frequency"),
        ({"modes": (MODE._replace(damping_ratio=-0.1),)}, "damping ratio"),
        ({"hand": HAND._replace(mass=-0.1)}, "hand"),
    ],
)
def test_what_cannot_be_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(LoopError, match=words):
        Loop.from_numbers(**{**HOMEREHAB, **change})


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"velocity_filter_hz": 0.0}, "velocity_filter_hz"),
        ({"acceleration_filter_hz": np.inf}, "acceleration_filter_hz"),
        ({"velocity_filter_order": 3}, "velocity_filter_order"),
        ({"filter_damping_ratio": 0.0}, "filter_damping_ratio"),
        ({"filter_damping_ratio": 1.5}, "filter_damping_ratio"),
        ({"velocity_window_samples": 0}, "velocity_window_samples"),
        ({"velocity_window_samples": 61}, "velocity_window_samples"),
        ({"velocity_window_samples": 5, "velocity_filter_hz": 30.0}, "exclude"),
    ],
)
def test_filters_that_do_not_exist_are_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(LoopError, match=words):
        Filters(**wrong)  # type: ignore[arg-type]


def test_arrays_of_devices_are_judged_like_each_of_them() -> None:
    rng = np.random.default_rng(9)
    masses, hands = rng.uniform(0.5, 5, 6), 10 ** rng.uniform(1, 3, (4, 1))
    many = Loop.from_numbers(
        mass=masses,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1.4,
        modes=(MODE,),
        hand=HandNumbers(mass=0.1, damping=5.0, stiffness=hands),
    )
    limits = largest(many, "stiffness", Effects(damping=5.0))
    assert limits.shape == (4, 6)
    for row in (0, 3):
        for column in (0, 5):
            single = Loop.from_numbers(
                mass=masses[column],
                damping=10.0,
                sample_time=1e-3,
                delay_samples=1.4,
                modes=(MODE,),
                hand=HandNumbers(mass=0.1, damping=5.0, stiffness=hands[row, 0]),
            )
            assert limits[row, column] == pytest.approx(
                float(largest(single, "stiffness", Effects(damping=5.0))), rel=1e-10
            )


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), unit=st.floats(1e-3, 1e3), time=st.floats(1e-2, 1e2))
def test_units_scale_of_time_and_sign_of_a_mode_do_not_matter(
    seed: int, unit: float, time: float
) -> None:
    """Grams for kilograms, another time unit, a mode counted the other way: the same physics."""
    rng = np.random.default_rng(seed)
    case = draw_case(rng)
    k, b, m = draw_ray(rng, case)
    plain = float(safe_gain(loop_of(case), effects_at((k, b, m), 1.0)))

    def cut(chosen: float | None) -> float | None:
        return None if chosen is None else chosen / time

    mass, damping, stiffness = case.hand
    other = replace(
        case,
        mass=case.mass * unit,
        damping=case.damping * unit / time,
        sample_time=case.sample_time * time,
        modes=tuple((f / time, z, -e, -h) for f, z, e, h in case.modes),
        hand=(mass * unit, damping * unit / time, stiffness * unit / time**2),
        current_lag=case.current_lag * time,
        velocity_filter_hz=cut(case.velocity_filter_hz),
        acceleration_filter_hz=cut(case.acceleration_filter_hz),
    )
    ray = (
        None if k is None else k * unit / time**2,
        None if b is None else b * unit / time,
        None if m is None else m * unit,
    )
    assert float(safe_gain(loop_of(other), effects_at(ray, 1.0))) == pytest.approx(plain, rel=1e-9)


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
