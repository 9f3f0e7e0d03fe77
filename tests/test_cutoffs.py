"""Cut-offs that are free: against every cut-off of a fine grid, and what they are chosen by."""

from __future__ import annotations

import math
import os
import platform
import subprocess
import sys
from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from identification import Device, ForceLimit, as_stored, load_device, quantity
from tests.filter_cases import DEVICES, RIPPLES, SCENES, best_of_grid, task_of, worth_of
from tests.optimum_pairs import random_pair
from tests.thinned import thinned
from tests.unlimited import stated
from tune import NoFeasibleEffectError, Scene, optimise
from tune.documents.perception import default_table
from tune.optimisation.cutoffs import CutoffObjective, choose_filters
from tune.optimisation.problem import DesignTask

#: The product of all steps is right to this, in its logarithm: a per cent.
ONE_PERCENT = 0.01


def _silent(sentence: str) -> None:
    del sentence


def _within(worth: CutoffObjective, best: CutoffObjective) -> bool:
    """As many effects kept, and a product within a per cent."""
    return worth >= (best.kept, best.value - ONE_PERCENT)


def demo_choice() -> tuple[float, float, float]:
    """Cut-offs in Hz of a scene like that of the demo on HomeRehab, and what they are worth."""
    elements = {
        "wall": {"stiffness": "max", "damping": "max", "one_sided": True, "speed": 0.2},
        "water": {"damping": 10.0},
        "cup": {"damping": 30.0, "mass": "max"},
        "feather": {"mass": "min", "damping": 20.0},
    }
    task = task_of("homerehab", elements, together=[["wall", "water"]])
    filters = choose_filters(task, _silent)
    assert filters.velocity_filter_hz is not None
    assert filters.acceleration_filter_hz is not None
    value = worth_of(task, filters).value
    return filters.velocity_filter_hz, filters.acceleration_filter_hz, value


def _never(sentence: str) -> None:
    raise AssertionError(sentence)


@pytest.mark.parametrize(("device", "ripple"), thinned(product(DEVICES, RIPPLES), 3))
def test_a_mass_alone_is_within_a_percent_of_every_cutoff(device: str, ripple: float) -> None:
    task = task_of(device, {"cup": {"mass": "max"}}, ripple)
    filters = choose_filters(task, _silent)
    assert filters.velocity_filter_hz is None
    assert _within(worth_of(task, filters), best_of_grid(task, 30))


@pytest.mark.long
def test_a_scene_is_within_a_percent_of_every_cutoff() -> None:
    task = task_of("homerehab", SCENES["mix"])
    filters = choose_filters(task, _silent)
    assert _within(worth_of(task, filters), best_of_grid(task, 3))


@pytest.mark.long
@pytest.mark.parametrize(
    ("device", "scene", "ripple"), list(product(("homerehab", "light", "heavy"), SCENES, RIPPLES))
)
def test_free_cutoffs_are_within_a_percent_of_a_fine_grid(
    device: str, scene: str, ripple: float
) -> None:
    """60 by 60 cut-offs and none, three devices, three scenes, three ripple limits."""
    task = task_of(device, SCENES[scene], ripple)
    filters = choose_filters(task, _silent)
    assert _within(worth_of(task, filters), best_of_grid(task, 60))


def test_a_grid_finds_what_a_poor_choice_loses() -> None:
    """The measure above tells: an octave more or less filtering, or none, is worth clearly less."""
    task = task_of("homerehab", {"it": {"damping": 30.0, "mass": "max"}})
    filters = choose_filters(task, _silent)
    assert filters.acceleration_filter_hz is not None
    best = worth_of(task, filters)
    for poor in (None, filters.acceleration_filter_hz / 2, filters.acceleration_filter_hz * 2):
        worth = worth_of(task, replace(filters, acceleration_filter_hz=poor))
        assert worth < (best.kept, best.value - 10 * ONE_PERCENT)


@pytest.mark.parametrize(("seed", "kept"), [(55, 2), pytest.param(7, 2, marks=pytest.mark.long)])
def test_every_effect_is_kept_where_some_pair_of_cutoffs_keeps_it(seed: int, kept: int) -> None:
    """A line through the middle of all cut-offs keeps one; the best pairs keep both."""
    pair = random_pair(seed)
    free = {"velocity_filter_hz": "free", "acceleration_filter_hz": "free"}
    scene = pair.scene.model_copy(update={"loop": pair.scene.loop.model_copy(update=free)})
    task = DesignTask.of(stated(pair.device), scene, default_table())
    assert worth_of(task, choose_filters(task, _silent)).kept == (kept,)


@pytest.mark.long
@pytest.mark.skipif(platform.machine() not in {"x86_64", "AMD64"}, reason="names of x86 kernels")
def test_another_kernel_of_linear_algebra_chooses_the_same() -> None:
    """Rounding must not decide: cut-offs agree to half a per cent, worth to a part in a million."""
    code = "from tests.test_cutoffs import demo_choice\nprint(*demo_choice())"
    env = {**os.environ, "OPENBLAS_CORETYPE": "Nehalem"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=env
    )
    assert done.returncode == 0, done.stderr
    there = [float(each) for each in done.stdout.split()]
    here = demo_choice()
    assert there[:2] == pytest.approx(here[:2], rel=5e-3)
    assert there[2] == pytest.approx(here[2], abs=1e-6)


@pytest.mark.parametrize(
    ("elements", "loop"),
    [
        ({"wall": {"stiffness": "max"}}, {}),
        ({"it": {"damping": "max"}}, {"velocity_window_samples": 8}),
        (
            {"it": {"damping": "max", "mass": "max"}},
            {"velocity_filter_hz": 50.0, "acceleration_filter_hz": "none"},
        ),
    ],
)
def test_nothing_is_tried_where_nothing_is_free(
    elements: dict[str, Any], loop: dict[str, Any]
) -> None:
    filters = choose_filters(task_of("homerehab", elements, loop=loop), _never)
    assert filters.velocity_filter_hz == loop.get("velocity_filter_hz")
    assert filters.acceleration_filter_hz is None
    assert filters.velocity_window_samples == loop.get("velocity_window_samples")


def test_a_filter_that_is_fixed_stays_while_the_other_is_found() -> None:
    loop = {"velocity_filter_hz": 40.0, "velocity_filter_order": 2, "filter_damping_ratio": 0.7}
    task = task_of("homerehab", {"cup": {"damping": 30.0, "mass": "max"}}, loop=loop)
    filters = choose_filters(task, _silent)
    assert filters.velocity_filter_hz == 40.0
    assert filters.velocity_filter_order == 2
    assert filters.filter_damping_ratio == 0.7
    assert filters.acceleration_filter_hz is not None
    assert 20 < filters.acceleration_filter_hz < 60


def test_no_filter_where_none_is_needed() -> None:
    """Ten times the ripple allowed: a wanted damper is felt best as it is."""
    task = task_of("homerehab", {"water": {"damping": 10.0}}, 10.0)
    assert choose_filters(task, _silent).velocity_filter_hz is None


def test_a_loop_too_slow_for_any_filter_has_none() -> None:
    """At 0.12 s a sample even the highest cut-off, 4.2 Hz, cuts the motions people make."""
    device = load_device("homerehab").model_copy(
        update={"sample_time": quantity(0.12), "delay": quantity(0.0)}
    )
    scene = Scene.model_validate({"elements": {"water": {"damping": "max"}}})
    assert (
        choose_filters(DesignTask.of(device, scene, default_table()), _never).velocity_filter_hz
        is None
    )


@pytest.mark.parametrize(
    ("numbers", "fixed"),
    [
        # The better of two hills has no velocity filter, and the first climbed is not left.
        ((1e-3, 2e-3, 2.621, 8.055, 0.696e-6, 29.2, 60.4, 0.279, 0.133), ("none", 18.4)),
        # Limits meet in a ridge that bends: the function is concave on neither side.
        ((5e-4, 1e-3, 0.6285, 4.164, 4.889e-6, 37.4, 74.8, 0.7245, 0.04566), (90.4, 18.8)),
    ],
)
def test_no_cutoffs_found_from_outside_are_a_percent_better(
    numbers: tuple[float, ...], fixed: tuple[float | str, float]
) -> None:
    step, delay, mass, damping, count, continuous, peak, friction, ripple = numbers
    device = Device(
        name="drawn",
        motion="linear",
        sample_time=quantity(step),
        delay=quantity(delay),
        encoder_resolution=quantity(count),
        force_limit=ForceLimit(continuous=continuous, peak=peak),
        mass=quantity(mass),
        damping=quantity(damping),
        coulomb_friction=quantity(friction),
    )
    wish = dict.fromkeys(("stiffness", "damping", "mass"), "max")
    motion = {"penetration": 0.01, "speed": 0.2, "acceleration": 2.0}
    products: list[float] = []
    for velocity, acceleration in (("free", "free"), fixed):
        scene = Scene.model_validate(
            {
                "elements": {"all": wish | motion},
                "margin": "conservative",
                "ripple_limit": ripple,
                "loop": {"velocity_filter_hz": velocity, "acceleration_filter_hz": acceleration},
            }
        )
        steps = optimise(as_stored(device), scene).elements["all"].perceived_steps
        products.append(math.prod(steps.values()))
    assert products[0] >= 0.99 * products[1]


def test_a_wanted_value_is_met_by_filters_that_allow_it() -> None:
    """Of this mass less would be felt as well with less filtering; but it is wanted."""
    profile = optimise(
        load_device("homerehab"),
        Scene.model_validate({"elements": {"cup": {"mass": 1.0, "damping": 50.0}}}),
    )
    assert profile.elements["cup"].mass == 1.0
    assert profile.elements["cup"].limited_by == {"mass": "wanted", "damping": "wanted"}


def test_a_range_no_filter_allows_is_refused_as_before() -> None:
    with pytest.raises(NoFeasibleEffectError, match="range starts at 2000"):
        optimise(
            load_device("homerehab"),
            Scene.model_validate({"elements": {"cup": {"mass": {"min": 2000.0, "max": 3000.0}}}}),
        )
