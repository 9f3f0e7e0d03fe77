"""Known limits of the general loop, what must not change it, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from tests.general_loops import HAND, HOMEREHAB, MODE, loop_of
from tests.reference import crossings
from tests.sampled_loops import Case, loop_along
from tests.simulated.experiment import EFFECTS
from tune.documents.effects import Effects
from tune.loop.loop import Filters, Loop
from tune.loop.plant import HandNumbers, ModeNumbers
from tune.stability.verdict import is_stable, largest, verdict


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


def test_a_window_of_15_ms_costs_most_of_the_damping() -> None:
    loop = Loop.from_numbers(**HOMEREHAB, filters=Filters(velocity_window_samples=15))
    assert round(float(largest(loop, "damping"))) == 891


def test_a_window_of_one_sample_is_the_plain_difference() -> None:
    plain = Loop.from_numbers(**HOMEREHAB, delay_samples=0.3)
    one = Filters(velocity_window_samples=1)
    window = Loop.from_numbers(**HOMEREHAB, delay_samples=0.3, filters=one)
    for name in EFFECTS:
        assert float(largest(window, name)) == pytest.approx(float(largest(plain, name)), rel=1e-12)


@pytest.mark.parametrize(("window", "delay"), [(60, 1.0), (15, 5.5), (1, 22)])
def test_the_longest_windows_and_delays_are_still_judged(window: int, delay: float) -> None:
    """Degrees up to 65, against 360 digits."""
    case = Case(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=delay,
        velocity_window_samples=window,
        modes=((80.0, 0.02, 0.5, -2.0),),
        hand=(0.1, 5.0, 300.0),
    )
    limit = float(crossings(loop_along(case, None, 1.0, None))[0].mid())
    loop = loop_of(case)
    assert float(largest(loop, "damping")) == pytest.approx(limit, rel=1e-9)
    factors = np.array([1e-3, 1 - 1e-6, 1 + 1e-6])
    answers = verdict(loop, Effects(damping=limit * factors))
    assert answers.tolist() == [1, 1, -1]


def test_two_equal_poles_are_the_limit_of_two_unequal_ones() -> None:
    """ζ = 1 is built from lines, ζ < 1 from an oscillation."""
    limits = [
        float(
            largest(
                Loop.from_numbers(
                    **HOMEREHAB,
                    delay_samples=1,
                    filters=Filters(
                        velocity_filter_hz=40.0,
                        velocity_filter_order=2,
                        acceleration_filter_hz=40.0,
                        filter_damping_ratio=ratio,
                    ),
                ),
                "mass",
                Effects(damping=20.0),
            )
        )
        for ratio in (1.0, 1 - 1e-10)
    ]
    assert limits[0] == pytest.approx(limits[1], rel=1e-8)


@pytest.mark.parametrize("hand", [None, HAND])
@pytest.mark.parametrize("modes", [(), (MODE,)])
@pytest.mark.parametrize("whole", [0, 1, 3])
def test_limits_move_smoothly_through_whole_delays(
    hand: HandNumbers | None, modes: tuple[ModeNumbers, ...], whole: int
) -> None:
    """A whole number of samples has factors of its own; a hair more or less gives the same."""

    def limit(delay: float) -> float:
        loop = Loop.from_numbers(
            **HOMEREHAB, delay_samples=delay, hand=hand, modes=modes, current_lag=2e-4
        )
        return float(largest(loop, "stiffness", Effects(damping=5.0)))

    at = limit(whole)
    assert limit(whole + 1e-7) == pytest.approx(at, rel=1e-5)
    if whole:
        assert limit(whole - 1e-7) == pytest.approx(at, rel=1e-5)


def test_an_array_may_reach_from_one_whole_delay_to_the_next() -> None:
    delays = np.array([1.0, 1.25, 2.0])
    together = largest(Loop.from_numbers(**HOMEREHAB, delay_samples=delays), "damping")
    apart = [
        float(largest(Loop.from_numbers(**HOMEREHAB, delay_samples=d), "damping")) for d in delays
    ]
    assert together == pytest.approx(apart, rel=1e-10)


def test_nothing_added_changes_nothing() -> None:
    """A mode the encoder does not see, a hand of nothing and a lag of nothing."""
    bare = Loop.from_numbers(**HOMEREHAB, delay_samples=1)
    unseen = MODE._replace(at_encoder=0.0)
    nothing = HandNumbers(mass=0.0, damping=0.0, stiffness=0.0)
    for other in (
        Loop.from_numbers(**HOMEREHAB, delay_samples=1, modes=(unseen,)),
        Loop.from_numbers(**HOMEREHAB, delay_samples=1, hand=nothing),
        Loop.from_numbers(**HOMEREHAB, delay_samples=1, hand=nothing, modes=(unseen,)),
        Loop.from_numbers(**HOMEREHAB, delay_samples=1, current_lag=1e-9),
    ):
        assert not other.grounded
        for name in EFFECTS:
            assert float(largest(other, name)) == pytest.approx(
                float(largest(bare, name)), rel=1e-5
            )


def test_a_hand_on_a_rigid_device_adds_up_with_it() -> None:
    """Without a spring and modes, a hand is more mass and damping."""
    held = HandNumbers(mass=0.5, damping=7.0, stiffness=0.0)
    together = Loop.from_numbers(mass=3.5, damping=17.0, sample_time=1e-3, delay_samples=0.7)
    loop = Loop.from_numbers(**HOMEREHAB, delay_samples=0.7, hand=held)
    for name in EFFECTS:
        assert float(largest(loop, name)) == pytest.approx(
            float(largest(together, name)), rel=1e-12
        )


def test_a_spring_of_the_hand_holds_the_position() -> None:
    loop = Loop.from_numbers(**HOMEREHAB, delay_samples=1, hand=HAND)
    assert loop.grounded
    assert is_stable(loop, Effects(damping=5.0))
    # A negative stiffness up to the hand's is stable; from there on it is not.
    edge = float(np.asarray(HAND.stiffness))
    assert is_stable(loop, Effects(stiffness=-edge * (1 - 1e-9), damping=5.0))
    assert verdict(loop, Effects(stiffness=-edge * (1 + 1e-9), damping=5.0)) == -1


@pytest.mark.parametrize("first", [0.3, 0.5, 0.7])
def test_two_bodies_on_a_spring_are_a_rigid_mass_and_a_mode(first: float) -> None:
    """The mode of two bodies against their own equations of motion, position from force."""
    total, spring, damper, T = 2.0, 3e4, 4.0, 1e-3
    one, two = first * total, (1 - first) * total
    reduced = one * two / total
    omega = np.sqrt(spring / reduced)
    mode = ModeNumbers(
        frequency_hz=omega / 2 / np.pi,
        damping_ratio=damper / (2 * reduced * omega),
        at_encoder=np.sqrt(two / one),
        at_handle=-np.sqrt(one / two),
    )
    grip = HandNumbers(mass=0.2, damping=3.0, stiffness=500.0)
    for hand in (None, grip):
        loop = Loop.from_numbers(mass=total, damping=0.0, sample_time=T, modes=(mode,), hand=hand)
        # [x1, x2, v1, v2] under a held force on the first body.
        end_mass = two + (0.2 if hand else 0.0)
        end_spring, end_damper = (500.0, 3.0) if hand else (0.0, 0.0)
        a = np.array(
            [
                [0, 0, 1, 0],
                [0, 0, 0, 1],
                [-spring / one, spring / one, -damper / one, damper / one],
                [
                    spring / end_mass,
                    -(spring + end_spring) / end_mass,
                    damper / end_mass,
                    -(damper + end_damper) / end_mass,
                ],
            ]
        )
        both = np.zeros((5, 5))
        both[:4, :4], both[2, 4] = a * T, T / one
        from scipy.linalg import expm

        moved = expm(both)
        for z in (1.02, np.exp(0.3j), np.exp(2.5j)):
            states = np.linalg.solve(z * np.eye(4) - moved[:4, :4], moved[:4, 4])
            w = (z - 1) / (z + 1)
            parts = loop.transfer
            below = np.polyval(parts.plant_denominator[::-1], w)
            for state, top in ((0, parts.plant_numerator), (1, parts.handle_numerator)):
                found = np.polyval(top[::-1], w) / below * T**2 / total
                assert found == pytest.approx(states[state], rel=1e-9)
