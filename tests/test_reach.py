"""What solvers see of stability and of optima: against loops and crossings of our own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.optimum_pairs import Pair, random_pair
from tests.optimum_reference import Reference
from tests.thinned import thinned
from tune.documents.perception import default_table
from tune.optimisation.backends import Rank, program_of
from tune.optimisation.feasibility import initial_points_of, is_feasible, least_margin_loops
from tune.optimisation.linear_programs import multipliers
from tune.optimisation.nash import largest_product
from tune.optimisation.problem import DesignTask, Problem
from tune.optimisation.reach import Reach
from tune.optimisation.solve import backends, solve

FloatArray = NDArray[np.float64]


@cache
def _posed(seed: int) -> tuple[Pair, Problem, FloatArray]:
    """A pair, its problem without what was dropped, and the sizes that were found."""
    pair = random_pair(seed)
    solved = solve(
        DesignTask.of(pair.device, pair.scene, default_table()), pair.elements, pair.filters
    )
    return pair, solved.problem, solved.sizes


def _reference(pair: Pair, problem: Problem) -> Reference:
    every = {
        f"{name}.{effect}"
        for name, element in pair.scene.elements.items()
        for effect in element.wishes()
    }
    gone = frozenset(every - {unknown.label for unknown in problem.unknowns})
    return Reference(pair.device, pair.scene, pair.elements, pair.filters_hz, gone)


def _reach(problem: Problem) -> Reach:
    every = [(loop, range(loop.terms.free.shape[1])) for loop in problem.loops.late]
    return Reach.of(problem, every, problem.margin.gain)


def _rows(reach: Reach, sizes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Reach, its slopes, gap phase, its slopes: of each moment and corner."""
    value, slope = reach.at(sizes)
    parts: list[list[FloatArray]] = [[], [], [], []]
    start = 0
    for table in reach.tables:
        for shares in reach.shares:
            count = len(shares) * table[0].shape[1]
            for which in (0, 1):
                chosen = slice(start + which * count, start + (which + 1) * count)
                parts[2 * which].append(value[chosen])
                parts[2 * which + 1].append(slope[chosen])
            start += 2 * count
    ends, end_slopes, gaps, gap_slopes = (np.concatenate(part) for part in parts)
    return ends, end_slopes, gaps, gap_slopes


# Two together, in a hand, made lighter, three effects, three elements, a fixed value.
@pytest.mark.parametrize("seed", thinned([1, 5, 13, 21, 2, 3, 7, 9, 14, 15, 23, 33], 4))
def test_the_reach_and_its_slopes_are_those_of_crossings_found_otherwise(seed: int) -> None:
    pair, problem, sizes = _posed(seed)
    reference, reach = _reference(pair, problem), _reach(problem)
    rng = np.random.default_rng(seed)
    seen = 0
    for _ in range(12):
        point = sizes * np.exp(rng.uniform(-0.5, 0.5, sizes.size))
        for _ in range(3):  # along the ray to somewhere near the boundary
            point *= np.exp(-float(np.max(_rows(reach, point)[0])))
        point *= np.exp(rng.uniform(-0.3, 0.3))
        ends, slopes, gaps, _ = _rows(reach, point)
        worst = int(np.argmax(ends))
        found = reference.loops.crossings(reference.sums @ point, 50 * reference.gain)
        if not found.gain.size or np.max(gaps) > 0 or abs(ends[worst]) > 2:
            continue
        first = int(np.argmin(found.gain))
        assert ends[worst] == pytest.approx(np.log(reference.gain / found.gain[first]), abs=1e-8)
        truth = -found.slopes[:, first] @ reference.sums[found.moment[first]] * point
        assert slopes[worst] == pytest.approx(truth, rel=1e-4, abs=1e-6)
        seen += 1
    assert seen >= 3


def test_a_gap_that_opens_below_the_gain_is_seen_before_it_opens() -> None:
    """Two crossings at a fifth of the gain appear between two settings a part in 1e5 apart."""
    pair, problem, _ = _posed(146)
    reference, reach = _reference(pair, problem), _reach(problem)
    whole = np.log([122.599875, 0.474682467, 0.0676885305])
    open_ = np.log([122.60160853811423, 0.4745943199370595, 0.06768948787904698])

    def phase(part: float) -> float:
        return float(np.max(_rows(reach, np.exp(whole + part * (open_ - whole)))[2]))

    def broken(part: float) -> bool:
        place = np.exp(whole + part * (open_ - whole))
        gains = reference.loops.crossings(reference.sums @ place, 3.0).gain
        return bool(np.min(gains, initial=np.inf) < 1)

    low, high = 0.0, 1.0
    assert phase(low) < 0 < phase(high)
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (middle, high) if phase(middle) < 0 else (low, middle)
    assert not broken(low - 1e-3)
    assert broken(high + 1e-3)
    for part in (low - 0.3, low - 0.01, high + 0.01, high + 0.3):
        _, _, gaps, slopes = _rows(reach, np.exp(whole + part * (open_ - whole)))
        along = float(slopes[int(np.argmax(gaps))] @ (open_ - whole))
        assert along == pytest.approx((phase(part + 1e-3) - phase(part - 1e-3)) / 2e-3, rel=1e-2)


def _all_raised(problem: Problem) -> tuple[Rank, FloatArray]:
    """All raised together, and where that ends."""
    best = largest_product(problem, backends()).sizes
    assert best is not None
    low, high = np.log(problem.low), np.log(problem.high)
    return Rank(weights=np.ones(best.size), lower=low, upper=high), best


@pytest.mark.parametrize("seed", [1, 25, 37])
def test_multipliers_are_what_a_limit_is_worth(seed: int) -> None:
    """Linear limits a little higher: by another solve the product rises by their multipliers."""
    _, problem, _ = _posed(seed)
    rank, best = _all_raised(problem)
    program = program_of(problem, list(least_margin_loops(problem, best)))
    found = multipliers(program, rank, np.log(best))
    assert found is not None
    more = 1e-4
    rows = problem.linear.rows / (1 + more)
    eased = replace(problem, linear=replace(problem.linear, rows=rows))
    risen = largest_product(eased, backends(), [best]).sizes
    assert risen is not None
    gained = program.product(risen, rank.weights)[0] - program.product(best, rank.weights)[0]
    # The compiled rows come after those of the ripple; the last of them are linear.
    smooth = int(program.structure.smooth.numel_out(0))
    linear = found[smooth - len(rows) : smooth]
    assert gained == pytest.approx(float(np.sum(linear)) * more, rel=0.02, abs=1e-8)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_setting_inside_has_no_multipliers(seed: int) -> None:
    _, problem, _ = _posed(seed)
    rank, best = _all_raised(problem)
    program = program_of(problem, list(least_margin_loops(problem, best)))
    assert multipliers(program, rank, np.log(best * 0.9)) is None


@pytest.mark.parametrize("seed", [1, 2, 3, 5, 7, 9, 33])
def test_a_start_is_allowed_and_meets_what_is_wanted_if_it_can(seed: int) -> None:
    _, problem, sizes = _posed(seed)
    start = initial_points_of(problem)[0]
    assert is_feasible(problem, start)
    for unknown, first, found in zip(problem.unknowns, start, sizes, strict=True):
        assert first >= unknown.low
        if unknown.wish.kind == "value" and found == unknown.high:
            assert first == pytest.approx(unknown.high, rel=1e-12)
