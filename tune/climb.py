"""Lexicographic max-min: raise the smallest number of perceived steps, then the next, by rank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tune.backends import HEIGHTS, Backend, Stage
from tune.backends.program import program_of
from tune.limits import allowed, largest_allowed, weakest
from tune.problem import Problem

FloatArray = NDArray[np.float64]

#: Two heights closer than this, relative, are one; also the disagreement of two solvers that is
#: worth recording.
SAME = 1e-6
#: A floor is kept this much lower than reached, relative or in steps, so that it stays attainable.
_EASE = 1e-7
#: Halvings when a proposal is pulled back to what is allowed.
_HALVINGS = 40
#: Solves of one stage, each shown the corners that the one before broke; two or three are usual.
_MOST_ROUNDS = 8


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
    nothing = np.zeros(1)
    unknown = problem.unknowns[0]
    sizes = np.array([largest_allowed(problem, nothing, 0)])
    for _ in range(8):
        if sizes[0] < unknown.low:
            break
        if allowed(problem, sizes):
            return Climb(sizes=sizes, methods=("closed form",), disagreements=0.0)
        sizes = sizes * (1 - SAME / 100)
    return Climb(sizes=None, methods=("closed form",), disagreements=0.0)


def climb(problem: Problem, backends: Sequence[Backend]) -> Climb:
    """The lexicographic optimum of several unknowns.

    Args:
        problem: at least two unknowns.
        backends: solvers; each proposes for every stage and the best allowed proposal is taken.
    """
    state = _State(problem=problem, inner=interior(problem), backends=backends)
    count = len(problem.unknowns)
    floors: FloatArray = np.full(count, HEIGHTS[0])
    for level in sorted({unknown.level for unknown in problem.unknowns}):
        active: list[int] = [
            index for index, unknown in enumerate(problem.unknowns) if unknown.level == level
        ]
        while active:
            together = np.array([float(index in active) for index in range(count)])
            alone = len(active) == 1
            state.improve(
                Stage(
                    active=together * (not alone),
                    floors=floors * (1 - together) if not alone else floors,
                    weights=np.append(together * alone, float(not alone)),
                ),
            )
            if state.sizes is None:
                return state.result()
            heights = state.heights()
            reached = min(heights[i] for i in active)
            floors[active] = _eased(reached)
            if alone:
                break
            stuck = [i for i in active if not _rises(state, floors, i, reached)]
            lowest = min(active, key=heights.__getitem__)
            active = [i for i in active if i not in (stuck or [lowest])]
    return state.result()


def interior(problem: Problem) -> FloatArray | None:
    """A setting well inside what is allowed, as large as one path from nothing reaches; or None."""
    low = np.array([unknown.low for unknown in problem.unknowns])
    if not allowed(problem, low):
        return None
    top = np.array(
        [max(largest_allowed(problem, low, index), low[index]) for index in range(low.size)]
    )
    reach, step = 0.0, 0.5
    for _ in range(8):
        if allowed(problem, low ** (1 - reach - step) * top ** (reach + step)):
            reach += step
        step /= 2
    return low ** (1 - 0.95 * reach) * top ** (0.95 * reach)


def _rises(state: _State, floors: FloatArray, index: int, reached: float) -> bool:
    weights = np.zeros(floors.size + 1)
    weights[index] = 1.0
    stage = Stage(active=np.zeros(floors.size), floors=floors, weights=weights)
    higher = state.best_of(stage)
    return higher is not None and state.heights(higher)[index] > reached + 10 * SAME * _size(
        reached
    )


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
        self.inner = inner
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

    def value(self, sizes: FloatArray, stage: Stage) -> float:
        """What the stage maximises; minus infinity where a floor is broken."""
        heights = np.array(self.heights(sizes))
        active = stage.active > 0
        kept = np.array([_eased(float(floor)) for floor in stage.floors])
        if np.any((heights < kept) & ~active):
            return -np.inf
        lowest = float(np.min(heights[active])) if active.any() else 0.0
        return float(stage.weights[:-1] @ heights + stage.weights[-1] * lowest)

    def best_of(self, stage: Stage) -> FloatArray | None:
        """The best allowed proposal of all solvers, or the setting at hand if none is better."""
        first = self.sizes
        if first is None:
            first = np.array([max(u.low, u.size_at(0.5)) for u in self.problem.unknowns])
        best, best_value, best_name = self.sizes, -np.inf, ""
        if self.sizes is not None:
            best_value = self.value(self.sizes, stage)
        values: list[float] = []
        stage = replace(stage, start=min(0.0, *self.heights(first)))
        for backend in self.backends:
            sizes = self._proposed(backend, stage, np.log(first))
            if sizes is None:
                continue
            value = self.value(sizes, stage)
            if np.isfinite(value):
                values.append(value)
            if value > best_value:
                best, best_value, best_name = sizes, value, backend.name
        if len(values) > 1:
            apart = (max(values) - min(values)) / _size(max(values))
            self.disagreement = max(self.disagreement, apart)
        if best_name:
            self.methods.append(best_name)
        return best

    def improve(self, stage: Stage) -> None:
        self.sizes = self.best_of(stage)

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
        return None if proposal is None else self._pulled_back(proposal)

    def _pulled_back(self, proposal: FloatArray) -> FloatArray | None:
        """The last allowed point on the way from a setting well inside to a proposal."""
        if self.inner is None:
            return None
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if allowed(self.problem, self.inner ** (1 - middle) * proposal**middle):
                low = middle
            else:
                high = middle
            if high - low < SAME / 100:
                break
        return self.inner ** (1 - low) * proposal**low

    def result(self) -> Climb:
        return Climb(
            sizes=self.sizes,
            methods=tuple(dict.fromkeys(self.methods)),
            disagreements=self.disagreement,
        )
