"""What the search for a better optimum stands on: crossings, ripple, scale and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from identification import Device, ForceLimit, load_device, quantity
from tests.optimum_answers import (
    UNDECIDED,
    case_of,
    nothing_dropped,
    reference_of,
    solved_of,
)
from tests.optimum_loops import Corner, Loops
from tests.optimum_pairs import random_pair
from tests.optimum_reference import Reference
from tests.optimum_ripple import force_ripple
from tests.optimum_wishes import MARGINS, felt_share, weber_fraction
from tests.reference import crossings
from tests.sampled_loops import loop_along
from tune.documents.perception import default_table
from tune.documents.scene import Scene
from tune.loop.loop import Filters
from tune.optimisation.problem import DesignTask
from tune.optimisation.solve import solve


@pytest.mark.parametrize("seed", range(12))
def test_first_crossings_are_those_of_360_digits(seed: int) -> None:
    pair = random_pair(12 * seed + 9)  # of those in a hand
    rng = np.random.default_rng(seed)
    reference = reference_of(pair, nothing_dropped())
    place = rng.integers(len(reference.loops.corners))
    corner = reference.loops.corners[place]
    mass, step = corner.mass, corner.sample_time
    totals = np.array([2e-3 * mass / step**2, 0.02 * mass / step, mass]) * rng.uniform(0, 1, 3)
    totals *= rng.random(3) < 0.8
    totals[2] *= rng.choice([1.0, -0.2])
    totals[0] += (not totals.any()) * mass
    one = Loops([corner], pair.filters_hz)
    truth = crossings(
        loop_along(case_of(corner, pair.filters_hz), *(float(x) or None for x in totals))
    )
    found = one.crossings(totals[None], 1e9).gain
    assert bool(truth) == bool(found.size)
    if truth:
        assert np.min(found) == pytest.approx(float(truth[0].mid()), rel=1e-9)


@pytest.mark.parametrize(
    ("delay", "cutoff", "printed"),
    [(0, None, "4.6"), (1, None, "4.2"), (2, None, "4.3"), (1, 50.0, "0.15"), (1, 20.0, "0.026")],
)
def test_ripple_is_the_printed_one(delay: int, cutoff: float | None, printed: str) -> None:
    """docs/theory.md, 5: a virtual mass of 1 kg on an encoder of 6 µm."""
    corner = Corner(mass=3.0, damping=10.0, sample_time=1e-3, samples=delay)
    felt = force_ripple(Loops([corner], (cutoff, cutoff)), np.array([[0.0, 0.0, 1.0]]), 6e-6)
    digits = len(printed.partition(".")[2])
    assert f"{felt[0]:.{digits}f}" == printed


def test_the_scale_is_that_of_the_profile() -> None:
    """Weber fractions from the paper's counts, and what is felt of a filtered damper and mass."""
    pair = random_pair(2)
    solved = solved_of(pair)
    reference = reference_of(pair, solved)
    for one, unknown in zip(reference.wanted, solved.problem.unknowns, strict=True):
        size = 3.3 * one.reference
        assert one.steps(size) == pytest.approx(unknown.steps(size), rel=1e-9)
    assert weber_fraction(0) == pytest.approx(0.338, abs=5e-4)
    assert felt_share(load_device("homerehab"), None, 1) == pytest.approx(1.0, abs=0.01)


# Closed forms.


def _lone_spring(device: Device, scene: Scene) -> float:
    """K at the worst corner, from the Jury conditions of the held double pole, by hand.

    Without delay z² + (αφ - 1 - ε)z + ε + αχ with φ, χ of the hold: ε + αχ = 1. One sample later
    z(z - 1)(z - ε) + α(φz + χ): 1 - (αχ)² = ε + αφ + αχ(1 + ε).
    """
    gain, extra = MARGINS[scene.margin]
    assert extra == 1
    box = device.simultaneous_box()
    found: list[float] = []
    for mass in box.mass:
        for damping in box.damping:
            for step in box.sample_time:
                delta = damping * step / mass
                epsilon = np.exp(-delta)
                now = (delta - 1 + epsilon) / delta**2
                before = (1 - (1 + delta) * epsilon) / delta**2
                rest = -np.expm1(-delta)
                slope = now + before * (1 + epsilon)
                late = 2 * rest / (slope + np.sqrt(slope**2 + 4 * before**2 * rest))
                found.append(min(late, rest / before) * mass / step**2 / gain)
    return min(found)


def _bare(**changes: object) -> Device:
    """Nothing limits it but stability; no delay, so that printed polynomials apply."""
    usual = {"force_limit": None, "encoder_resolution": None, "delay": quantity(0.0)}
    return load_device("homerehab").model_copy(update=usual | changes)


@pytest.mark.parametrize("mass", [0.05, 3.0, 95.0])
@pytest.mark.parametrize("margin", ["balanced", "firm"])
def test_a_lone_spring_ends_where_the_cubic_says(mass: float, margin: str) -> None:
    device = _bare(
        mass=quantity(mass, 0.98 * mass, 1.02 * mass),
        damping=quantity(mass, 0.9 * mass, mass),
        coulomb_friction=quantity(0.0),
    )
    wall = {"stiffness": "max", "penetration": 0.1}
    scene = Scene.model_validate({"elements": {"wall": wall}, "margin": margin})
    truth = _lone_spring(device, scene)
    solved = solve(DesignTask.of(device, scene, default_table()), ["wall"], Filters())
    assert solved.unrounded[0] == pytest.approx(truth, rel=1e-8)
    assert truth * (1 - 1.1e-5) <= solved.sizes[0] <= truth * (1 + UNDECIDED)
    reference = Reference(device, scene, ["wall"], (None, None))
    assert np.exp(reference.alone(0)) == pytest.approx(truth, rel=1e-9)


@pytest.mark.parametrize(
    ("elements", "changes", "truth"),
    [
        # Sustained force, K·penetration.
        (
            {"stiffness": "max", "penetration": 0.02},
            {"force_limit": ForceLimit(continuous=7.0, peak=28.0)},
            350.0,
        ),
        # Peak force of a damper, B·speed.
        (
            {"damping": "max", "speed": 0.5},
            {"force_limit": ForceLimit(continuous=5.0, peak=5.0)},
            10.0,
        ),
        # A third of the least damping of the box; the box of a known damping is that damping.
        ({"damping": "min"}, {"damping": quantity(10.0)}, 10.0 / 3),
        ({"damping": 12.0}, {}, 12.0),
    ],
)
def test_limits_that_are_no_matter_of_stability(
    elements: dict[str, object], changes: dict[str, object], truth: float
) -> None:
    scene = Scene.model_validate({"elements": {"it": elements}, "margin": "conservative"})
    solved = solve(
        DesignTask.of(_bare(**changes), scene, default_table()),
        ["it"],
        Filters(velocity_filter_hz=30.0, acceleration_filter_hz=20.0),
    )
    assert solved.unrounded[0] == pytest.approx(truth, rel=1e-8)
    assert solved.sizes[0] == pytest.approx(truth, rel=1.1e-5)
