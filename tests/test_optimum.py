"""How far tuning stays behind the largest product of steps, by searches of our own."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.optimum_answers import (
    UNDECIDED,
    case_of,
    nothing_dropped,
    reference_of,
    solved_of,
)
from tests.optimum_pairs import Pair, random_pair
from tests.optimum_reference import Reference
from tests.optimum_search import any_place, gaps, local
from tests.reference import crossings, loop_along
from tests.thinned import thinned
from tests.unlimited import stated
from tune.certificate.check import check
from tune.documents import NoFeasibleEffectError
from tune.optimisation import optimise
from tune.optimisation.nash import Solution

FloatArray = NDArray[np.float64]

#: Of the logarithm of the product of steps: of the first rank, and of those after it, which live on
#: what the digits of the ranks before leave.
GAP, GAP_AFTER = 2e-6, 1e-4
#: Six digits cost at most 1e-5 of a size, and a step is 20 to 34 %.
WRITTEN_GAP = 1e-4
#: A size that is allowed may lie beyond the boundary by what no verdict decides, and its ripple by
#: ten times as much, which is nothing anyone could measure.
BEYOND = 2e-8


def _exactly_stable(reference: Reference, pair: Pair, sizes: FloatArray) -> bool:
    """Every moment at the corners where it is closest, by crossings with 360 digits."""
    totals = reference.sums @ sizes
    found = reference.loops.crossings(totals, 2 * reference.gain)
    for moment, (stiffness, damping, mass) in enumerate(totals.tolist()):
        mine = found.moment == moment
        for index in np.unique(found.corner[mine & (found.gain < 1.02 * reference.gain)]):
            corner = reference.loops.corners[index]
            loop = loop_along(
                case_of(corner, pair.filters_hz), stiffness or None, damping or None, mass or None
            )
            if not float(crossings(loop)[0].mid()) > reference.gain * (1 - UNDECIDED):
                return False
    return True


def _judge(seed: int, starts: int, *, fine: bool) -> None:
    pair = random_pair(seed)
    try:
        solved = solved_of(pair)
    except NoFeasibleEffectError:
        everything = reference_of(pair, nothing_dropped())
        gone = frozenset(one.label for one in everything.wanted if not one.promised)
        alone = Reference(pair.device, pair.scene, pair.elements, pair.filters_hz, gone)
        rng = np.random.default_rng(0)
        assert any_place(alone, starts=20, rng=rng) is None, "the range could be met"
        return
    for label in solved.dropped:
        assert _out_of_reach(pair, solved, label), label
    if not solved.problem.unknowns:
        return
    reference = reference_of(pair, solved)
    sizes = solved.unrounded
    for answer in (sizes, solved.sizes):
        assert float(np.min(reference.rows(np.log(answer))[0])) > -BEYOND
        assert _exactly_stable(reference, pair, answer)
    rng = np.random.default_rng(seed)
    for after, gap in enumerate(gaps(reference, sizes, starts=starts, rng=rng, fine=fine)):
        assert gap.more <= (GAP_AFTER if after else GAP), gap
    every = range(reference.count)
    lost = reference.product(np.log(sizes), every) - reference.product(np.log(solved.sizes), every)
    assert lost <= WRITTEN_GAP
    assert float(np.min(reference.steps(solved.sizes))) >= 1


def _out_of_reach(pair: Pair, solved: Solution, label: str) -> bool:
    """No setting keeps it beside all that are kept of its rank and of those before."""
    everything = reference_of(pair, nothing_dropped()).wanted
    (rank,) = [one.level for one in everything if one.label == label]
    gone = frozenset(one.label for one in everything if one.level > rank) | solved.dropped.keys()
    reference = Reference(pair.device, pair.scene, pair.elements, pair.filters_hz, gone - {label})
    if any(one.low > one.high for one in reference.wanted):
        return True
    return any_place(reference, starts=20, rng=np.random.default_rng(0)) is None


@pytest.mark.parametrize("seed", thinned([0, 2, 6, 23, 146, 1, 5, 9, 31], 5))
def test_no_search_finds_better(seed: int) -> None:
    """A few starts on one device for each kind of scene; the long study has 200 on 300."""
    _judge(seed, starts=3, fine=False)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(300))
def test_no_search_from_200_starts_finds_better(seed: int) -> None:
    _judge(seed, starts=200, fine=True)


@pytest.mark.parametrize(
    "seed",
    [1, 9, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, *range(10, 300)))],
)
def test_no_effect_grows_while_the_others_lose_little(seed: int) -> None:
    """Five per cent more steps of one cost the product of the others more than four per cent."""
    pair = random_pair(seed)
    try:
        solved = solved_of(pair)
    except NoFeasibleEffectError:
        return
    if not solved.problem.unknowns:
        return
    reference = reference_of(pair, solved)
    if len({one.level for one in reference.wanted}) > 1 or reference.count < 2:
        return
    place, rng = np.log(solved.sizes), np.random.default_rng(0)
    steps = reference.steps(solved.sizes)
    for index, one in enumerate(reference.wanted):
        others = [i for i in range(reference.count) if i != index]
        lower = reference.low.copy()
        lower[index] = np.log(one.at(1.05 * float(steps[index])))
        if not lower[index] <= reference.high[index]:
            continue
        for _ in range(4):
            start = place + rng.normal(0, 0.1, reference.count)
            answer = local(reference, others, lower, reference.high, start)
            if answer is not None:
                assert answer[0] < reference.product(place, others) + np.log(0.96)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(300))
def test_what_is_written_passes_the_check(seed: int, tmp_path: Path) -> None:
    pair = random_pair(seed)
    try:
        profile = optimise(stated(pair.device), pair.scene)
    except NoFeasibleEffectError:
        return
    path = tmp_path / "profile.yaml"
    path.write_text(profile.to_yaml(), encoding="utf-8")
    check(path)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3, 9, 11, 20])
def test_no_evolution_finds_better(seed: int) -> None:
    """ISRES, which knows nothing of slopes and starts, in the same box of log-sizes."""
    nlopt: Any = import_module("nlopt")
    pair = random_pair(seed)
    solved = solved_of(pair)
    sizes = solved.unrounded
    reference = reference_of(pair, solved)
    levels = {one.level for one in reference.wanted}
    first = [i for i, one in enumerate(reference.wanted) if one.level == min(levels)]
    reached = reference.product(np.log(sizes), first)
    best = -np.inf

    def product(place: FloatArray, gradient: FloatArray) -> float:
        nonlocal best
        value = reference.product(place, first)
        if value > best and float(np.min(reference.rows(place)[0])) >= 0:
            best = value
        return value

    def broken(place: FloatArray, gradient: FloatArray) -> float:
        return -float(np.min(reference.rows(place)[0]))

    solver = nlopt.opt(nlopt.GN_ISRES, reference.count)
    nlopt.srand(seed + 1)
    solver.set_lower_bounds(np.maximum(reference.low, np.log(sizes) - 8))
    solver.set_upper_bounds(np.minimum(reference.high, np.log(sizes) + 4))
    solver.set_max_objective(product)
    solver.add_inequality_constraint(broken, 0.0)
    solver.set_maxeval(30_000)
    solver.optimize(np.log(sizes) - 1)
    assert best <= reached + GAP
    assert best >= reached - 0.2, "the evolution did not come near: it proves nothing"
