"""Where a climb begins: the best of some rays through what is allowed, before any solver is asked.

What is allowed is not convex; from nothing a solver may end on the wrong hill. On each ray the
perceived steps of the unknowns keep a fixed proportion, up to what each may be by itself.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.bounds import force_bound
from tune.optimisation.limits import allowed, allowed_points, cheaply_allowed, likely_stable
from tune.optimisation.problem import Problem

FloatArray = NDArray[np.float64]

#: Steps of one unknown for a step of another, along the rays: all patterns of few unknowns, one
#: against all others of many.
_PROPORTIONS = (1.0, 4.0, 16.0)
_FEW = 3
#: Points of a ray, from hardly perceptible to the most of anything.
_LEVELS = 30
_LOWEST = 0.01
#: Kept from the edge, in parts of the perceived steps.
_INSIDE = 0.98


def interior(problem: Problem) -> FloatArray | None:
    """An allowed setting that is good by the ranks of its unknowns, a little inside; or None."""
    unknowns = problem.unknowns
    nothing = np.zeros(len(unknowns))
    most = [min(u.high, force_bound(problem, nothing, i)) for i, u in enumerate(unknowns)]
    caps = np.array([u.steps(max(m, u.low)) for u, m in zip(unknowns, most, strict=True)])
    most_steps = float(caps.max())
    levels = np.asarray(
        np.geomspace(min(_LOWEST, most_steps), most_steps, _LEVELS), dtype=np.float64
    )
    steps = np.minimum(_rays(len(unknowns))[:, None] * levels[:, None], caps)
    steps = steps.reshape(-1, len(unknowns))
    kept = np.flatnonzero(cheaply_allowed(problem, _sizes(problem, steps)))
    goals = np.array([unknown.goal for unknown in unknowns])
    ranks = np.array([unknown.level for unknown in unknowns])
    order = kept[_best_first(steps[kept] - goals, ranks)]
    wanted = np.array([unknown.wish.kind == "value" for unknown in unknowns])
    first, count = 0, 1
    while first < order.size:
        chosen = steps[order[first : first + count]]
        # The best is good more often than not; the more are not, the more are looked at together.
        first, count = first + count, 2 * count
        chosen = chosen[likely_stable(problem, _sizes(problem, chosen))]
        # What is met exactly stays so: then no solver has to be asked for it.
        chosen = np.where(wanted & (chosen >= caps), chosen, chosen * _INSIDE)
        points = _sizes(problem, chosen)
        good = np.flatnonzero(allowed_points(problem, points))
        if good.size:
            return points[good[0]]
    low = np.array([unknown.low for unknown in unknowns])
    return low if allowed(problem, low) else None


def _sizes(problem: Problem, steps: FloatArray) -> FloatArray:
    """Sizes of perceived steps, (points, unknowns), none below the least."""
    sizes = [u.size_at(column) for u, column in zip(problem.unknowns, steps.T, strict=True)]
    return np.maximum(np.stack(sizes, axis=1), [unknown.low for unknown in problem.unknowns])


def _best_first(heights: FloatArray, ranks: NDArray[np.int64]) -> NDArray[np.intp]:
    """The order of rows of heights: by the lowest of the first rank, then of the next."""
    lowest = [np.min(heights[:, ranks == rank], axis=1) for rank in np.unique(ranks)]
    return np.lexsort([-each for each in reversed(lowest)])


def _rays(count: int) -> FloatArray:
    """Proportions, shape (rays, unknowns), the least of each 1."""
    if count <= _FEW:
        patterns = np.array(list(product(_PROPORTIONS, repeat=count)))
    else:
        most = np.eye(count) * (_PROPORTIONS[-1] - 1) + 1
        patterns = np.concatenate([np.ones((1, count)), most, _PROPORTIONS[-1] / most])
    return patterns[patterns.min(axis=1) == 1]
