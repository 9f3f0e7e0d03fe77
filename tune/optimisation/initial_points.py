"""Initial points of a search: the best of some rays through the feasible set.

What is allowed is not convex; from nothing a solver may end on the wrong hill. On each ray the
perceived steps of the unknowns keep a proportion, from one step to what each may be by itself.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.bounds import linear_bound
from tune.optimisation.limits import (
    feasible_points,
    is_feasible,
    passes_cheap_limits,
    stable_in_doubles,
)
from tune.optimisation.problem import Problem

FloatArray = NDArray[np.float64]

#: Steps of one unknown for a step of another, along the rays: all patterns of few unknowns, one
#: against all others of many.
_PROPORTIONS = (1.0, 4.0, 16.0)
_FEW = 3
#: Points of a ray, from one step of something to the most of anything.
_LEVELS = 24
_LOWEST = 0.1
#: Kept from the edge, in parts of the perceived steps.
_INSIDE = 0.98
#: Starts on different rays.
_STARTS = 2


def initial_points_of(problem: Problem, count: int = _STARTS) -> list[FloatArray]:
    """Allowed settings a little inside, the best by the ranks of its unknowns first; or none.

    Each setting has shape (unknowns,), SI units.

    Args:
        problem: with all its limits.
        count: of settings on different rays, at most.
    """
    unknowns, low = problem.unknowns, problem.low
    nothing = np.zeros(len(unknowns))
    most = [min(u.high, linear_bound(problem, nothing, i)) for i, u in enumerate(unknowns)]
    least = np.array([u.steps(u.low) for u in unknowns])
    caps = np.maximum([u.steps(max(m, u.low)) for u, m in zip(unknowns, most, strict=True)], least)
    levels = np.asarray(np.geomspace(_LOWEST, float(caps.max()), _LEVELS), dtype=np.float64)
    rays = _rays(len(unknowns))
    steps = np.clip(rays[:, None] * levels[:, None], least, caps).reshape(-1, len(unknowns))
    between = problem.linear.lead_points(problem.low, problem.high)
    more = [[u.steps(size) for u, size in zip(unknowns, row, strict=True)] for row in between]
    steps = np.concatenate([steps, np.array(more).reshape(-1, len(unknowns))])
    steps, places = np.unique(steps, axis=0, return_index=True)
    kept = np.flatnonzero(passes_cheap_limits(problem, _sizes(problem, steps)))
    ranks = np.array([unknown.level for unknown in unknowns])
    order = kept[_best_first(np.log(steps[kept]), ranks)]
    wanted = np.array([unknown.wish.kind == "value" for unknown in unknowns])
    found: list[FloatArray] = []
    ray = places // _LEVELS
    first, size = 0, 1
    while order.size > first and len(found) < count:
        chosen = order[first : first + size]
        # The best is good more often than not; the more are not, the more are looked at together.
        first, size = first + size, 2 * size
        chosen = chosen[stable_in_doubles(problem, _sizes(problem, steps[chosen]))]
        # What is met exactly stays so: then no solver has to be asked for it.
        inside = np.where(wanted & (steps[chosen] >= caps), 1.0, _INSIDE) * steps[chosen]
        points = _sizes(problem, np.maximum(inside, least))
        for place in np.flatnonzero(feasible_points(problem, points)):
            if len(found) < count and np.any(order):
                found.append(points[place])
                # The others of this ray lie below.
                order = order[(ray[order] != ray[chosen[place]]) | (np.arange(order.size) < first)]
    if not found and is_feasible(problem, low):
        return [low]
    return found


def _sizes(problem: Problem, steps: FloatArray) -> FloatArray:
    """Sizes of perceived steps, (points, unknowns), none below the least or above the most."""
    sizes = [u.size_at(column) for u, column in zip(problem.unknowns, steps.T, strict=True)]
    return np.clip(problem.linear.with_leads(np.stack(sizes, axis=1)), problem.low, problem.high)


def _best_first(logs: FloatArray, ranks: NDArray[np.int64]) -> NDArray[np.intp]:
    """The order of rows of logarithms of steps: by the product of the first rank, then the next."""
    sums = [np.sum(logs[:, ranks == rank], axis=1) for rank in np.unique(ranks)]
    return np.lexsort([-each for each in reversed(sums)])


def _rays(count: int) -> FloatArray:
    """Proportions, shape (rays, unknowns), the least of each 1."""
    if count <= _FEW:
        patterns = np.array(list(product(_PROPORTIONS, repeat=count)))
    else:
        most = np.eye(count) * (_PROPORTIONS[-1] - 1) + 1
        patterns = np.concatenate([np.ones((1, count)), most, _PROPORTIONS[-1] / most])
    return patterns[patterns.min(axis=1) == 1]
