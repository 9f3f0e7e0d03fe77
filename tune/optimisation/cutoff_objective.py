"""Objective of cut-offs: the effects kept, then the product of their steps, and its slope.

By rank as many effects as can be kept count first; then the sum of the logarithms of steps, those
of a wanted value over all that it asks for, each rank a tenth of the one before. The slope of that
sum by a cut-off follows from the multipliers of what binds (envelope theorem): sizes need not be
found anew. One file: the objective and its slope have to agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.errors import NoFeasibleEffectError
from tune.loop.filters import Filters
from tune.optimisation.backends import Rank
from tune.optimisation.bounds import largest_allowed
from tune.optimisation.limits import (
    least_margin_loops,
    passes_cheap_limits,
    stable_in_doubles,
)
from tune.optimisation.nash import SAME, Optimum
from tune.optimisation.problem import DesignTask, Problem, may_saturate, pose
from tune.optimisation.scene_unknowns import level_of
from tune.optimisation.solve import optimum_of

FloatArray = NDArray[np.float64]

#: What a rank counts beside the one before it.
_NEXT_RANK = 0.1
#: Parts to which sizes that were good with other cut-offs are taken back until they are allowed.
_RETREATS = (1.0, 0.98, 0.9, 0.75, 0.5, 0.25)


@dataclass(frozen=True, slots=True, kw_only=True)
class CutoffObjective:
    """What elements are worth with certain filters.

    Attributes:
        kept: how many effects of each rank, the first rank first; compared before anything else.
        value: sum of the logarithms of steps, weighed by rank.
    """

    kept: tuple[int, ...]
    value: float

    def plus(self, other: CutoffObjective) -> CutoffObjective:
        """The objective of both groups together."""
        kept = tuple(a + b for a, b in zip(self.kept, other.kept, strict=True))
        return CutoffObjective(kept=kept, value=self.value + other.value)

    @property
    def order(self) -> tuple[tuple[int, ...], float]:
        """What decides which is worth more."""
        return self.kept, self.value


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuned:
    """A group tuned with certain filters.

    Attributes:
        worth: of it.
        problem: of what is kept.
        optimum: None where nothing is kept.
    """

    worth: CutoffObjective
    problem: Problem
    optimum: Optimum | None


def tune_all_effects(
    task: DesignTask, elements: Sequence[str], filters: Filters, before: Tuned | None = None
) -> Tuned | None:
    """A group tuned by one solver; None where not all of its effects can be kept."""
    wished = sum(len(task.scene.elements[name].wishes()) for name in elements)
    found = tune_with_filters(task, elements, filters, before, choosing=False)
    return found if sum(found.worth.kept) == wished else None


def tune_with_filters(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    before: Tuned | None = None,
    *,
    choosing: bool = True,
) -> Tuned:
    """A group tuned by one solver, from where it was with other filters.

    Nothing is worth less than a range that cannot be met. Of effects that cannot be kept together
    the best set is chosen, at a cost; without ``choosing`` all of them count as left out.
    """

    def known(problem: Problem) -> list[FloatArray]:
        if before is None or before.optimum is None or before.optimum.sizes is None:
            return []
        return _taken_over(problem, before.problem, before.optimum.sizes)

    try:
        problem, optimum, _ = optimum_of(
            task,
            elements,
            filters,
            cut=may_saturate(task, elements),
            second_opinion=False,
            known=known,
            choosing=choosing,
        )
    except NoFeasibleEffectError:
        problem = _posed(task, elements, filters)
        kept = tuple(-len(problem.unknowns) for _ in ranks_of(task))
        return Tuned(worth=CutoffObjective(kept=kept, value=0.0), problem=problem, optimum=None)
    sizes = np.empty(0) if optimum is None or optimum.sizes is None else optimum.sizes
    levels = [unknown.level for unknown in problem.unknowns] if sizes.size else []
    kept = tuple(levels.count(rank) for rank in ranks_of(task))
    worth = CutoffObjective(kept=kept, value=_value(task, problem, sizes))
    return Tuned(worth=worth, problem=problem, optimum=optimum)


def ranks_of(task: DesignTask) -> tuple[int, ...]:
    """Ranks of a scene; see `Unknown`."""
    return tuple(
        sorted(
            {
                level_of(element, effect)
                for element in task.scene.elements.values()
                for effect in element.wishes()
            }
        )
    )


def slope_of(task: DesignTask, found: Tuned, moved: Filters) -> float:
    """How much more a group is worth with filters that are moved a little, to first order."""
    problem, optimum = found.problem, found.optimum
    if optimum is None or optimum.sizes is None:
        return 0.0
    elements = list(dict.fromkeys(unknown.element for unknown in problem.unknowns))
    labels = {unknown.label for unknown in problem.unknowns}
    gone = frozenset(
        f"{name}.{effect}"
        for name in elements
        for effect in task.scene.elements[name].wishes()
        if f"{name}.{effect}" not in labels
    )
    beside = pose(task, elements=elements, filters=moved, gone=gone, cut=problem.cut)
    sizes = optimum.sizes
    # Of one effect beside wanted values that are met, the largest is known without a program.
    open_ends = np.flatnonzero(sizes < problem.high * (1 - SAME))
    if open_ends.size <= 1:
        return max(_value_alone(task, beside, sizes, open_ends) - found.worth.value, -1.0)
    from tune.optimisation.backends.evaluation import Evaluation
    from tune.optimisation.backends.multipliers import multipliers
    from tune.optimisation.backends.program import program_of

    weights = np.array(_weights(task, problem))
    rank = Rank(weights=weights, lower=np.log(problem.low), upper=np.log(problem.high))
    scenarios = list(optimum.scenarios)
    prices = multipliers(program_of(problem, scenarios), rank, np.log(sizes))
    if prices is None:
        scenarios = sorted(least_margin_loops(problem, sizes))
        prices = multipliers(program_of(problem, scenarios), rank, np.log(sizes))
    change = _value(task, beside, sizes) - found.worth.value
    if prices is None:
        # Where one rank came before the next no sum of both is at its largest.
        again = tune_with_filters(task, elements, moved, found).worth
        return again.value - found.worth.value if again.kept == found.worth.kept else change
    rows = [
        Evaluation(program_of(each, scenarios), rank).at(np.log(sizes)).constraints
        for each in (problem, beside)
    ]
    if rows[0].size != rows[1].size:
        return change
    binding = prices > 0
    return change - float(prices[binding] @ (rows[1] - rows[0])[binding])


def _value_alone(
    task: DesignTask, problem: Problem, sizes: FloatArray, raised: NDArray[np.intp]
) -> float:
    """The objective where all sizes stay but at most one, which is as large as it may be."""
    sizes = np.minimum(sizes, problem.high)
    for index in raised.tolist():
        sizes[index] = largest_allowed(problem, sizes, index)
    return _value(task, problem, sizes) if np.all(sizes > 0) else -np.inf


def _posed(task: DesignTask, elements: Sequence[str], filters: Filters) -> Problem:
    return pose(task, elements=elements, filters=filters, cut=may_saturate(task, elements))


def _weights(task: DesignTask, problem: Problem) -> list[float]:
    ranks = ranks_of(task)
    return [u.weight * _NEXT_RANK ** ranks.index(u.level) for u in problem.unknowns]


def _value(task: DesignTask, problem: Problem, sizes: FloatArray) -> float:
    """The weighed sum of the logarithms of steps."""
    each = zip(_weights(task, problem), problem.unknowns, sizes.tolist(), strict=bool(sizes.size))
    return float(sum(weight * np.log(u.steps(size) / u.goal) for weight, u, size in each))


def _taken_over(problem: Problem, before: Problem, sizes: FloatArray) -> list[FloatArray]:
    """Sizes that were good with other filters, as far as they are allowed with these.

    Allowed as far as doubles tell: what is written in the end is not found from here.
    """
    if sizes.size < 2 or [u.label for u in problem.unknowns] != [u.label for u in before.unknowns]:
        return []
    points = np.maximum(np.minimum(np.outer(_RETREATS, sizes), problem.high), problem.low)
    points = points[passes_cheap_limits(problem, points)]
    return [*points[stable_in_doubles(problem, points)][:1]]
