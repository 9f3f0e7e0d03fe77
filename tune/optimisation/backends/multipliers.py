"""Lagrange multipliers at a setting, from the slopes of what binds there.

At a (local) optimum the gradient of the objective is a nonnegative combination of those of the
constraints that bind. With the multipliers the slope of the optimum by any other number follows
from the slopes of the constraints by that number alone (envelope theorem).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import Rank
from tune.optimisation.backends.evaluation import Evaluation
from tune.optimisation.backends.program import Program
from tune.optimisation.linear_program import nonnegative_combination

FloatArray = NDArray[np.float64]

#: A constraint this near to its limit binds: settings are right to about 1e-7, slopes about 1.
_BINDS = 1e-6
#: What may be left of a gradient of length one at an optimum, for slopes change within 1e-6 too.
_LEFT = 1e-3


def multipliers(program: Program, rank: Rank, y: FloatArray) -> FloatArray | None:
    """The multiplier of every constraint at log-sizes that end a rank.

    Args:
        program: with its numbers.
        rank: that was raised.
        y: where it ended.

    Returns:
        Shape (constraints,), zero where one does not bind; None where the setting is no optimum to
        first order.
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
