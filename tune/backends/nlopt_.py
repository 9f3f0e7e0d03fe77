"""SLSQP through nlopt: the second opinion, and the fallback."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.backends import HEIGHTS, Stage
from tune.backends.program import Program

FloatArray = NDArray[np.float64]

#: Evaluations and seconds allowed; nlopt has no other way of ending on a bad problem.
_EVALUATIONS = 300
_SECONDS = 2.0
#: What a constraint that cannot be evaluated counts as: clearly violated, still a number.
_UNREACHABLE = 1e3


class Slsqp:
    """Sequential quadratic proposals; keeps its own best feasible point in case nlopt fails."""

    name = "slsqp"

    def propose(self, program: Program, stage: Stage, start: FloatArray) -> FloatArray | None:
        """See `tune.backends.Backend`."""
        import nlopt

        count = start.size
        parameters = np.concatenate([program.parameters, stage.active, stage.floors, stage.weights])
        functions = program.functions
        best: list[tuple[float, FloatArray]] = []

        def objective(z: FloatArray, gradient: FloatArray) -> float:
            value, slope = functions.objective(z, parameters)
            if gradient.size:
                gradient[:] = np.nan_to_num(np.asarray(slope).ravel())
            number = float(value)
            return number if np.isfinite(number) else _UNREACHABLE

        def constraints(result: FloatArray, z: FloatArray, gradient: FloatArray) -> None:
            value, slope = functions.constraints(z, parameters)
            result[:] = np.nan_to_num(
                np.asarray(value).ravel(), nan=_UNREACHABLE, posinf=_UNREACHABLE
            )
            if gradient.size:
                gradient[:] = np.nan_to_num(np.asarray(slope))
            if np.all(result <= 0):
                height = objective(z, np.empty(0))
                if not best or height < best[0][0]:
                    best[:] = [(height, np.array(z))]

        size = int(functions.constraints.numel_out(0))
        solver = nlopt.opt(nlopt.LD_SLSQP, count + 1)
        solver.set_lower_bounds(np.append(program.lower, HEIGHTS[0]))
        solver.set_upper_bounds(np.append(program.upper, HEIGHTS[1]))
        solver.set_min_objective(objective)
        solver.add_inequality_mconstraint(constraints, np.full(size, 1e-9))
        solver.set_maxeval(_EVALUATIONS)
        solver.set_maxtime(_SECONDS)
        solver.set_xtol_rel(1e-12)
        z: FloatArray | None = None
        try:
            z = np.asarray(solver.optimize(np.append(start, stage.start)), dtype=np.float64)
        except Exception:  # noqa: BLE001 - its classes differ between versions; None says it failed
            z = None
        if best and (z is None or best[0][0] < objective(z, np.empty(0))):
            z = best[0][1]
        return z[:count] if z is not None and np.all(np.isfinite(z)) else None
