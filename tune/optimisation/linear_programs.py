"""Linear programs by HiGHS, and two uses of them: multipliers of what binds, and cutting planes.

Through CasADi, which a tuning has loaded anyway; scipy.optimize alone would take a third of a
second to import. With the multipliers the slope of an optimum by any other number follows from the
slopes of the constraints by that number alone (envelope theorem).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import Evaluation, Program, Rank

FloatArray = NDArray[np.float64]


#: A constraint this near to its limit binds: settings are right to about 1e-7, slopes about 1.
_BINDS = 1e-6
#: What may be left of a gradient of length one at an optimum, for slopes change within 1e-6 too.
_LEFT = 1e-3
#: Points at most; ten are usual.
_MOST = 30
#: The trust region ends the search where it is this small, and shrinks or grows by so much.
_SMALLEST, _SHRINKS, _GROWS = 2e-3, 0.4, 2.0
#: Part of the rise to the best point that a plane must explain to be a bound there. Clear of 1,
#: which rounding would decide where the function is nearly straight.
_EXPLAINS = 0.9


def solve_linear_program(
    cost: FloatArray,
    rows: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray | None:
    """The x of least cost·x with rows·x between two ends and x between two bounds, if there is one.

    All numbers are of one scale, without unit, and infinite for no end or bound.
    """
    solver = _solver(*rows.shape)
    found = solver(g=cost, a=rows, lba=ends[0], uba=ends[1], lbx=bounds[0], ubx=bounds[1])
    if not solver.stats()["success"]:
        return None
    return np.asarray(found["x"], dtype=np.float64).ravel()


def nonnegative_combination(columns: FloatArray, target: FloatArray) -> FloatArray | None:
    """Weights, none negative, of the combination of columns that comes nearest to a target.

    Nearest in the sum of absolute differences. Columns and target are of length about one. None
    where the solver gives up.
    """
    rows, count = columns.shape
    identity = np.eye(rows)
    cost = np.concatenate([np.zeros(count), np.ones(2 * rows)])
    answer = solve_linear_program(
        cost,
        np.hstack([columns, identity, -identity]),
        (target, target),
        (np.zeros_like(cost), np.full_like(cost, np.inf)),
    )
    return None if answer is None else np.maximum(answer[:count], 0.0)


@lru_cache(maxsize=256)
def _solver(rows: int, unknowns: int) -> Any:
    import casadi as ca

    shape = {"h": ca.Sparsity(unknowns, unknowns), "a": ca.Sparsity.dense(rows, unknowns)}
    options = {"error_on_fail": False, "highs": {"output_flag": False}}
    return ca.conic("linear_program", "highs", shape, options)


def multipliers(program: Program, rank: Rank, y: FloatArray) -> FloatArray | None:
    """The Lagrange multiplier of every constraint at log-sizes that end a rank, zero of most.

    At a (local) optimum the gradient of the objective is a nonnegative combination of those of the
    constraints that bind; None where the setting is no optimum to first order.
    """
    found = Evaluation(program, rank).at(y)
    binding = np.flatnonzero(found.constraints > -_BINDS)
    upper = np.flatnonzero(y > rank.upper - _BINDS)
    lower = np.flatnonzero(y < rank.lower + _BINDS)
    identity = np.eye(y.size)
    slopes = np.concatenate([found.jacobian[binding], identity[upper], -identity[lower]])
    if not (len(slopes) and np.all(np.isfinite(slopes)) and np.all(np.isfinite(found.slope))):
        return None
    # Each constraint in its own unit: only the direction of its slope matters.
    sizes = np.linalg.norm(slopes, axis=1)
    sizes[sizes == 0] = 1.0
    length = float(np.linalg.norm(found.slope)) or 1.0
    directions, target = (slopes / sizes[:, None]).T, -found.slope / length
    weights = nonnegative_combination(directions, target)
    if weights is None or np.linalg.norm(directions @ weights - target) > _LEFT:
        return None
    answer = np.zeros(found.constraints.size)
    answer[binding] = (weights * length / sizes)[: binding.size]
    return answer


def maximise(
    value: Callable[[Sequence[float]], float],
    slopes: Callable[[Sequence[float]], Sequence[float]],
    start: Sequence[float],
    ends: Sequence[tuple[float, float]],
    *,
    radius: float,
    gain: float,
) -> list[float]:
    """The best point met by Kelley's cutting planes, from a good start.

    For functions that are smooth but for edges where one limit takes over from another: a maximum
    on an edge is met by the tangents of both sides. Each point adds a plane above the function; the
    next point is where the lowest of them is highest, no further than the trust region reaches. J.
    E. Kelley, The cutting-plane method for solving convex programs, J. SIAM 8 (1960) 703.

    A value is minus infinity where a point is not good. The radius is that of the trust region at
    first, in each coordinate; the search ends where the planes promise less than the gain.
    """
    low, high = (np.array(side) for side in zip(*ends, strict=True))
    best = np.clip(np.array(start), low, high)
    most = value(best.tolist())
    planes = [(best, most, np.array(slopes(best.tolist())))]
    for _ in range(_MOST):
        near = np.maximum(low, best - radius), np.minimum(high, best + radius)
        place, promised = _highest(planes, best, most, *near)
        if promised < most + gain or radius < _SMALLEST:
            break
        found = value(place.tolist())
        if np.isfinite(found):
            planes.append((place, found, np.array(slopes(place.tolist()))))
        if found > most:
            radius *= _GROWS if found - most > 0.5 * (promised - most) else 1.0
            best, most = place, found
        else:
            radius = _SHRINKS * max(float(np.max(np.abs(place - best))), _SMALLEST)
    return best.tolist()


def _highest(
    planes: Sequence[tuple[FloatArray, float, FloatArray]],
    best: FloatArray,
    most: float,
    low: FloatArray,
    high: FloatArray,
) -> tuple[FloatArray, float]:
    """Where the lowest plane is highest between two corners, and how high.

    A plane that passes below the best point is no bound there, for the function is not concave
    everywhere and may jump: it is left out, and the trust region keeps away from where it was seen.
    """
    planes = [
        (place, height, slope)
        for place, height, slope in planes
        if slope @ (best - place) >= _EXPLAINS * (most - height)
    ]
    rows = np.array([np.append(-slope, 1.0) for _, _, slope in planes])
    heights = np.array([height - slope @ place for place, height, slope in planes])
    at_best = heights + np.array([slope @ best for _, _, slope in planes])
    heights += np.maximum(most - at_best, 0.0)
    answer = solve_linear_program(
        np.append(np.zeros(best.size), -1.0),
        rows,
        (np.full(len(rows), -np.inf), heights),
        (np.append(low, -np.inf), np.append(high, np.inf)),
    )
    return (best, most) if answer is None else (answer[:-1], float(answer[-1]))
