"""The sampled loop against 360-digit arithmetic."""

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flint import arb
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from identification import UsageError, load_device, quantity
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
from tests.reference import Case, crossings, loop_along, stable_by_jury
from tests.simulated.experiment import EFFECTS
from tests.thinned import thinned
from tune import (
    Effects,
    Filters,
    Loop,
    LoopError,
    force_ripple,
    gain_interval,
    is_stable,
    largest,
    safe_gain,
    stable_gains,
    verdict,
)
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
        ({"velocity_filter_hz": "50"}, "velocity_filter_hz must be one number, not '50'"),
        ({"velocity_filter_hz": np.array([50.0, 60.0])}, "velocity_filter_hz must be one number"),
        ({"velocity_window_samples": 2.5}, "velocity_window_samples must be one whole number"),
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


FloatArray = NDArray[np.float64]

#: Whole delays and parts of a sample, a lag, a hand and a mode.
KINDS: dict[str, dict[str, object]] = {
    "whole": {"delay_samples": 1},
    "part": {"delay_samples": np.linspace(1.1, 1.9, 90)[:, None]},
    "lag": {"delay_samples": 1.3, "current_lag": 2e-4},
    "mode": {"delay_samples": 0.4, "modes": (MODE,), "hand": HAND},
}


@pytest.mark.parametrize("kind", KINDS)
def test_devices_by_effects_are_answered_like_each_alone_to_the_last_digit(kind: str) -> None:
    """9 000 points are looked at in blocks; some of them alone, device and effects."""
    rng = np.random.default_rng(9)
    filters = Filters(
        velocity_filter_hz=50.0, acceleration_filter_hz=30.0, acceleration_filter_order=1
    )
    numbers = {"mass": rng.uniform(0.5, 5, (90, 1)), "damping": rng.uniform(1, 20, (90, 1))}
    numbers |= {"sample_time": 1e-3, **KINDS[kind]}
    K, B, M = (rng.uniform(0, most, 100) for most in (5e3, 500, 20))

    def answers(numbers: dict[str, object], *effects: ArrayLike) -> list[ArrayLike]:
        loop = Loop.from_numbers(**numbers, filters=filters)  # type: ignore[arg-type]
        played = Effects(**dict(zip(EFFECTS, effects, strict=True)))
        return [
            verdict(loop, played),
            *gain_interval(loop, played),
            safe_gain(loop, played),
            largest(loop, "mass", played),
        ]

    many = [np.asarray(each) for each in answers(numbers, K, B, M)]
    assert {each.shape for each in many} == {(90, 100)}
    assert 0.1 < np.mean(many[0] > 0) < 0.9
    for row, column in zip(range(0, 90, 9), range(0, 100, 10), strict=True):
        one = {
            name: each[row, 0] if isinstance(each, np.ndarray) else each
            for name, each in numbers.items()
        }
        alone = answers(one, K[column], B[column], M[column])
        np.testing.assert_array_equal(alone, [each[row, column] for each in many])


@pytest.mark.parametrize("seed", range(8))
def test_effects_of_unlike_shapes_are_answered_like_each_point_alone(seed: int) -> None:
    """Any shapes that broadcast, also as long as the polynomial; loops too."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.choice([1, 2, 3, 7], 3))

    def drawn(low: float, high: float) -> FloatArray:
        """Numbers along some of the axes, the first of which may be missing."""
        own = [n if rng.random() < 0.5 else 1 for n in shape]
        return rng.uniform(low, high, own[int(rng.integers(4)) :])

    mass, damping = (drawn(1.0, 5.0), drawn(0.0, 30.0)) if seed % 2 else (3.0, 10.0)
    sizes = (drawn(0.0, 9e3), drawn(-20.0, 1.5e3), drawn(-0.5, 10.0))[: 2 + seed % 4 // 2]

    def answers(mass: ArrayLike, damping: ArrayLike, *sizes: ArrayLike) -> list[FloatArray]:
        loop = Loop.from_numbers(
            mass=mass,
            damping=damping,
            sample_time=1e-3,
            filters=Filters(velocity_filter_hz=50.0, acceleration_filter_hz=30.0),
        )
        played = Effects(**dict(zip(EFFECTS, sizes, strict=False)))
        found = [verdict(loop, played), is_stable(loop, played), *gain_interval(loop, played)]
        found += [each[0] for each in stable_gains(loop, played)]
        found += [safe_gain(loop, played), force_ripple(loop, played, 6e-6)]
        return [np.asarray(each, float) for each in (*found, largest(loop, EFFECTS[-1], played))]

    spread = np.broadcast_arrays(mass, damping, *sizes)
    many = answers(mass, damping, *sizes)
    # What `largest` is asked for is not read: a mass given does not count.
    others = np.broadcast_shapes(*(np.shape(each) for each in (mass, damping, *sizes[:2])))
    assert [each.shape for each in many] == [spread[0].shape] * 8 + [others]
    many = [np.broadcast_to(each, spread[0].shape) for each in many]
    for place in np.ndindex(spread[0].shape):
        alone = answers(*(float(each[place]) for each in spread))
        np.testing.assert_array_equal(alone, [each[place] for each in many])


def test_many_effects_on_one_device_are_judged_as_in_ball_arithmetic() -> None:
    """20 000 points in blocks, every 400th of them alone in 360 digits."""
    case = Case(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=1.3,
        velocity_filter_hz=50.0,
        acceleration_filter_hz=30.0,
    )
    rng = np.random.default_rng(6)
    K, B, M = (rng.uniform(0, most, 20_000) for most in (6e3, 2e3, 20))
    many = np.asarray(verdict(loop_of(case), Effects(stiffness=K, damping=B, mass=M)))
    assert 0.2 < np.mean(many > 0) < 0.8
    assert np.all(many != 0)
    for row in range(0, many.size, 400):
        alone = loop_along(case, float(K[row]), float(B[row]), float(M[row])).at(arb(1))
        assert stable_by_jury(alone) == (many[row] > 0)


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


@pytest.mark.parametrize(
    ("count", "seed"), thinned([(75, 1), *((2_000, 100 + k) for k in range(25))], 1)
)
def test_verdicts_and_margins_against_360_digits(count: int, seed: int) -> None:
    tally = compare(count, seed)
    assert tally["wrong"] == 0, tally
    assert tally["wrong intervals"] == 0, tally
    assert tally["intervals"] == count
    assert tally["draw stable"] >= 0.3 * tally["draw"], tally
    assert tally["near"] >= 1.5 * count, tally
    assert tally["near stable"] >= 0.1 * tally["near"], tally
    # 1e-9 from the boundary is meant to be decided, not merely not wrong.
    assert tally["near undecided"] <= max(2, 2e-3 * tally["near"]), tally
    assert tally["draw undecided"] <= 1e-3 * tally["draw"], tally


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


@pytest.mark.parametrize("strange", [np.nan, np.inf])
def test_a_point_that_is_not_finite_is_told_so_and_changes_no_other(strange: float) -> None:
    loop = Loop.from_numbers(
        mass=3.0, damping=10.0, sample_time=1e-3, filters=Filters(velocity_filter_hz=50.0)
    )
    K = np.linspace(100.0, 90000.0, 40)
    among = np.where(np.arange(40) == 7, strange, K)
    spring, others = Effects(stiffness=among), np.delete(np.arange(40), 7)
    assert not is_stable(loop, spring)[7]
    assert np.isnan(stable_gains(loop, spring).high[0, 7])
    for found, whole in (
        (gain_interval(loop, spring).low, gain_interval(loop, Effects(stiffness=K)).low),
        (gain_interval(loop, spring).high, gain_interval(loop, Effects(stiffness=K)).high),
        (safe_gain(loop, spring), safe_gain(loop, Effects(stiffness=K))),
        (largest(loop, "damping", spring), largest(loop, "damping", Effects(stiffness=K))),
    ):
        assert np.isnan(found[7])
        np.testing.assert_array_equal(found[others], whole[others])


@pytest.mark.parametrize("shape", [(0,), (3, 0, 2)])
def test_no_points_have_no_answers(shape: tuple[int, ...]) -> None:
    loop = Loop.from_numbers(
        mass=3.0, damping=10.0, sample_time=1e-3, filters=Filters(velocity_filter_hz=50.0)
    )
    none = Effects(stiffness=np.empty(shape))
    assert gain_interval(loop, none).high.shape == safe_gain(loop, none).shape == shape
    assert largest(loop, "damping", none).shape == is_stable(loop, none).shape == shape


def test_the_largest_of_what_is_no_effect_is_a_sentence() -> None:
    unknown: Any = "K"
    with pytest.raises(
        UsageError, match=r"'K' is no effect\. Choose from stiffness, damping, mass"
    ):
        largest(Loop.from_numbers(mass=3.0, damping=10.0, sample_time=1e-3), unknown)


def test_two_stable_intervals_and_the_one_connected_to_zero() -> None:
    effects = Effects(stiffness=0.752, damping=0.211, mass=0.576)
    loop = Loop.dimensionless(0.0057)
    low, high = stable_gains(loop, effects)
    assert low == pytest.approx([0, 0.318], abs=2e-3)
    assert high == pytest.approx([0.040, 1.88], abs=2e-3)
    assert gain_interval(loop, effects) == (pytest.approx(low[1]), pytest.approx(high[1]))
    assert float(safe_gain(loop, effects)) == pytest.approx(float(high[0]))


def test_zero_stiffness_is_marginal_but_no_stiffness_is_free() -> None:
    loop = Loop.dimensionless(0.1)
    assert is_stable(loop, Effects(damping=0.1))
    assert not is_stable(loop, Effects(stiffness=0.0, damping=0.1))
    assert verdict(loop, Effects(stiffness=0.0, damping=0.1)) == 0
    assert verdict(loop, Effects(stiffness=-1e-3, damping=0.1)) == -1


def _best_time(action: object, repeats: int) -> float:
    assert callable(action)
    times: list[float] = []
    for _ in range(repeats):
        start = time.thread_time()
        action()
        times.append(time.thread_time() - start)
    return min(times)


def test_a_million_verdicts_cost_at_most_30_ns_each_and_beat_eigenvalues_100_fold() -> None:
    rng = np.random.default_rng(7)
    alpha, beta, gamma = rng.uniform(-3, 8, (3, 1_000_000))
    loop = Loop.dimensionless(0.01)
    effects = Effects(stiffness=alpha, damping=beta, mass=gamma)
    # A processor that is shared is as much slower at ten million plain products, 3.3 ms of one to
    # itself; the best of many turns of both tells by how much.
    first, second, product = rng.uniform(1, 2, (3, 8192))

    def multiply() -> None:
        for _ in range(1221):
            np.multiply(first, second, out=product)

    ours = plain = np.inf
    for _ in range(30):
        ours = min(ours, _best_time(lambda: verdict(loop, effects), 3) / 1e6)
        plain = min(plain, _best_time(multiply, 3))
        if ours <= 30e-9:
            break
    few = Effects(stiffness=alpha[:20_000], damping=beta[:20_000], mass=gamma[:20_000])
    coefficients = loop.polynomial(few)[0]
    companion = np.zeros((20_000, 4, 4))
    companion[:, 0, :] = (-coefficients[3::-1] / coefficients[4]).T
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    theirs = _best_time(lambda: np.linalg.eigvals(companion), 3) / 20_000
    assert ours <= 30e-9 * max(1.0, plain / 3.3e-3)
    assert theirs / ours >= 100
