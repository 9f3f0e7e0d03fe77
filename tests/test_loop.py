"""Known limits of the general loop, what must not change it, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from tests.general_loops import HAND, HOMEREHAB, loop_of
from tests.reference import crossings
from tests.sampled_loops import Case, loop_along
from tests.simulated.experiment import EFFECTS
from tune.documents.scene import Effects
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
