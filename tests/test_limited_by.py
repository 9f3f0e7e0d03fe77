"""The limit that is named for an effect: relaxing all others does not let it grow, this one does.

The largest product often lies where several limits meet, so that one alone gives no room.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.optimum_pairs import random_pair
from tests.thinned import thinned
from tune.documents.errors import NoFeasibleEffectError
from tune.documents.perception import default_table
from tune.documents.profile import LimitedBy
from tune.optimisation.describe import bindings
from tune.optimisation.feasibility import largest_allowed, stable_points
from tune.optimisation.problem import DesignTask, Problem
from tune.optimisation.solve import solve

#: By how much a limit is relaxed, and the least by which an effect must then grow: another limit
#: may be just behind.
RELAXED, GROWS = 1.01, 1e-7
#: Limits that can be relaxed, and what leads to the same boundary: a gain margin kept late as well.
WORDS: set[LimitedBy] = {"force", "rendering", "ripple", "gain-margin", "delay-margin"}
MARGINS: dict[LimitedBy, LimitedBy] = {
    "gain-margin": "delay-margin",
    "delay-margin": "gain-margin",
}
#: A limit that leaves less, relative, is taken to bind.
CLOSE = 1e-4
#: Written sizes have six digits.
ROUNDED = 1.1e-5


def _relaxed(problem: Problem, word: LimitedBy) -> Problem:
    limits, margin = problem.limits, problem.margin
    if word in {"force", "rendering"}:
        mine = np.array([each == word for each in problem.linear.words])[:, None]
        rows = np.where(mine, problem.linear.rows / RELAXED, problem.linear.rows)
        felt = () if word == "rendering" else problem.linear.felt
        return replace(problem, linear=replace(problem.linear, rows=rows, felt=felt))
    if word == "ripple":
        return replace(problem, limits=replace(limits, ripple=limits.ripple * RELAXED))
    if word == "gain-margin":
        return replace(problem, margin=margin.model_copy(update={"gain": margin.gain / RELAXED}))
    assert word == "delay-margin"
    return replace(problem, loops=replace(problem.loops, late=problem.loops.present))


def _judge(seed: int) -> Counter[str]:
    """The words of a pair, each of them proved."""
    pair = random_pair(seed)
    try:
        task = DesignTask.of(pair.device, pair.scene, default_table())
        solved = solve(task, pair.elements, pair.filters)
    except NoFeasibleEffectError:
        return Counter()
    problem, sizes = solved.problem, solved.sizes
    words = bindings(problem, sizes, range(sizes.size))
    for index, (unknown, word) in enumerate(zip(problem.unknowns, words, strict=True)):
        size = float(sizes[index])
        now = largest_allowed(problem, sizes, index)
        assert size <= now * (1 + 1e-9)
        if word in {"wanted", "range"} or size >= unknown.high * (1 - ROUNDED):
            assert now <= unknown.high
            continue
        if word == "stability":
            beyond = sizes.copy()
            beyond[index] = now * RELAXED
            assert not stable_points(problem, beyond[None], 1.0, late=False)[0]
            continue
        others = problem
        for other in WORDS - {word, MARGINS.get(word, word)}:
            others = _relaxed(others, other)
        assert largest_allowed(others, sizes, index) <= now * (1 + CLOSE), (unknown.label, word)
        grown = largest_allowed(_relaxed(others, word), sizes, index)
        assert grown > now * (1 + GROWS), (unknown.label, word)
    return Counter(words)


@pytest.mark.parametrize("seeds", thinned([range(16), range(16, 32), range(32, 48)], 1))
def test_relaxing_the_limit_named_lets_an_effect_grow(seeds: range) -> None:
    seen = sum((_judge(seed) for seed in seeds), Counter[str]())
    assert {"force", "ripple", "rendering", "delay-margin"} <= set(seen)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(300))
def test_relaxing_the_limit_named_lets_an_effect_grow_in_300_pairs(seed: int) -> None:
    _judge(seed)
