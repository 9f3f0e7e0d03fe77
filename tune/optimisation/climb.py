"""Lexicographic max-min: raise the smallest number of perceived steps, then the next, by rank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import HEIGHTS, Backend, Stage
from tune.optimisation.backends.multipliers import prices
from tune.optimisation.backends.program import program_of
from tune.optimisation.bounds import largest_allowed
from tune.optimisation.limits import allowed, allowed_points, weakest
from tune.optimisation.problem import Problem
from tune.optimisation.starts import interior

FloatArray = NDArray[np.float64]

#: Two heights closer than this, relative, are one; also the disagreement of two solvers that is
#: worth recording.
SAME = 1e-6
#: A floor is kept this much lower than reached, relative or in steps, so that it stays attainable.
_EASE = 1e-7
#: Settings on the way from one to another that are checked at once.
_SECTIONS = 16
#: Solves of one stage, each shown the corners that the one before broke; two or three are usual.
_MOST_ROUNDS = 8
#: Times the solvers are asked in one stage, each time from the best answer before.
_MOST_ATTEMPTS = 5
#: An effect binds where one step more of it costs the common height more than this part of a step.
_COSTS = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Climb:
    """Where a climb ended.

    Attributes:
        sizes: of the unknowns, shape (unknowns,), allowed exactly; None where nothing is.
        methods: names of what proposed each accepted stage.
        disagreements: largest relative difference in height between solvers, 0 if none.
    """

    sizes: FloatArray | None
    methods: tuple[str, ...]
    disagreements: float


def closed_form(problem: Problem) -> Climb:
    """The answer for one unknown: the least of its bounds, no solver."""
    sizes = np.array([largest_allowed(problem, np.zeros(1), 0)])
    fits = sizes[0] >= problem.unknowns[0].low and allowed(problem, sizes)
    return Climb(sizes=sizes if fits else None, methods=("closed form",), disagreements=0.0)


def climb(problem: Problem, backends: Sequence[Backend]) -> Climb:
    """The lexicographic optimum of several unknowns.

    Args:
        problem: at least two unknowns.
        backends: solvers; all propose for the first stage of each rank and the best allowed
            proposal is taken. The stages after it start from there and are left to the last.
    """
    state = _State(problem=problem, inner=interior(problem), backends=backends)
    count = len(problem.unknowns)
    floors: FloatArray = np.full(count, HEIGHTS[0])
    for level in sorted({unknown.level for unknown in problem.unknowns}):
        active: list[int] = [
            index for index, unknown in enumerate(problem.unknowns) if unknown.level == level
        ]
        if state.at_their_most(active):
            floors[active] = [_eased(state.heights()[index]) for index in active]
            continue
        consulted = backends
        while active:
            together = np.array([float(index in active) for index in range(count)])
            alone = len(active) == 1
            stage = Stage(
                active=together * (not alone),
                floors=floors * (1 - together) if not alone else floors,
                weights=np.append(together * alone, float(not alone)),
            )
            state.sizes = state.best_of(stage, consulted)
            if state.sizes is None:
                return state.result()
            heights = state.heights()
            reached = min(heights[i] for i in active)
            floors[active] = _eased(reached)
            if alone:
                break
            stuck, asides = _stuck(state, stage, floors, active, reached)
            if not stuck:
                # Each can rise alone, so all can a little; if no way leads there, the lowest stays.
                if asides and state.moved_between(asides, stage):
                    continue
                stuck = [min(active, key=heights.__getitem__)]
            active = [i for i in active if i not in stuck]
            consulted = backends[-1:]
    return state.result()


def _stuck(
    state: _State, stage: Stage, floors: FloatArray, active: list[int], reached: float
) -> tuple[list[int], list[FloatArray]]:
    """Those of the active unknowns that cannot rise without another falling below the floors.

    Those whose height has a price in the common one. Where the prices do not add up, the setting
    is not where a solver should have ended, and each unknown is tried.

    Returns:
        The unknowns, and for each active one that was tried the setting in which it has risen.
    """
    assert state.sizes is not None
    cost = state.prices(stage, state.sizes)
    if cost is not None:
        return [i for i in active if cost[i] > _COSTS], []
    asides = [_raised(state, floors, i) for i in active]
    least = reached + 10 * SAME * _size(reached)
    pairs = zip(active, asides, strict=True)
    return [i for i, higher in pairs if not state.heights(higher)[i] > least], asides


def _raised(state: _State, floors: FloatArray, index: int) -> FloatArray:
    """The setting at hand with one effect as large as the floors of the others allow."""
    assert state.sizes is not None
    weights = np.zeros(floors.size + 1)
    weights[index] = 1.0
    stage = Stage(active=np.zeros(floors.size), floors=floors, weights=weights)
    higher = state.best_of(stage, state.backends[-1:])
    return state.sizes if higher is None else higher


def _lowest(stage: Stage, heights: Sequence[float]) -> float:
    """The common height of those that are to have one; 0 where none is."""
    active = np.array(heights)[stage.active > 0]
    return float(np.min(active)) if active.size else 0.0


def _size(height: float) -> float:
    """What a relative difference of heights refers to: itself, or one step if it is small."""
    return max(1.0, abs(height))


def _eased(height: float) -> float:
    """A floor that stays attainable."""
    return height - _EASE * _size(height)


class _State:
    """The best allowed setting so far, and the corners that solvers have been shown."""

    def __init__(
        self, *, problem: Problem, inner: FloatArray | None, backends: Sequence[Backend]
    ) -> None:
        self.problem = problem
        self.backends = backends
        self.sizes = inner
        low = np.array([unknown.low for unknown in problem.unknowns])
        self.scenarios = list(weakest(problem, low if inner is None else inner))
        self.program = program_of(problem, self.scenarios)
        self.methods: list[str] = []
        self.disagreement = 0.0

    def heights(self, sizes: FloatArray | None = None) -> list[float]:
        chosen = self.sizes if sizes is None else sizes
        assert chosen is not None
        return [u.height(float(s)) for u, s in zip(self.problem.unknowns, chosen, strict=True)]

    def at_their_most(self, indices: Sequence[int]) -> bool:
        """Whether these unknowns cannot be wanted any larger, so that no solver is needed."""
        unknowns = self.problem.unknowns
        return self.sizes is not None and all(
            self.sizes[i] >= unknowns[i].high * (1 - SAME) for i in indices
        )

    def value(self, sizes: FloatArray, stage: Stage) -> float:
        """What the stage maximises; minus infinity where a floor is broken."""
        heights = np.array(self.heights(sizes))
        active = stage.active > 0
        kept = np.array([_eased(float(floor)) for floor in stage.floors])
        if np.any((heights < kept) & ~active):
            return -np.inf
        lowest = float(np.min(heights[active])) if active.any() else 0.0
        return float(stage.weights[:-1] @ heights + stage.weights[-1] * lowest)

    def prices(self, stage: Stage, sizes: FloatArray) -> FloatArray | None:
        """What each active height costs at a setting; None where it is no optimum, see `prices`."""
        lowest = _lowest(stage, self.heights(sizes))
        return prices(self.program, stage, np.append(np.log(sizes), lowest))

    def moved_between(self, settings: Sequence[FloatArray], stage: Stage) -> bool:
        """Go to the middle of settings, as far as is allowed, if the stage gains by it."""
        assert self.sizes is not None
        middle = np.exp(np.mean(np.log(settings), axis=0))
        moved = self._pulled_back(self.sizes, middle)
        before = self.value(self.sizes, stage)
        if moved is None or not self.value(moved, stage) > before + SAME * _size(before):
            return False
        self.sizes = moved
        return True

    def best_of(self, stage: Stage, backends: Sequence[Backend]) -> FloatArray | None:
        """The best allowed proposal of solvers, or the setting at hand if none is better.

        Where that is no optimum to first order, all solvers are asked again from there.
        """
        best = self.sizes
        value = -np.inf if best is None else self.value(best, stage)
        for attempt in range(_MOST_ATTEMPTS):
            chosen, reached, name, values = self._asked(
                replace(stage, routh=attempt % 2 == 1),
                best,
                backends if attempt == 0 else self.backends,
            )
            if attempt == 0 and len(values) > 1:
                apart = (max(values) - min(values)) / _size(max(values))
                self.disagreement = max(self.disagreement, apart)
            risen = reached - value
            if risen > 0:
                best, value = chosen, reached
                self.methods.append(name)
            if best is None or (attempt > 0 and not risen > _EASE * _size(value)):
                break
            if self.prices(stage, best) is not None:
                break
        return best

    def _asked(
        self, stage: Stage, start: FloatArray | None, backends: Sequence[Backend]
    ) -> tuple[FloatArray | None, float, str, list[float]]:
        """The best proposal from a start, its value, whose it is, and the values of all."""
        first = start
        if first is None:
            first = np.array([max(u.low, u.size_at(0.5)) for u in self.problem.unknowns])
        stage = replace(stage, start=_lowest(stage, self.heights(first)))
        best, best_value, best_name = None, -np.inf, ""
        values: list[float] = []
        for backend in backends:
            sizes = self._proposed(backend, stage, np.log(first))
            if sizes is None:
                continue
            value = self.value(sizes, stage)
            if np.isfinite(value):
                values.append(value)
            if value > best_value:
                best, best_value, best_name = sizes, value, backend.name
        return best, best_value, best_name, values

    def _proposed(self, backend: Backend, stage: Stage, start: FloatArray) -> FloatArray | None:
        """What one solver proposes, shown each corner that its last proposal broke; allowed."""
        proposal: FloatArray | None = None
        for _ in range(_MOST_ROUNDS):
            answer = backend.propose(self.program, stage, start)
            if answer is None:
                break
            proposal = np.exp(answer)
            if allowed(self.problem, proposal):
                return proposal
            broken = set(weakest(self.problem, proposal, broken=True)) - set(self.scenarios)
            if not broken:
                break
            self.scenarios += sorted(broken)
            self.program = program_of(self.problem, self.scenarios)
        return None if proposal is None else self._pulled_back(np.exp(start), proposal)

    def _pulled_back(self, inner: FloatArray, proposal: FloatArray) -> FloatArray | None:
        """The last allowed point on the way from a setting that is allowed to a proposal."""
        # Towards the proposal in smaller and smaller steps: most are only a little beyond.
        parts = 1 - np.asarray(np.geomspace(1.0, SAME / 100, _SECTIONS), dtype=np.float64)
        while True:
            points = inner ** (1 - parts[:, None]) * proposal ** parts[:, None]
            good = allowed_points(self.problem, points)
            first = int(np.argmin(np.append(good, False)))
            last = max(first - 1, 0)
            if first in (0, _SECTIONS) or parts[first] - parts[last] < SAME / 100:
                return points[last] if first else None
            parts = np.linspace(float(parts[last]), float(parts[first]), _SECTIONS)

    def result(self) -> Climb:
        return Climb(
            sizes=self.sizes,
            methods=tuple(dict.fromkeys(self.methods)),
            disagreements=self.disagreement,
        )
