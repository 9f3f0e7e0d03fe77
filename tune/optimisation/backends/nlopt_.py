"""SLSQP through nlopt: the second opinion, and the fallback."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import HEIGHTS, Stage
from tune.optimisation.backends.evaluation import Evaluation
from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]

#: Evaluations and seconds allowed; nlopt has no other way of ending on a bad problem.
_EVALUATIONS = 100
_SECONDS = 2.0
#: How far it may go from its start, in log-sizes: far away the slopes at the start say nothing.
_STRIDE = 3.0
#: What a constraint that cannot be evaluated counts as: clearly violated, still a number.
_UNREACHABLE = 1e3


class Slsqp:
    """Sequential quadratic proposals; keeps its own best feasible point in case nlopt fails."""

    name = "slsqp"

    def propose(self, program: Program, stage: Stage, start: FloatArray) -> FloatArray | None:
        """See `tune.optimisation.backends.Backend`."""
        import nlopt

        count = start.size
        program_at = Evaluation(program, stage)
        best: list[tuple[float, FloatArray]] = []

        def objective(z: FloatArray, gradient: FloatArray) -> float:
            here = program_at.at(z)
            if gradient.size:
                gradient[:] = np.nan_to_num(here.slope)
            return here.value if np.isfinite(here.value) else _UNREACHABLE

        def constraints(result: FloatArray, z: FloatArray, gradient: FloatArray) -> None:
            here = program_at.at(z)
            result[:] = np.nan_to_num(here.constraints, nan=_UNREACHABLE, posinf=_UNREACHABLE)
            if gradient.size:
                gradient[:] = np.nan_to_num(here.jacobian)
            height = objective(z, np.empty(0))
            if np.all(result <= 0) and (not best or height < best[0][0]):
                best[:] = [(height, np.array(z))]

        size = program_at.constraints.size
        solver = nlopt.opt(nlopt.LD_SLSQP, count + 1)
        lower = np.maximum(program.lower, np.minimum(start, program.upper) - _STRIDE)
        upper = np.minimum(program.upper, np.maximum(start, program.lower) + _STRIDE)
        solver.set_lower_bounds(np.append(lower, HEIGHTS[0]))
        solver.set_upper_bounds(np.append(upper, HEIGHTS[1]))
        solver.set_min_objective(objective)
        solver.add_inequality_mconstraint(constraints, np.full(size, 1e-9))
        solver.set_maxeval(_EVALUATIONS)
        solver.set_maxtime(_SECONDS)
        solver.set_xtol_rel(1e-12)
        z: FloatArray | None = None
        try:
            first = np.append(np.clip(start, lower, upper), stage.start)
            z = np.asarray(solver.optimize(first), dtype=np.float64)
        except Exception:  # noqa: BLE001 - its classes differ between versions; None says it failed
            z = None
        if best and (z is None or best[0][0] < objective(z, np.empty(0))):
            z = best[0][1]
        return z[:count] if z is not None and np.all(np.isfinite(z)) else None
