"""What a height costs at an optimum: Lagrange multipliers, from the slopes at a setting.

At a (local) optimum the gradient of the objective is a nonnegative combination of those of the
constraints that bind. The multiplier of ``height_i >= floor_i + active_i·t`` is what one step more
of effect i would cost of the common height t; where it is positive, i cannot rise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import Stage
from tune.optimisation.backends.evaluation import Evaluation
from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]

#: A constraint this near to its limit binds: settings are right to about 1e-7, slopes about 1.
_BINDS = 1e-6
#: What may be left of a gradient of length one at an optimum, for slopes change within 1e-6 too.
_LEFT = 1e-3


def prices(program: Program, stage: Stage, z: FloatArray) -> FloatArray | None:
    """The multiplier of every height at a setting that ends a stage.

    Args:
        program: with its numbers.
        stage: that raised a common height.
        z: (log-sizes, common height) it ended at.

    Returns:
        Shape (unknowns,), they add up to 1 over what was raised; None where the setting is no
        optimum to first order.
    """
    from scipy.optimize import nnls

    found = Evaluation(program, stage).at(z)
    count = program.lower.size
    binding = np.flatnonzero(found.constraints > -_BINDS)
    upper = np.flatnonzero(z[:-1] > program.upper - _BINDS)
    lower = np.flatnonzero(z[:-1] < program.lower + _BINDS)
    identity = np.eye(count + 1)
    slopes = np.concatenate([found.jacobian[binding], identity[upper], -identity[lower]])
    if not (len(slopes) and np.all(np.isfinite(slopes)) and np.all(np.isfinite(found.slope))):
        return None
    # Each constraint in its own unit: only the direction of its slope matters.
    sizes = np.linalg.norm(slopes, axis=1)
    sizes[sizes == 0] = 1.0
    try:
        multipliers, left = nnls((slopes / sizes[:, None]).T, -found.slope)
    except RuntimeError:
        return None
    if left > _LEFT * float(np.linalg.norm(found.slope)):
        return None
    # The heights are the last constraints of a program.
    first = found.constraints.size - count
    answer = np.zeros(count)
    for row, multiplier in zip(binding, multipliers / sizes, strict=False):
        if row >= first:
            answer[row - first] = multiplier
    return answer
