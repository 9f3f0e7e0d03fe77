"""Tuned walls beside the stiffest that linear limits allow, found by a search of its own."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.test_clamps import WALL
from tests.test_guard_play import random_device
from tests.thinned import thinned
from tune import Filters, NoFeasibleEffectError, SafeProfile, Scene, default_table, optimise
from tune.optimisation.feasibility import feasible_points
from tune.optimisation.problem import DesignTask, problem_of


def stiffest(wanted: Scene, profile: SafeProfile) -> float:
    """The largest stiffness beside as much damping, by a grid that closes in, of linear limits."""
    task = DesignTask.of(profile.device, wanted, default_table())
    filters = Filters(velocity_filter_hz=profile.loop.velocity_filter_hz)
    problem = problem_of(task, elements=["wall"], filters=filters, cut=frozenset({"wall"}))
    wall = profile.elements["wall"]
    steepest = np.linspace(*problem.linear.leads[0][2:], 40)
    sizes: NDArray[np.float64] = np.geomspace(wall.stiffness / 2, 3 * wall.stiffness, 60)
    best = 0.0
    for width in (0.06, 0.015, 0.004):
        K, ratio = (each.ravel() for each in np.meshgrid(sizes, steepest, indexing="ij"))
        points = np.stack([K, K * ratio], axis=1)
        good = feasible_points(problem, points) & (points[:, 1] >= wall.damping * (1 - 1e-6))
        if not good.any():
            break
        best = max(best, float(K[good].max()))
        sizes = np.linspace(best, best * (1 + width), 30)
    return best


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
    assert wall.damping == 0 or wall.stiffness >= 0.95 * stiffest(wanted, profile)
