"""Solvers of the joint problem: those that haptune asks, and others that it might."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import HEIGHTS, Backend, Stage
from tune.optimisation.backends.casadi_ import Ipopt
from tune.optimisation.backends.evaluation import Evaluation
from tune.optimisation.backends.nlopt_ import Slsqp
from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]

#: Log-sizes that a global search looks at, around the start: a factor of 3000 down, 400 up.
_AROUND = (-8.0, 6.0)
#: Seconds for those that know no slopes; the global ones take all they are given.
_SECONDS = 3.0
#: What a constraint that cannot be evaluated counts as.
_UNREACHABLE = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Raise the least height: the same rows, slopes and start for every solver.

    Attributes:
        program: with the corners that bind.
        start: log-sizes, shape (unknowns,).
        heights: of log-sizes.
    """

    program: Program
    start: FloatArray
    heights: Callable[[FloatArray], FloatArray]

    @property
    def stage(self) -> Stage:
        """All heights raised together."""
        count = self.start.size
        lowest = float(np.min(self.heights(self.start)))
        return Stage(
            active=np.ones(count),
            floors=np.zeros(count),
            weights=np.append(np.zeros(count), 1.0),
            start=min(0.0, lowest),
        )

    def rows(self) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
        """Of (log-sizes, t): constraints, at most 0 where kept, and their slopes."""
        evaluation = Evaluation(self.program, self.stage)

        def at(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            here = evaluation.at(z)
            values = np.nan_to_num(here.constraints, nan=_UNREACHABLE, posinf=_UNREACHABLE)
            return values, np.nan_to_num(here.jacobian)

        return at

    def broken(self) -> Callable[[FloatArray], FloatArray]:
        """Constraints of log-sizes alone, t being their least height."""
        rows = self.rows()
        return lambda y: rows(np.append(y, np.min(self.heights(y))))[0]

    def box(self) -> tuple[FloatArray, FloatArray]:
        """What a global search looks at."""
        low, high = (self.start + side for side in _AROUND)
        return np.maximum(low, self.program.lower), np.minimum(high, self.program.upper)


Solver = Callable[[Task], FloatArray | None]


def _ours(backend: Backend) -> Solver:
    return lambda task: backend.propose(task.program, task.stage, task.start)


def scipy_slsqp(task: Task) -> FloatArray | None:
    """scipy's SLSQP with the same slopes."""
    from scipy.optimize import minimize

    rows, count = task.rows(), task.start.size

    def kept(z: FloatArray) -> FloatArray:
        return -rows(z)[0]

    def slopes(z: FloatArray) -> FloatArray:
        return -rows(z)[1]

    constraints: dict[str, Any] = {"type": "ineq", "fun": kept, "jac": slopes}
    search: Any = minimize
    upwards = np.append(np.zeros(count), -1.0)

    def depth(z: FloatArray) -> tuple[float, FloatArray]:
        return -float(z[-1]), upwards

    answer = search(
        depth,
        np.append(task.start, task.stage.start),
        jac=True,
        method="SLSQP",
        bounds=[*zip(task.program.lower, task.program.upper, strict=True), HEIGHTS],
        constraints=constraints,
        options={"ftol": 1e-12, "maxiter": 300},
    )
    return np.asarray(answer.x, dtype=np.float64)[:count]


def cobyla(task: Task) -> FloatArray | None:
    """nlopt's COBYLA: linear models, no slopes."""
    nlopt: Any = import_module("nlopt")
    rows, count = task.rows(), task.start.size

    def constraints(result: FloatArray, z: FloatArray, _: FloatArray) -> None:
        result[:] = rows(z)[0]

    def height(z: FloatArray, _: FloatArray) -> float:
        return float(z[-1])

    z = np.append(task.start, task.stage.start)
    solver = nlopt.opt(nlopt.LN_COBYLA, count + 1)
    solver.set_lower_bounds(np.append(task.program.lower, HEIGHTS[0]))
    solver.set_upper_bounds(np.append(task.program.upper, HEIGHTS[1]))
    solver.set_max_objective(height)
    solver.add_inequality_mconstraint(constraints, np.full(rows(z)[0].size, 1e-9))
    solver.set_maxtime(_SECONDS)
    solver.set_xtol_rel(1e-10)
    return np.asarray(solver.optimize(z), dtype=np.float64)[:count]


def isres(task: Task) -> FloatArray | None:
    """nlopt's evolution strategy with ranked constraints, its best point that keeps them."""
    nlopt: Any = import_module("nlopt")
    broken, (low, high) = task.broken(), task.box()
    best: list[tuple[float, FloatArray]] = []

    def lowest(y: FloatArray, _: FloatArray) -> float:
        return float(np.min(task.heights(y)))

    def worst(y: FloatArray, _: FloatArray) -> float:
        value = float(np.max(broken(y)))
        height = lowest(y, _)
        if value <= 0 and (not best or height > best[0][0]):
            best[:] = [(height, np.array(y))]
        return value

    solver = nlopt.opt(nlopt.GN_ISRES, task.start.size)
    nlopt.srand(1)
    solver.set_lower_bounds(low)
    solver.set_upper_bounds(high)
    solver.set_max_objective(lowest)
    solver.add_inequality_constraint(worst, 0.0)
    solver.set_maxtime(_SECONDS)
    solver.optimize(task.start)
    return best[0][1] if best else None


def differential_evolution(task: Task) -> FloatArray | None:
    """scipy's differential evolution with the constraints as they are."""
    from scipy.optimize import NonlinearConstraint
    from scipy.optimize import differential_evolution as evolve

    low, high = task.box()

    def depth(y: FloatArray) -> float:
        return -float(np.min(task.heights(y)))

    end = time.perf_counter() + _SECONDS

    def late(_: object, convergence: float) -> bool:
        del convergence
        return time.perf_counter() > end

    search: Any = evolve
    answer = search(
        depth,
        list(zip(low, high, strict=True)),
        constraints=NonlinearConstraint(task.broken(), -np.inf, 0.0),
        callback=late,
        tol=1e-10,
        rng=1,
        polish=False,
    )
    return np.asarray(answer.x, dtype=np.float64)


#: By name; the first two are those that `tune` asks.
SOLVERS: dict[str, Solver] = {
    "IPOPT": _ours(Ipopt()),
    "nlopt SLSQP": _ours(Slsqp()),
    "scipy SLSQP": scipy_slsqp,
    "nlopt COBYLA": cobyla,
    "nlopt ISRES": isres,
    "scipy differential evolution": differential_evolution,
}
