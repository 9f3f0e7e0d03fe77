"""Sequential quadratic programming (SLSQP of nlopt), with the exact reach of stability."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import Rank
from tune.optimisation.backends.evaluation import Evaluation
from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]

#: Evaluations and seconds allowed; nlopt has no other way of ending on a bad problem.
_EVALUATIONS = 100
_SECONDS = 2.0
#: How far it may go from its start, in log-sizes: far away the slopes at the start say nothing.
_STRIDE = 3.0
#: Times it may go that far.
_STRIDES = 6
#: What a constraint that cannot be evaluated counts as: clearly violated, still a number.
_UNREACHABLE = 1e3
#: A constraint is kept if broken by less: programs ask for more than is needed.
_KEPT = 1e-9


@dataclass(frozen=True, slots=True)
class Slsqp:
    """Sequential quadratic proposals; keeps its own best point in case nlopt ends by rounding.

    Attributes:
        tolerance: of the sum of logarithms of steps, at which a search ends.
    """

    tolerance: float = 1e-13
    name: str = "slsqp"

    def propose(self, program: Program, rank: Rank, start: FloatArray) -> FloatArray | None:
        """Log-sizes, shape (unknowns,), from a start of that shape; None where it gave up."""
        program_at = Evaluation(program, rank)
        best: list[tuple[float, FloatArray]] = []

        def objective(y: FloatArray, gradient: FloatArray) -> float:
            here = program_at.at(y)
            if gradient.size:
                gradient[:] = np.nan_to_num(here.slope)
            return here.value if np.isfinite(here.value) else _UNREACHABLE

        def constraints(result: FloatArray, y: FloatArray, gradient: FloatArray) -> None:
            here = program_at.at(y)
            result[:] = np.nan_to_num(here.constraints, nan=_UNREACHABLE, posinf=_UNREACHABLE)
            if gradient.size:
                gradient[:] = np.nan_to_num(here.jacobian)
            value = objective(y, np.empty(0))
            if np.all(result <= _KEPT) and (not best or value < best[0][0]):
                best[:] = [(value, np.array(y))]

        y: FloatArray | None = start
        for _ in range(_STRIDES):
            lower, upper = _around(rank, start)
            rows = program_at.constraints.size
            y = _searched(objective, constraints, rows, start, lower, upper, self.tolerance)
            if y is None or not _stopped_short(y, rank, lower, upper):
                break
            start = y
        if best and (y is None or best[0][0] < objective(y, np.empty(0))):
            y = best[0][1]
        return y if y is not None and np.all(np.isfinite(y)) else None


def least_violation(program: Program, rank: Rank, start: FloatArray) -> FloatArray | None:
    """Log-sizes at which the most broken constraint is as little broken as can be found.

    Minimises t subject to every constraint being at most t; t stops a little inside.

    Start and answer have shape (unknowns,): logarithms of sizes in SI units.
    """
    program_at = Evaluation(program, rank)

    def objective(z: FloatArray, gradient: FloatArray) -> float:
        if gradient.size:
            gradient[:] = 0.0
            gradient[-1] = 1.0
        return float(z[-1])

    def constraints(result: FloatArray, z: FloatArray, gradient: FloatArray) -> None:
        here = program_at.at(z[:-1])
        rows = np.nan_to_num(here.constraints, nan=_UNREACHABLE, posinf=_UNREACHABLE)
        result[:] = rows - z[-1]
        if gradient.size:
            gradient[:, :-1] = np.nan_to_num(here.jacobian)
            gradient[:, -1] = -1.0

    y: FloatArray | None = None
    for _ in range(_STRIDES):
        lower, upper = _around(rank, start)
        rows = program_at.at(np.clip(start, lower, upper)).constraints
        worst = float(np.clip(np.nan_to_num(np.max(rows), nan=10.0), -_INSIDE, 10.0))
        ends = np.append(lower, -_INSIDE), np.append(upper, _UNREACHABLE)
        z = _searched(objective, constraints, rows.size, np.append(start, worst), *ends)
        if z is None or not np.all(np.isfinite(z)):
            break
        y = z[:-1]
        if not _stopped_short(y, rank, lower, upper) or z[-1] <= -_INSIDE:
            break
        start = y
    return y


#: How far inside all limits is far enough.
_INSIDE = 0.02


def _around(rank: Rank, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends of log-sizes that a search from a start looks at."""
    lower = np.maximum(rank.lower, np.minimum(start, rank.upper) - _STRIDE)
    upper = np.minimum(rank.upper, np.maximum(start, rank.lower) + _STRIDE)
    return lower, upper


def _stopped_short(y: FloatArray, rank: Rank, lower: FloatArray, upper: FloatArray) -> bool:
    """True where a search went as far as it was allowed to."""
    down, up = (y <= lower) & (lower > rank.lower), (y >= upper) & (upper < rank.upper)
    return bool(np.any(down | up))


def _searched(
    objective: Callable[[FloatArray, FloatArray], float],
    constraints: Callable[[FloatArray, FloatArray, FloatArray], None],
    rows: int,
    start: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    tolerance: float = 1e-6,
) -> FloatArray | None:
    """Where SLSQP ends; None where it fails."""
    import nlopt

    solver = nlopt.opt(nlopt.LD_SLSQP, start.size)
    solver.set_lower_bounds(lower)
    solver.set_upper_bounds(upper)
    solver.set_min_objective(objective)
    if rows:
        solver.add_inequality_mconstraint(constraints, np.full(rows, _KEPT))
    solver.set_maxeval(_EVALUATIONS)
    solver.set_maxtime(_SECONDS)
    solver.set_xtol_rel(1e-12)
    solver.set_ftol_abs(tolerance)
    try:
        return np.asarray(solver.optimize(np.clip(start, lower, upper)), dtype=np.float64)
    except Exception:  # noqa: BLE001 - its classes differ between versions; None says it failed
        return None
