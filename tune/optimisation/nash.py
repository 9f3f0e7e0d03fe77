"""Nash product: the largest product of perceived steps, rank after rank.

Wanted values first, then the priorities: the product of the steps of one rank is made as large as
can be, with at least one step for every effect of lower rank; then its sizes stay. Which effects
can have a step at all is told by maximum feasible subsets, what binds at the end by the Lagrange
multipliers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tune.documents.profile import AbsoluteStability
from tune.loop.polynomials import FloatArray
from tune.optimisation.backends import (
    Backend,
    Evaluation,
    Program,
    Rank,
    Scenario,
    least_violation,
    program_of,
)
from tune.optimisation.feasibility import (
    SAME,
    feasible_points,
    initial_points_of,
    is_feasible,
    largest_allowed,
    least_margin_loops,
)
from tune.optimisation.limits import Unknown
from tune.optimisation.problem import Problem

#: Gains found, 0 for none, by the elements of combinations that must be absolutely stable.
AllFound = Mapping[tuple[str, ...], AbsoluteStability]

#: Sizes that stay are given up by this part, so that those after them are not wedged in.
_EASE = 3e-7
#: What one more attempt must add to the logarithm of the product.
_GAIN = 1e-8
#: Settings on the way from one to another that are checked at once.
_SECTIONS = 16
#: Solves of one proposal, each shown the corners that the one before broke; two or three are usual.
_MOST_ROUNDS = 8
#: Times the solvers are asked from the best answer before.
_MOST_ATTEMPTS = 4
#: Sets of one rank that are tried before the faintest are left out one after the other.
_MOST_SETS = 32
#: Where a search for any allowed setting begins: sizes over the least, as a part of the way up.
_BEGINNINGS = (0.0, 0.3, 0.6)
#: ... or one of them by this part, the others at their least.
_ALONE = 0.8
#: Searches of one beginning, each shown the corners that the one before broke.
_MOST_SEARCHES = 4
#: A constraint this near to its limit binds: settings are right to about 1e-7, slopes about 1.
_BINDS = 1e-6
#: What may be left of a gradient of length one at an optimum, for slopes change within 1e-6 too.
_LEFT = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Optimum:
    """Where the search ended."""

    sizes: FloatArray | None  # of the unknowns, allowed exactly; None where nothing is
    methods: tuple[str, ...] = ()  # names of what proposed each accepted answer
    disagreements: float = 0.0  # largest difference of solvers in the logarithm of a product
    scenarios: tuple[Scenario, ...] = ()  # corners whose stability the solvers had to be shown


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """The answer for elements that share combinations."""

    problem: Problem  # with only the unknowns that are perceptible and feasible
    sizes: FloatArray  # rounded, allowed exactly
    dropped: dict[str, str]  # reason by label of every effect that was left out
    method: str = "as given"
    disagreement: float = 0.0  # of the solvers, in the logarithm of the product of steps
    # gains of the combinations that must be absolutely stable
    absolute: AllFound = field(default_factory=dict[tuple[str, ...], AbsoluteStability])
    stepped_back: frozenset[int] = frozenset()  # unknowns that are smaller for it
    # a wall and an element that are not proved together; None if all are
    clash: tuple[str, str] | None = None
    # about what stiffness springs have where nothing is met beside them, by label
    alone: dict[str, float] = field(default_factory=dict[str, float])
    tightest: tuple[str, ...] = ()  # elements whose clamps are proved least together

    def by_label(self) -> dict[str, float]:
        """Sizes, SI, of what was looked for here."""
        return {
            u.label: float(size)
            for u, size in zip(self.problem.unknowns, self.sizes, strict=bool(self.sizes.size))
            if not u.settled
        }


def single_unknown_optimum(problem: Problem) -> Optimum:
    """The answer for one unknown: the least of its bounds, no solver."""
    sizes = np.array([largest_allowed(problem, np.zeros(1), 0)])
    fits = sizes[0] >= problem.unknowns[0].low and is_feasible(problem, sizes)
    return Optimum(sizes=sizes if fits else None, methods=("closed form",))


def largest_product(
    problem: Problem,
    backends: Sequence[Backend],
    known: Sequence[FloatArray] = (),
    shown: Sequence[Scenario] = (),
) -> Optimum:
    """The largest product of the steps of all unknowns, rank after rank.

    All solvers propose and the best allowed proposal is taken. What is known are sizes that are
    allowed, to begin with; where there are none, the best of some rays. Corners that are shown to
    solvers from the beginning save finding out that they are needed.
    """
    if len(problem.unknowns) == 1:
        return single_unknown_optimum(problem)
    starts = list(known) or initial_points_of(problem)
    if not starts:
        return Optimum(sizes=None)
    search = _Search(problem, backends, starts[0], shown)
    fixed = np.zeros(len(problem.unknowns), dtype=np.bool_)
    levels = sorted({unknown.level for unknown in problem.unknowns})
    for level in levels:
        active = np.array([unknown.level == level for unknown in problem.unknowns])
        # A wall gives up a little of its stiffness where that leaves room for its damping.
        yielding = np.array([u.yields > 0 and u.level == level - 1 for u in problem.unknowns])
        search.raise_rank(active | yielding, fixed & ~yielding, starts)
        if level != levels[-1]:
            search.ease(active)
        for index in np.flatnonzero(active & [unknown.yields > 0 for unknown in problem.unknowns]):
            unknown = problem.unknowns[index]
            kept = max(unknown.steps(search.sizes[index]) - unknown.yields, 0.0)
            search.low[index] = max(unknown.low, float(unknown.size_at(kept)))
        fixed |= active
        starts = [search.sizes]
    return Optimum(
        sizes=search.sizes,
        methods=tuple(dict.fromkeys(search.methods)),
        disagreements=search.disagreement,
        scenarios=tuple(search.scenarios),
    )


class _Search:
    """The best allowed setting so far, and the corners that solvers have been shown."""

    def __init__(
        self,
        problem: Problem,
        backends: Sequence[Backend],
        start: FloatArray,
        shown: Sequence[Scenario],
    ) -> None:
        self.problem = problem
        self.backends = backends
        self.sizes = start
        self.low = problem.low
        # Stability is shown only once a proposal breaks it: where something else binds, it costs
        # most and decides nothing.
        self.scenarios: list[Scenario] = list(shown)
        self.program = program_of(problem, self.scenarios)
        self.methods: list[str] = []
        self.disagreement = 0.0
        #: How close a proposal is met; roughly where no other solver looks again.
        self.close = SAME / 100 if len(backends) > 1 else 100 * SAME

    def raise_rank(
        self, active: NDArray[np.bool_], fixed: NDArray[np.bool_], starts: Sequence[FloatArray]
    ) -> None:
        """The largest product of the steps of the active unknowns, those before them fixed."""
        high = self.problem.high
        if np.all(self.sizes[active] >= high[active] * (1 - SAME)):
            return  # no solver is needed for what cannot be wanted any larger
        if np.sum(~fixed) == 1 and self._raised_alone(int(np.argmin(fixed))):
            return
        here = np.log(self.sizes)
        rank = Rank(
            weights=np.where(active, [u.weight for u in self.problem.unknowns], 0.0),
            lower=np.where(fixed, here, np.log(self.low)),
            upper=np.where(fixed, here, np.log(high)),
        )
        if self._raised_beside_yielding(active, rank):
            return
        value = self._value(self.sizes, rank)
        for attempt in range(_MOST_ATTEMPTS):
            # Where all solvers end alike from the first start, the others are not asked.
            begun: Sequence[FloatArray] = ()
            if attempt < 2:
                begun = starts[1:] if attempt else starts[:1]
            found = [
                (self._value(proposal, rank), proposal, backend.name)
                for start in (begun or [self.sizes])
                for backend in self.backends
                for proposal in [self._proposed(backend, rank, np.log(start))]
                if proposal is not None
            ]
            values = [each for each, _, _ in found]
            apart = max(values) - min(values) if len(values) == len(self.backends) else np.inf
            best = max(found, key=lambda each: each[0], default=None)
            gained = -np.inf if best is None else best[0] - value
            if best is not None and gained > 0:
                value, self.sizes = best[0], best[1]
                self.methods.append(best[2])
            # One solver alone only compares filters, for which any good answer does.
            alone = len(self.backends) == 1
            if alone or ((attempt > 0 or apart <= SAME) and self._settled(rank)):
                if np.isfinite(apart):
                    self.disagreement = max(self.disagreement, apart)
                break
            if attempt > 1 and not gained > _GAIN:
                break
            rank = replace(rank, routh=attempt % 2 == 0)

    def _raised_alone(self, index: int) -> bool:
        """Whether the only unknown that is left could be raised to the least of its bounds."""
        raised = self.sizes.copy()
        raised[index] = largest_allowed(self.problem, self.sizes, index)
        if raised[index] < self.sizes[index] or not is_feasible(self.problem, raised):
            return False
        self.sizes = raised
        self.methods.append("closed form")
        return True

    def _raised_beside_yielding(self, active: NDArray[np.bool_], rank: Rank) -> bool:
        """Whether the only other unknown could be raised, and best, where what yields is least."""
        yielding = active & (self.low > self.problem.low)
        index = np.flatnonzero(active & ~yielding)
        if not yielding.any() or index.size != 1:
            return False
        before = self.sizes, list(self.scenarios), self.program
        self.sizes = np.where(yielding, self.low, self.sizes)
        if self._raised_alone(int(index[0])):
            if self._settled(rank):
                return True
            if self._show(least_margin_loops(self.problem, self.sizes)) and self._settled(rank):
                return True
            self.methods.pop()
        self.sizes, self.scenarios, self.program = before
        return False

    def _settled(self, rank: Rank) -> bool:
        """Whether multipliers show, with the corners that are shown, that no more is possible."""
        return multipliers(self.program, rank, np.log(self.sizes)) is not None

    def _show(self, loops: set[Scenario]) -> bool:
        """Whether any of these corners had not been shown."""
        new = sorted(loops.difference(self.scenarios))
        if new:
            self.scenarios += new
            self.program = program_of(self.problem, self.scenarios)
        return bool(new)

    def _value(self, sizes: FloatArray, rank: Rank) -> float:
        return self.program.product(sizes, rank.weights)[0]

    def ease(self, active: NDArray[np.bool_]) -> None:
        """Give up a little of what is settled, where that is allowed."""
        more = active & (self.sizes < self.problem.high * (1 - SAME))
        eased = np.where(more, self.sizes * (1 - _EASE), self.sizes)
        if np.any(more) and np.all(eased >= self.problem.low) and is_feasible(self.problem, eased):
            self.sizes = eased

    def _proposed(self, backend: Backend, rank: Rank, start: FloatArray) -> FloatArray | None:
        """What one solver proposes, shown each corner that its last proposal broke; allowed."""
        proposal: FloatArray | None = None
        for _ in range(_MOST_ROUNDS):
            answer = backend.propose(self.program, rank, start)
            if answer is None:
                break
            proposal = np.exp(np.clip(answer, rank.lower, rank.upper))
            if is_feasible(self.problem, proposal):
                return proposal
            broken = least_margin_loops(self.problem, proposal, broken=True)
            if not self.scenarios:
                broken |= least_margin_loops(self.problem, np.exp(start))
            if not self._show(broken):
                break
        if proposal is None:
            return None
        return _bisect_to_feasible(self.problem, np.exp(start), proposal, self.close)


def _bisect_to_feasible(
    problem: Problem, inner: FloatArray, proposal: FloatArray, close: float
) -> FloatArray | None:
    """The last feasible point on the way from a feasible setting to a proposal."""
    # Towards the proposal in smaller and smaller steps: most are only a little beyond.
    parts = 1 - np.asarray(np.geomspace(1.0, close, _SECTIONS), dtype=np.float64)
    while True:
        points = inner ** (1 - parts[:, None]) * proposal ** parts[:, None]
        good = feasible_points(problem, points)
        first = int(np.argmin(np.append(good, False)))
        last = max(first - 1, 0)
        if first in (0, _SECTIONS) or parts[first] - parts[last] < close:
            return points[last] if first else None
        parts = np.linspace(float(parts[last]), float(parts[first]), _SECTIONS)


def feasible_subsets(
    unknowns: Sequence[Unknown], feasible: Callable[[frozenset[str]], bool]
) -> list[frozenset[str]]:
    """Maximum feasible subsets, by label: as many effects of each rank as can be kept.

    Of the first rank as many as can be kept together, then of the next beside them, and so on.
    Nothing is weighed against the product of steps: an effect is left out only where one step of it
    is out of reach. Several sets of one size where that leaves a choice; ranges are in all of them.
    Empty where a range cannot be. The faintest unknowns come last; feasible is a set that can be
    kept, each of it at one step or where its range begins.
    """
    sets = [frozenset[str]()]
    for level in sorted({unknown.level for unknown in unknowns}):
        mine = [unknown for unknown in unknowns if unknown.level == level]
        found: list[frozenset[str]] = []
        tried = 0
        for chosen in _largest_first(mine):
            if found and len(found[0]) - len(sets[0]) > len(chosen):
                break
            ranges = (each for each in mine if each.wish.kind == "range" and each.wish.low)
            promised = {unknown.label for unknown in ranges}
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
    """Some setting that every limit allows, each effect at its least or above, if one is found."""
    if len(problem.unknowns) == 1:
        return single_unknown_optimum(problem).sizes
    # On rays first, then where the most broken limit is the least broken.
    found = initial_points_of(problem, 1)
    return found[0] if found else _least_broken(problem)


def _least_broken(problem: Problem) -> FloatArray | None:
    rows = problem.linear.rows * problem.low
    ends, ones = (np.full(len(rows), -np.inf), np.ones(len(rows))), np.ones(problem.low.size)
    if solve_linear_program(0 * ones, rows, ends, (ones, problem.high / problem.low)) is None:
        return None  # linear limits alone do not allow it
    low, high = np.log(problem.low), np.log(problem.high)
    rank = Rank(weights=np.zeros(low.size), lower=low, upper=high)
    least = problem.nothing
    most = [largest_allowed(problem, least, i) for i in range(low.size)]
    up = np.log(np.maximum(most, problem.low)) - low
    beginnings = [part * up for part in _BEGINNINGS] + list(_ALONE * np.diag(up))
    scenarios = sorted(least_margin_loops(problem, problem.low))
    for begins in beginnings:
        start = low + begins
        for _ in range(_MOST_SEARCHES):
            answer = least_violation(program_of(problem, scenarios), rank, start)
            if answer is None:
                break
            sizes = np.exp(np.clip(answer, low, high))
            if is_feasible(problem, sizes):
                return sizes
            broken = least_margin_loops(problem, sizes, broken=True).difference(scenarios)
            if not broken:
                break
            scenarios += sorted(broken)
            start = answer
    return None


def multipliers(program: Program, rank: Rank, y: FloatArray) -> FloatArray | None:
    """The Lagrange multiplier of every constraint at log-sizes that end a rank, zero of most.

    At a (local) optimum the gradient of the objective is a nonnegative combination of those of the
    constraints that bind; None where the setting is no optimum to first order. With the multipliers
    the slope of an optimum by any other number follows from the slopes of the constraints by that
    number alone (envelope theorem).
    """
    found = Evaluation(program, rank).at(y)
    binding = np.flatnonzero(found.constraints > -_BINDS)
    upper = np.flatnonzero(y > rank.upper - _BINDS)
    lower = np.flatnonzero(y < rank.lower + _BINDS)
    identity = np.eye(y.size)
    slopes = np.concatenate([found.jacobian[binding], identity[upper], -identity[lower]])
    if not (len(slopes) and np.all(np.isfinite(slopes)) and np.all(np.isfinite(found.slope))):
        return None
    # Each constraint in its own unit: only the direction of its slope matters.
    sizes = np.linalg.norm(slopes, axis=1)
    sizes[sizes == 0] = 1.0
    length = float(np.linalg.norm(found.slope)) or 1.0
    directions, target = (slopes / sizes[:, None]).T, -found.slope / length
    weights = _nonnegative_combination(directions, target)
    if weights is None or np.linalg.norm(directions @ weights - target) > _LEFT:
        return None
    answer = np.zeros(found.constraints.size)
    answer[binding] = (weights * length / sizes)[: binding.size]
    return answer


def _nonnegative_combination(columns: FloatArray, target: FloatArray) -> FloatArray | None:
    """Weights, none negative, of the combination of columns that comes nearest to a target."""
    # Nearest in the sum of absolute differences. Columns and target are of length about one.
    rows, count = columns.shape
    identity = np.eye(rows)
    cost = np.concatenate([np.zeros(count), np.ones(2 * rows)])
    answer = solve_linear_program(
        cost,
        np.hstack([columns, identity, -identity]),
        (target, target),
        (np.zeros_like(cost), np.full_like(cost, np.inf)),
    )
    return None if answer is None else np.maximum(answer[:count], 0.0)


def solve_linear_program(
    cost: FloatArray,
    rows: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray | None:
    """The x of least cost·x, rows·x between two ends and x between two bounds, if there is one."""
    # All numbers are of one scale, without unit, and infinite for no end or bound. HiGHS through
    # CasADi, which a tuning has loaded anyway; scipy.optimize takes a third of a second to import.
    solver = _solver(*rows.shape)
    found = solver(g=cost, a=rows, lba=ends[0], uba=ends[1], lbx=bounds[0], ubx=bounds[1])
    if not solver.stats()["success"]:
        return None
    return np.asarray(found["x"], dtype=np.float64).ravel()


@lru_cache(maxsize=256)
def _solver(rows: int, unknowns: int) -> Any:
    import casadi as ca

    shape = {"h": ca.Sparsity(unknowns, unknowns), "a": ca.Sparsity.dense(rows, unknowns)}
    options = {"error_on_fail": False, "highs": {"output_flag": False}}
    return ca.conic("linear_program", "highs", shape, options)
