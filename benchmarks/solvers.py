"""Solvers of the joint problem: those that haptune asks, and others that it might."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import Backend, Evaluation, Ipopt, Program, Rank, Slsqp

FloatArray = NDArray[np.float64]

#: Log-sizes that a global search looks at, around the start: a factor of 3000 down, 400 up.
_AROUND = (-8.0, 6.0)
#: Seconds for those that know no slopes; the global ones take all they are given.
_SECONDS = 3.0
#: What a constraint that cannot be evaluated counts as.
_UNREACHABLE = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Raise the product of steps: the same rows, slopes and start for every solver."""

    program: Program  # with the corners that bind
    rank: Rank  # all effects, between their ends
    start: FloatArray  # log-sizes, shape (unknowns,)

    def product(self, y: FloatArray) -> tuple[float, FloatArray]:
        """Of log-sizes: the logarithm of the product of steps, and its gradient."""
        return self.program.product(np.exp(y), self.rank.weights)

    def rows(self) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
        """Of log-sizes: constraints, at most 0 where kept, and their slopes."""
        evaluation = Evaluation(self.program, self.rank)

        def at(y: FloatArray) -> tuple[FloatArray, FloatArray]:
            here = evaluation.at(y)
            values = np.nan_to_num(here.constraints, nan=_UNREACHABLE, posinf=_UNREACHABLE)
            return values, np.nan_to_num(here.jacobian)

        return at

    def box(self) -> tuple[FloatArray, FloatArray]:
        """What a global search looks at."""
        low, high = (self.start + side for side in _AROUND)
        return np.maximum(low, self.rank.lower), np.minimum(high, self.rank.upper)


Solver = Callable[[Task], FloatArray | None]


def _ours(backend: Backend) -> Solver:
    return lambda task: backend.propose(task.program, task.rank, task.start)


def scipy_slsqp(task: Task) -> FloatArray | None:
    """scipy's SLSQP with the same slopes."""
    from scipy.optimize import minimize

    rows = task.rows()

    def kept(y: FloatArray) -> FloatArray:
        return -rows(y)[0]

    def slopes(y: FloatArray) -> FloatArray:
        return -rows(y)[1]

    def falling(y: FloatArray) -> tuple[float, FloatArray]:
        value, slope = task.product(y)
        return -value, -slope

    constraints: dict[str, Any] = {"type": "ineq", "fun": kept, "jac": slopes}
    search: Any = minimize
    answer = search(
        falling,
        task.start,
        jac=True,
        method="SLSQP",
        bounds=[*zip(task.rank.lower, task.rank.upper, strict=True)],
        constraints=constraints,
        options={"ftol": 1e-12, "maxiter": 300},
    )
    return np.asarray(answer.x, dtype=np.float64)


def cobyla(task: Task) -> FloatArray | None:
    """nlopt's COBYLA: linear models, no slopes."""
    nlopt: Any = import_module("nlopt")
    rows = task.rows()

    def constraints(result: FloatArray, y: FloatArray, _: FloatArray) -> None:
        result[:] = rows(y)[0]

    def product(y: FloatArray, _: FloatArray) -> float:
        return task.product(y)[0]

    solver = nlopt.opt(nlopt.LN_COBYLA, task.start.size)
    solver.set_lower_bounds(task.rank.lower)
    solver.set_upper_bounds(task.rank.upper)
    solver.set_max_objective(product)
    solver.add_inequality_mconstraint(constraints, np.full(rows(task.start)[0].size, 1e-9))
    solver.set_maxtime(_SECONDS)
    solver.set_xtol_rel(1e-10)
    return np.asarray(solver.optimize(task.start), dtype=np.float64)


def isres(task: Task) -> FloatArray | None:
    """nlopt's evolution strategy with ranked constraints, its best point that keeps them."""
    nlopt: Any = import_module("nlopt")
    rows, (low, high) = task.rows(), task.box()
    best: list[tuple[float, FloatArray]] = []

    def product(y: FloatArray, _: FloatArray) -> float:
        return task.product(y)[0]

    def worst(y: FloatArray, _: FloatArray) -> float:
        value = float(np.max(rows(y)[0]))
        reached = product(y, _)
        if value <= 0 and (not best or reached > best[0][0]):
            best[:] = [(reached, np.array(y))]
        return value

    solver = nlopt.opt(nlopt.GN_ISRES, task.start.size)
    nlopt.srand(1)
    solver.set_lower_bounds(low)
    solver.set_upper_bounds(high)
    solver.set_max_objective(product)
    solver.add_inequality_constraint(worst, 0.0)
    solver.set_maxtime(_SECONDS)
    solver.optimize(task.start)
    return best[0][1] if best else None


def differential_evolution(task: Task) -> FloatArray | None:
    """scipy's differential evolution with the constraints as they are."""
    from scipy.optimize import NonlinearConstraint
    from scipy.optimize import differential_evolution as evolve

    rows, (low, high) = task.rows(), task.box()

    def falling(y: FloatArray) -> float:
        return -task.product(y)[0]

    def broken(y: FloatArray) -> FloatArray:
        return rows(y)[0]

    end = time.perf_counter() + _SECONDS

    def late(_: object, convergence: float) -> bool:
        del convergence
        return time.perf_counter() > end

    search: Any = evolve
    answer = search(
        falling,
        list(zip(low, high, strict=True)),
        constraints=NonlinearConstraint(broken, -np.inf, 0.0),
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
