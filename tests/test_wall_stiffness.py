"""Tuned walls beside stiffer ones, of which linear limits allow none."""

import numpy as np
import pytest

from tests.test_clamps import WALL
from tests.test_guard_play import random_device
from tests.thinned import thinned
from tune import Filters, NoFeasibleEffectError, SafeProfile, Scene, default_table, optimise
from tune.optimisation.feasibility import feasible_points
from tune.optimisation.problem import DesignTask, problem_of


def stiffer(wanted: Scene, profile: SafeProfile) -> bool:
    """Whether linear limits allow a twentieth more stiffness, or still more, beside the damping."""
    task = DesignTask.of(profile.device, wanted, default_table())
    filters = Filters(velocity_filter_hz=profile.loop.velocity_filter_hz)
    problem = problem_of(task, elements=["wall"], filters=filters, cut=frozenset({"wall"}))
    wall = profile.elements["wall"]
    sizes = np.geomspace(wall.stiffness / 0.95, 3 * wall.stiffness, 30)
    steepest = np.linspace(*problem.linear.leads[0][2:], 40)
    K, ratio = (each.ravel() for each in np.meshgrid(sizes, steepest, indexing="ij"))
    points = np.stack([K, K * ratio], axis=1)
    beside = points[:, 1] >= wall.damping * (1 - 1e-6)
    return bool(np.any(feasible_points(problem, points) & beside))


@pytest.mark.parametrize("seed", thinned(range(150), 6))
def test_tuned_walls_are_as_stiff_as_linear_limits_allow(seed: int) -> None:
    rng = np.random.default_rng([29, seed])
    margin, ripple = rng.choice(["conservative", "balanced", "firm"]), rng.choice([0.02, 0.1, 0.5])
    wanted = Scene.model_validate(
        {"margin": str(margin), "ripple_limit": float(ripple), "elements": {"wall": WALL}}
    )
    try:
        profile = optimise(random_device(seed), wanted)
    except NoFeasibleEffectError:
        pytest.skip("no wall that a hand could tell")
    wall = profile.elements["wall"]
    assert wall.damping == 0 or not stiffer(wanted, profile)
