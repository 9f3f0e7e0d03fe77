"""Cut-offs that are free: against every cut-off of a fine grid, and what they are chosen by."""

from __future__ import annotations

import subprocess
import sys
from itertools import product
from typing import Any

import numpy as np
import pytest

from identification import load_device, quantity
from tests.filter_cases import DEVICES, RIPPLES, SCENES, best_of_grid, job_of, worth_of
from tune import NoFeasibleEffectError, Scene, optimise
from tune.documents.perception import default_table
from tune.loop.filters import Filters
from tune.optimisation.cutoffs import choose_filters
from tune.optimisation.problem import Job
from tune.optimisation.solve import groups, solve
from tune.optimisation.worth import FELT, net_steps, worth
from tune.rendering.rendered import impedances

#: Worth is a sum of logarithms of steps: one per cent of all of them multiplied.
ONE_PERCENT = 0.01


def _silent(sentence: str) -> None:
    del sentence


def _one_percent(job: Job, filters: Filters) -> float:
    """In worth; an effect that is not felt as itself has its steps weighed by FELT."""
    every = [
        net_steps(job, solved, index)
        for elements in groups(job.scene)
        for solved in [solve(job, elements, filters, second_opinion=False)]
        for index in range(solved.sizes.size)
    ]
    return ONE_PERCENT if min(every) >= 1 else ONE_PERCENT * FELT


def _never(sentence: str) -> None:
    raise AssertionError(sentence)


@pytest.mark.parametrize(("device", "ripple"), list(product(DEVICES, RIPPLES)))
def test_a_mass_alone_is_within_a_percent_of_every_cutoff(device: str, ripple: float) -> None:
    job = job_of(device, SCENES["cup"], ripple)
    filters = choose_filters(job, _silent)
    assert filters.velocity_filter_hz is None
    assert worth_of(job, filters) >= best_of_grid(job, 30) - _one_percent(job, filters)


def test_a_scene_is_within_a_percent_of_every_cutoff() -> None:
    job = job_of("homerehab", SCENES["mix"])
    filters = choose_filters(job, _silent)
    assert worth_of(job, filters) >= best_of_grid(job, 16) - _one_percent(job, filters)


@pytest.mark.long
@pytest.mark.parametrize(
    ("device", "scene", "ripple"), list(product(("homerehab", "light", "heavy"), SCENES, RIPPLES))
)
def test_free_cutoffs_are_within_a_percent_of_a_fine_grid(
    device: str, scene: str, ripple: float
) -> None:
    """60 by 60 cut-offs and none, three devices, three scenes, three ripple limits."""
    job = job_of(device, SCENES[scene], ripple)
    filters = choose_filters(job, _silent)
    assert worth_of(job, filters) >= best_of_grid(job, 60) - _one_percent(job, filters)


def test_a_grid_finds_what_a_poor_choice_loses() -> None:
    """The measure above tells: an octave more filtering, or none, is worth clearly less."""
    job = job_of("homerehab", SCENES["cup"])
    filters = choose_filters(job, _silent)
    assert filters.acceleration_filter_hz is not None
    best = best_of_grid(job, 12)
    for poor in (None, filters.acceleration_filter_hz / 2, filters.acceleration_filter_hz * 2):
        assert worth_of(job, Filters(acceleration_filter_hz=poor)) < best - 10 * ONE_PERCENT


def test_what_a_mass_brings_as_damping_counts_against_it() -> None:
    """κ_a·M against m, less ρ_a·M against b beyond one step; felt shares by plain summation."""
    job = job_of("homerehab", SCENES["cup"])
    filters = Filters(acceleration_filter_hz=12.0)
    solved = solve(job, ["cup"], filters, second_opinion=False)
    frequency = np.geomspace(0.5, 5.0, 4001)
    felt = impedances(filters, frequency, sample_time=1e-3, delay=1e-3).mass
    share, honey = np.mean(felt.imag / (2 * np.pi * frequency)), np.mean(felt.real)
    mass = float(solved.sizes[0])
    steps = np.log1p(share * mass / 3.0) / np.log1p(0.225)
    unasked = np.log1p(honey * mass / 10.0) / np.log1p(0.267)
    assert unasked > 3
    assert net_steps(job, solved, 0) == pytest.approx(steps - (unasked - 1), abs=0.02)
    assert worth(net_steps(job, solved, 0)) < FELT


def test_a_little_damping_beside_a_mass_costs_nothing() -> None:
    job = job_of("homerehab", {"cup": {"mass": 0.7}}, 30.0)
    solved = solve(job, ["cup"], Filters(acceleration_filter_hz=50.0), second_opinion=False)
    assert net_steps(job, solved, 0) == solved.problem.unknowns[0].steps(0.7)


def test_worth_rises_with_every_step_and_a_felt_effect_outweighs_others() -> None:
    steps = np.array([-np.inf, -50.0, -1.0, 0.0, 0.9, 1.0, 1.1, 2.0, 10.0])
    values = [worth(float(each)) for each in steps]
    assert values == sorted(values)
    assert values[0] == 0
    assert worth(1.0) + 3 * worth(1.0) > 3 * worth(40.0)
    assert worth(4.0) - worth(2.0) == pytest.approx(np.log(2))


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
    filters = choose_filters(job_of("homerehab", elements, loop=loop), _never)
    assert filters.velocity_filter_hz == loop.get("velocity_filter_hz")
    assert filters.acceleration_filter_hz is None
    assert filters.velocity_window_samples == loop.get("velocity_window_samples")


def test_a_filter_that_is_fixed_stays_while_the_other_is_found() -> None:
    loop = {"velocity_filter_hz": 40.0, "velocity_filter_order": 2, "filter_damping_ratio": 0.7}
    job = job_of("homerehab", {"it": {"damping": 20.0}, "cup": {"mass": "max"}}, loop=loop)
    filters = choose_filters(job, _silent)
    assert filters.velocity_filter_hz == 40.0
    assert filters.velocity_filter_order == 2
    assert filters.filter_damping_ratio == 0.7
    assert filters.acceleration_filter_hz is not None
    assert 20 < filters.acceleration_filter_hz < 60


def test_no_filter_where_none_is_needed() -> None:
    """Ten times the ripple allowed: a wanted damper is felt best as it is."""
    job = job_of("homerehab", {"water": {"damping": 10.0}}, 10.0)
    assert choose_filters(job, _silent).velocity_filter_hz is None


def test_a_loop_too_slow_for_any_filter_has_none() -> None:
    """At 0.12 s a sample even the highest cut-off, 4.2 Hz, cuts the motions people make."""
    device = load_device("homerehab").model_copy(
        update={"sample_time": quantity(0.12), "delay": quantity(0.0)}
    )
    scene = Scene.model_validate({"elements": {"water": {"damping": "max"}}})
    assert choose_filters(Job.of(device, scene, default_table()), _never).velocity_filter_hz is None


def test_the_choice_is_the_same_every_time_and_written_with_four_digits() -> None:
    job = job_of("light", {"it": {"damping": "max"}, "cup": {"mass": "max"}})
    first, second = choose_filters(job, _silent), choose_filters(job, _silent)
    assert first == second
    for hertz in (first.velocity_filter_hz, first.acceleration_filter_hz):
        assert hertz is not None
        assert hertz == float(f"{hertz:.4g}")


def test_a_wanted_value_is_met_by_filters_that_allow_it() -> None:
    """Of this mass less would be felt as well with less filtering; but it is wanted."""
    profile = optimise(
        load_device("homerehab"), Scene.model_validate({"elements": {"cup": {"mass": 2.5}}})
    )
    assert profile.elements["cup"].mass == 2.5
    assert profile.elements["cup"].limited_by == {"mass": "wanted"}


def test_a_range_no_filter_allows_is_refused_as_before() -> None:
    with pytest.raises(NoFeasibleEffectError, match="range starts at 2000"):
        optimise(
            load_device("homerehab"),
            Scene.model_validate({"elements": {"cup": {"mass": {"min": 2000.0, "max": 3000.0}}}}),
        )


def test_effects_that_are_alone_find_their_filters_without_a_solver() -> None:
    code = (
        "import sys\n"
        "from tests.filter_cases import job_of\n"
        "from tune.optimisation.cutoffs import choose_filters\n"
        "job = job_of('homerehab', {'water': {'damping': 'max'}, 'cup': {'mass': 'max'}})\n"
        "assert choose_filters(job, print).acceleration_filter_hz\n"
        "sys.exit(', '.join({'casadi', 'nlopt'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "trying filters: velocity none" in done.stdout
