"""What the optimiser answers for a pair, and the reference that judges it."""

from __future__ import annotations

import numpy as np

from tests.optimum_loops import Corner
from tests.optimum_pairs import Pair
from tests.optimum_reference import Reference
from tests.reference import Case
from tune.documents.perception import default_table
from tune.optimisation.nash import Solution
from tune.optimisation.problem import DesignTask
from tune.optimisation.solve import solve

#: A size that is allowed may lie beyond the boundary by what no verdict decides.
UNDECIDED = 2e-9


def solved_of(pair: Pair) -> Solution:
    task = DesignTask.of(pair.device, pair.scene, default_table())
    return solve(task, pair.elements, pair.filters)


def reference_of(pair: Pair, solved: Solution) -> Reference:
    return Reference(
        pair.device, pair.scene, pair.elements, pair.filters_hz, frozenset(solved.dropped)
    )


def case_of(corner: Corner, filters_hz: tuple[float | None, float | None]) -> Case:
    velocity, acceleration = filters_hz
    return Case(
        mass=corner.mass,
        damping=corner.damping,
        sample_time=corner.sample_time,
        delay_samples=corner.samples,
        hand=corner.hand,
        velocity_filter_hz=velocity,
        acceleration_filter_hz=acceleration,
    )


def nothing_dropped() -> Solution:
    return Solution(problem=None, sizes=np.empty(0), dropped={})  # type: ignore[arg-type]
