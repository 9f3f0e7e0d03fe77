"""Fades: no hand that enters and leaves an element while it fades makes the device swing up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification import InvalidInputError, load_device
from tests.wall_axis import Axis
from tests.wall_devices import Moment, draw_moment
from tests.wall_fades import STEPS, Fading, Wave, at_levels, chased_growth, growth_of, waved_growth
from tests.wall_play import Array, Bench, Law
from tests.wall_trials import play
from tune import Scene, optimise
from tune.loop.loop import Filters
from tune.loop.state_space import Corner
from tune.stability.nonlinear import Values, shortest_fade

LEVELS = np.linspace(0, 1, STEPS + 1)
#: A fade is this many times slower than the shortest that no wave was found to pump.
SLOWER = 2.0
#: HomeRehab with one sample of delay, 476 N/m and 10.34 kg behind 5 Hz.
SOFT, HEAVY = 476.0, 10.34
HOMEREHAB = Axis(mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=1.0)
SLOW = float(np.exp(-2 * np.pi * 5e-3))


def place_of(axis: Axis) -> Corner:
    """An axis without a hand as the code under test names it."""
    modes = ((float(axis.mode_hz), float(axis.mode_damping), float(axis.at_encoder)),)
    return Corner(
        mass=float(axis.mass),
        damping=float(axis.damping),
        sample_time=float(axis.sample_time),
        delay=float(axis.delay_samples) * float(axis.sample_time),
        position_stiffness=float(axis.stiffness),
        current_lag=float(axis.lag),
        modes=modes if axis.at_encoder else (),
    )


def pumped(matrices: Array, samples: int, *, tries: int) -> float:
    """Largest growth a sample that both searches find."""
    generator = np.random.default_rng(3)
    waved = waved_growth(matrices, samples, generator, tries=tries, turns=tries // 2)
    return max(chased_growth(matrices, samples), waved)


@pytest.mark.long
def test_a_heavy_mass_beside_a_soft_spring_needs_a_slow_fade() -> None:
    """At 0.06 s a hand pumps it, at twice the shortest fade none was found that does."""
    law = Law(stiffness=SOFT, steady_mass=HEAVY * LEVELS, acceleration_pole=SLOW)
    matrices = at_levels(Bench(HOMEREHAB, law, LEVELS.size))
    filters = Filters(acceleration_filter_hz=5.0)
    found = shortest_fade([place_of(HOMEREHAB)], filters, (SOFT, 0, 0), (0, 0, HEAVY))
    assert 0.1 < found < 0.2
    assert pumped(matrices, 2, tries=10) > 1
    assert pumped(matrices, int(SLOWER * found * 1e3 / STEPS), tries=10) < 1


def test_a_quarter_of_a_swing_is_too_fast_where_little_is_lost() -> None:
    """With a quick filter and 1 N·s/m the time of a quarter swing is not enough."""
    axis = replace(HOMEREHAB, damping=1.0)
    quarter = float(np.pi / 2 * np.sqrt((3.0 + HEAVY) / SOFT))
    law = Law(stiffness=SOFT, steady_mass=HEAVY * LEVELS, acceleration_pole=0.3)
    matrices = at_levels(Bench(axis, law, LEVELS.size))
    assert chased_growth(matrices, int(quarter * 1e3 / STEPS)) > 1


def test_a_narrow_band_of_periods_that_pumps_is_found() -> None:
    """0.9 kg with 0.2 N·s/m beside 12 N/m loses little: one wait in a hundred pumps it."""
    axis = Axis(mass=0.885, damping=0.212, sample_time=1e-3, delay_samples=2.13)
    law = Law(stiffness=12.26, steady_mass=0.2013 * LEVELS)
    matrices = at_levels(Bench(axis, law, LEVELS.size))
    assert growth_of(matrices, 3, Wave(levels=(0, STEPS), waits=(324, 384))) > 1 + 1e-5
    assert growth_of(matrices, 3, Wave(levels=(0, STEPS), waits=(420, 420))) < 1 - 5e-5
    found = shortest_fade([place_of(axis)], Filters(), (12.26, 0, 0), (0, 0, 0.2013))
    assert found > 0.1
    assert chased_growth(matrices, int(found * 1e3 / STEPS), swings=30) < 1


def faded(moment: Moment, generator: np.random.Generator) -> tuple[Axis, Law, Values, Values]:
    """(device without a hand, law at all levels, what stays, what fades) of a random moment."""
    axis = replace(moment.axis, hand_mass=0.0, hand_damping=0.0, hand_stiffness=0.0, at_handle=0.0)
    K = float(moment.law.stiffness) * float(10 ** generator.uniform(-2, 0))
    B = 0.1 * float(moment.law.damping) if generator.random() < 0.3 else 0.0
    M = float(moment.law.mass)
    own = generator.random() < 0.5
    level = LEVELS if own else np.ones_like(LEVELS)
    law = replace(
        moment.law,
        stiffness=K * level,
        damping=B * level,
        mass=0.0,
        steady_mass=M * LEVELS,
    )
    if own:
        return axis, law, (0.0, 0.0, 0.0), (K, B, M)
    return axis, law, (K, B, 0.0), (0.0, 0.0, M)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_no_hand_is_found_that_pumps_a_fade(seed: int) -> None:
    """Random devices with a lag or a mode and springs that stay or fade along, 15 a seed.

    Where only what fades binds the device, no hand waits outside of it until the device has drifted
    away, to come back to a spring that is stretched: an element has an edge.
    """
    generator = np.random.default_rng((seed, 31))
    left = 15
    while left:
        moment = draw_moment(generator, "all three")
        axis, law, beside, fading = faded(moment, generator)
        matrices = at_levels(Bench(axis, law, LEVELS.size))
        if fading[0] and not axis.stiffness:
            matrices = matrices[1:]
        if np.abs(np.linalg.eigvals(matrices)).max() >= 1 - 1e-7:
            continue
        left -= 1
        found = shortest_fade([place_of(axis)], moment.filters, beside, fading)
        if not np.isfinite(found):
            continue
        samples = int(max(SLOWER * found, 0.1) / float(axis.sample_time) / STEPS)
        assert pumped(matrices, samples, tries=100) < 1 + 1e-9, moment


@pytest.mark.parametrize("seconds", [0.05, 0.4])
def test_a_fade_beside_a_wall_that_only_pushes(seconds: float) -> None:
    """Levels that follow the power, turn by chance or with a period; 0.05 s pumps, 0.4 s not."""
    members, generator = 40, np.random.default_rng(5)
    law = Law(stiffness=SOFT, mass=HEAVY, acceleration_pole=SLOW, one_sided=1.0)
    bench = Bench(HOMEREHAB, law, members)
    bench.start(0.0, 0.2)
    fading = Fading(
        members,
        np.full(members, seconds / 1e-3),
        kind=generator.integers(0, 3, members).astype(float),
        period=10 ** generator.uniform(1.5, 3, members),
        generator=generator,
    )
    grows = play(bench, fading, samples=1200, push=6.0, generator=generator).grows()
    assert bool(grows.any()) == (seconds < 0.1)


def test_a_scene_may_ask_for_a_longer_fade_and_not_for_a_shorter_one() -> None:
    """238 N/m and 5.17 kg behind 5 Hz, felt together, need 0.4 s."""

    def scene(fade: dict[str, float]) -> Scene:
        return Scene.model_validate(
            {
                "elements": {"rubber": {"stiffness": 238.0}, "cup": {"mass": 5.17, **fade}},
                "together": [["rubber", "cup"]],
                "loop": {"acceleration_filter_hz": 5.0},
            }
        )

    tuned = optimise(load_device("homerehab"), scene({}))
    assert tuned.elements["cup"].fade_time == 0.4
    longer = optimise(load_device("homerehab"), scene({"fade_time": 0.6}))
    assert longer.elements["cup"].fade_time == 0.6
    with pytest.raises(InvalidInputError, match=r"it must fade over 0\.4 s") as refused:
        optimise(load_device("homerehab"), scene({"fade_time": 0.2}))
    assert "cup.fade_time" in str(refused.value)


def test_a_spring_that_fades_along_is_taken_to_go_all_the_way() -> None:
    """A stylus that loses little is pumped at low levels however slowly, all the way it is not."""
    stylus = load_device("stylus")
    place = Corner(
        mass=stylus.mass.value, damping=stylus.damping.value, sample_time=1e-3, delay=1e-3
    )
    filters = Filters(velocity_filter_hz=500.0, acceleration_filter_hz=111.3)
    thing = (90.0, 3.86, 0.0323)
    assert np.isinf(shortest_fade([place], filters, (0, 0, 0), thing))
    assert shortest_fade([place], filters, (0, 0, 0), thing, whole=True) < 0.2
