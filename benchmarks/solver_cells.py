"""Run time against optimality gap, of every solver on the same problems."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.optimum_reference import Reference
from benchmarks.optimum_search import highest
from benchmarks.row import timed
from benchmarks.scenes import Case, case, proposal
from benchmarks.section import Cell
from benchmarks.solvers import SOLVERS, Task
from tune.optimisation.backends import Rank, program_of
from tune.optimisation.feasibility import initial_points_of, least_margin_loops
from tune.optimisation.nash import largest_product, single_unknown_optimum
from tune.optimisation.problem import Problem
from tune.optimisation.solve import backends

FloatArray = NDArray[np.float64]

#: Searches for the product that gaps refer to.
_STARTS = 30
#: Beyond a limit by less is on it, in log-sizes.
_NOISE = 1e-12
#: Solvers that haptune does not ask.
PEERS = ("scipy SLSQP", "nlopt COBYLA", "nlopt ISRES", "scipy differential evolution")
#: Repeats of a solver.
_REPEATS = 5

_SPRING = {"stiffness": "max", "penetration": 0.01}
CASES = {
    "K": case({"wall": _SPRING}),
    "K and B": case({"wall": {**_SPRING, "damping": "max"}}),
    "K, B and M": case({"block": {**_SPRING, "damping": "max", "mass": "max"}}),
    "K and B with B of another, together": case(
        {"wall": {**_SPRING, "damping": "max"}, "water": {"damping": "max"}},
        together=[["wall", "water"]],
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Posed:
    """A case with its problem, and the best that independent searches know."""

    problem: Problem
    reference: Reference
    best: float  # logarithm of the product of steps
    sizes: FloatArray  # there

    def gap(self, place: FloatArray) -> float:
        """By how much the logarithm of the product stays behind, moved to what is allowed."""
        place = self.reference.onto(np.clip(place, self.reference.low, self.reference.high))
        return self.best - self.reference.product(place)

    def answer(self, case: str, method: str, seconds: float, place: FloatArray | None) -> Cell:
        """The gap, and how far beyond what is allowed the proposal was, in log-sizes."""
        ours = method not in PEERS
        if place is None:
            return Cell(case=case, method=method, ours=ours, seconds=seconds, note="gave up")
        place = np.clip(place, self.reference.low, self.reference.high)
        spare = float(np.min(self.reference.rows(place)[0]))
        note = f"proposed from {-spare:.0e} beyond what is allowed" if spare < -_NOISE else ""
        gap = max(self.gap(place), 0.0)
        return Cell(case=case, method=method, ours=ours, seconds=seconds, error=gap, note=note)


def cells() -> Iterator[Cell]:
    """Every case by every solver, and by what haptune makes of them."""
    for name, chosen in CASES.items():
        posed = posed_of(chosen)
        problem = posed.problem
        if len(problem.unknowns) == 1:
            seconds = timed(lambda p=problem: single_unknown_optimum(p)).middle
            yield posed.answer(
                name, "closed form", seconds, _log(single_unknown_optimum(problem).sizes)
            )
        task = task_of(posed)
        for solver, solve_with in SOLVERS.items():
            answers: list[FloatArray | None] = []
            timing = timed(lambda s=solve_with, t=task, a=answers: a.append(s(t)), _REPEATS)
            yield posed.answer(name, solver, timing.middle, answers[-1])
        if len(problem.unknowns) > 1:
            whole = timed(lambda p=problem: largest_product(p, backends()), _REPEATS)
            sizes = _log(largest_product(problem, backends()).sizes)
            yield posed.answer(name, "largest product", whole.middle, sizes)


def _log(sizes: FloatArray | None) -> FloatArray | None:
    return None if sizes is None else np.log(sizes)


def posed_of(chosen: Case, starts: int = _STARTS) -> Posed:
    """A case, and the best of searches from some starts."""
    (solved,) = proposal(chosen, chosen.task())
    filters = (chosen.filters.velocity_filter_hz, chosen.filters.acceleration_filter_hz)
    reference = Reference(
        chosen.device, chosen.scene, list(chosen.scene.elements), filters, frozenset(solved.dropped)
    )
    best, place = highest(
        reference, known=np.log(solved.sizes), starts=starts, rng=np.random.default_rng(0)
    )
    return Posed(problem=solved.problem, reference=reference, best=best, sizes=np.exp(place))


def task_of(posed: Posed) -> Task:
    """What every solver is given: the corners that bind and a start well inside."""
    problem = posed.problem
    start = initial_points_of(problem, 1)[0]
    shown = {*least_margin_loops(problem, start), *least_margin_loops(problem, posed.sizes)}
    low, high = np.log(problem.low), np.log(problem.high)
    return Task(
        program=program_of(problem, sorted(shown)),
        rank=Rank(weights=np.ones(low.size), lower=low, upper=high),
        start=np.log(start),
    )
