"""Maximum feasible subsets: as many effects at one perceived step or more as can be, by rank.

Of the first rank as many as can be kept together, then of the next beside them, and so on. Nothing
is weighed against the product of steps: an effect is left out only where one step of it is out of
reach.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import Rank
from tune.optimisation.backends.program import program_of
from tune.optimisation.bounds import largest_allowed
from tune.optimisation.initial_points import initial_points_of
from tune.optimisation.limits import is_feasible, least_margin_loops
from tune.optimisation.problem import Problem
from tune.optimisation.unknown import Unknown

FloatArray = NDArray[np.float64]

#: Sets of one rank that are tried before the faintest are left out one after the other.
_MOST_SETS = 32
#: Where a search for any allowed setting begins: sizes over the least, as a part of the way up.
_BEGINNINGS = (0.0, 0.3, 0.6)
#: ... or one of them by this part, the others at their least.
_ALONE = 0.8
#: Searches of one beginning, each shown the corners that the one before broke.
_MOST_ROUNDS = 4


def feasible_subsets(
    unknowns: Sequence[Unknown], feasible: Callable[[frozenset[str]], bool]
) -> list[frozenset[str]]:
    """The sets of effects, by label, that hold as many of each rank as can be.

    Args:
        unknowns: the faintest last.
        feasible: whether a set can be kept, each of it at one step or where its range begins.

    Returns:
        Sets of one size by rank, several where that leaves a choice; ranges are in all of them.
        Empty where a range cannot be.
    """
    sets = [frozenset[str]()]
    for level in sorted({unknown.level for unknown in unknowns}):
        mine = [unknown for unknown in unknowns if unknown.level == level]
        found: list[frozenset[str]] = []
        tried = 0
        for chosen in _largest_first(mine):
            if found and len(found[0]) - len(sets[0]) > len(chosen):
                break
            promised = {unknown.label for unknown in mine if unknown.wish.kind == "range"}
            if not promised <= chosen:
                continue
            for before in sets:
                tried += 1
                if before | chosen == before or feasible(before | chosen):
                    found.append(before | chosen)
            if found and tried > _MOST_SETS:
                break
        if not found:
            return []
        sets = found
    return sets


def _largest_first(unknowns: Sequence[Unknown]) -> Iterator[frozenset[str]]:
    """All sets of labels, the largest first, without the last of the unknowns first."""
    labels = [unknown.label for unknown in unknowns]
    for size in range(len(labels), -1, -1):
        for index, chosen in enumerate(combinations(labels, size)):
            if index >= _MOST_SETS:
                break
            yield frozenset(chosen)


def feasible_sizes(problem: Problem) -> FloatArray | None:
    """Some setting that every limit allows, each effect at its least or above.

    None if none is found: on rays first, then where the most broken limit is the least broken.

    The answer has shape (unknowns,), SI units.
    """
    if len(problem.unknowns) == 1:
        sizes = np.array([largest_allowed(problem, np.zeros(1), 0)])
        return (
            sizes if sizes[0] >= problem.unknowns[0].low and is_feasible(problem, sizes) else None
        )
    found = initial_points_of(problem, 1)
    return found[0] if found else _least_broken(problem)


def _least_broken(problem: Problem) -> FloatArray | None:
    from tune.optimisation.backends.nlopt_ import least_violation

    low, high = np.log(problem.low), np.log(problem.high)
    rank = Rank(weights=np.zeros(low.size), lower=low, upper=high)
    least = problem.nothing
    most = [largest_allowed(problem, least, i) for i in range(low.size)]
    up = np.log(np.maximum(most, problem.low)) - low
    beginnings = [part * up for part in _BEGINNINGS] + list(_ALONE * np.diag(up))
    scenarios = sorted(least_margin_loops(problem, problem.low))
    for begins in beginnings:
        start = low + begins
        for _ in range(_MOST_ROUNDS):
            answer = least_violation(program_of(problem, scenarios), rank, start)
            if answer is None:
                break
            sizes = np.exp(np.clip(answer, low, high))
            if is_feasible(problem, sizes):
                return sizes
            broken = set(least_margin_loops(problem, sizes, broken=True)) - set(scenarios)
            if not broken:
                break
            scenarios += sorted(broken)
            start = answer
    return None
