"""Elements that share moments to their largest perceivable effects, rounded and allowed exactly.

One file: rank after rank, what is kept and what is dropped is one loop.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tune.documents.errors import NoFeasibleEffectError
from tune.documents.scene import Scene
from tune.loop.filters import Filters
from tune.optimisation.backends import Backend
from tune.optimisation.bounds import largest_allowed
from tune.optimisation.describe import bindings
from tune.optimisation.feasible_subsets import feasible_sizes, feasible_subsets
from tune.optimisation.nash import Optimum, largest_product, single_unknown_optimum
from tune.optimisation.problem import DesignTask, Problem, pose
from tune.optimisation.reasons import imperceptible, reasons_for_nothing
from tune.optimisation.rounding import round_sizes
from tune.optimisation.saturable import may_saturate

if TYPE_CHECKING:
    from tune.optimisation.one_sided import AllFound, ProvedGain

FloatArray = NDArray[np.float64]

#: In the logarithm of the product, where cut-offs are still looked for.
_ROUGHLY = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """The answer for elements that share moments.

    Attributes:
        problem: with only the unknowns that are perceptible and feasible.
        sizes: rounded, allowed exactly, shape (unknowns,).
        unrounded: as they were found, shape (unknowns,); empty where nothing was looked for.
        dropped: reason by label of every effect that was left out.
        method: what found the answer.
        disagreement: of the solvers, in the logarithm of the product of steps.
        absolute: gains of the moments that must be absolutely stable.
    """

    problem: Problem
    sizes: FloatArray
    dropped: dict[str, str]
    method: str = "as given"
    disagreement: float = 0.0
    unrounded: FloatArray = field(default_factory=lambda: np.empty(0))
    absolute: AllFound = field(default_factory=dict[tuple[str, ...], "ProvedGain"])


def groups(scene: Scene) -> tuple[tuple[str, ...], ...]:
    """Elements connected through ``together``; each group is one problem."""
    found = [{name} for name in scene.elements]
    for together in scene.together:
        joined = [group for group in found if group & set(together)]
        found = [group for group in found if not group & set(together)]
        found.append({name for group in joined for name in group})
    order = list(scene.elements)
    ordered = [tuple(sorted(group, key=order.index)) for group in found]
    return tuple(sorted(ordered, key=lambda group: order.index(group[0])))


def solve(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    *,
    second_opinion: bool = True,
) -> Solution:
    """Tune one group; effects of which one step is out of reach are dropped, with what they miss.

    Springs into which a hand may go as deep as it likes are cut at the limit of force, where they
    can be proved safe so at the scene's margin; else the usual motion bounds them.

    Raises:
        NoFeasibleEffectError: a range cannot be met.
    """
    usual = _solved(task, elements, filters, second_opinion=second_opinion)
    cut = may_saturate(task, elements)
    if not cut:
        return usual
    free = _solved(task, elements, filters, cut, beside=usual, second_opinion=second_opinion)
    return max(usual, free, key=lambda each: (each.sizes.size, _products(each.problem, each.sizes)))


def _solved(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    cut: frozenset[str] = frozenset(),
    *,
    beside: Solution | None = None,
    second_opinion: bool,
    gone: Mapping[str, str] | None = None,
) -> Solution:
    """One group with certain springs cut at the limit of force.

    What is proved to less than one step is dropped, and the rest is tuned without it.

    Args:
        task: device, scene, perception and region.
        elements: of the group.
        filters: of the controller.
        cut: elements whose springs are cut.
        beside: the same with none cut, where the search may begin as well.
        second_opinion: ask all solvers, and for proofs of what is cut or one-sided.
        gone: effects that are left out, with the reason.
    """
    problem, optimum, dropped = optimum_of(
        task, elements, filters, cut=cut, second_opinion=second_opinion, gone=gone
    )
    if optimum is None or optimum.sizes is None:
        return Solution(problem=problem, sizes=np.empty(0), dropped=dropped, method="none")
    sizes = round_sizes(problem, optimum.sizes)
    found: AllFound = {}
    if second_opinion and any(moment.absolute for moment in problem.moments):
        from tune.optimisation.saturation import absolutely_stable

        starts = [sizes]
        if beside is not None and _labels(beside.problem) == _labels(problem):
            starts.append(beside.sizes)
        sizes, found = absolutely_stable(problem, starts, backends(second_opinion=False))
        parts = sizes / problem.low
        if np.any(parts < 1):
            index = int(np.argmin(parts))
            why = f"pushing on one side, or cut, it is proved stable to {sizes[index]:.4g} at most"
            short = {problem.unknowns[index].label: why}
            _refuse_broken_ranges(problem, short)
            return _solved(
                task,
                elements,
                filters,
                cut,
                beside=beside,
                second_opinion=second_opinion,
                gone=dropped | short,
            )
    return Solution(
        problem=problem,
        sizes=sizes,
        dropped=dropped,
        method=" and ".join(optimum.methods) or "start",
        disagreement=optimum.disagreements,
        unrounded=optimum.sizes,
        absolute=found,
    )


def _labels(problem: Problem) -> list[str]:
    return [unknown.label for unknown in problem.unknowns]


def optimum_of(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    *,
    cut: frozenset[str] = frozenset(),
    second_opinion: bool = True,
    known: Callable[[Problem], Sequence[FloatArray]] | None = None,
    gone: Mapping[str, str] | None = None,
    choosing: bool = True,
) -> tuple[Problem, Optimum | None, dict[str, str]]:
    """The problem of what is kept, its optimum not rounded, and why the rest is dropped.

    All sizes have shape (unknowns,), SI units.

    Args:
        task: device, scene, perception and region.
        elements: of the group.
        filters: of the controller.
        cut: elements whose force may be cut at its limit.
        second_opinion: ask all solvers.
        known: sizes of all effects of a problem to begin with, allowed as far as doubles tell,
            where there are some.
        gone: effects that are left out, with the reason.
        choosing: where effects that are possible alone are not so together, choose which are kept;
            else the optimum has no sizes there.

    Raises:
        NoFeasibleEffectError: a range cannot be met.
    """

    def posed(gone: frozenset[str]) -> Problem:
        return pose(task, elements=elements, filters=filters, gone=gone, cut=cut)

    def best(problem: Problem, known: Sequence[FloatArray] = ()) -> Optimum:
        if len(problem.unknowns) == 1:
            return single_unknown_optimum(problem)
        return largest_product(problem, backends(second_opinion=second_opinion), known)

    dropped = dict(gone or {})
    problem = posed(frozenset(dropped))
    while impossible := reasons_for_nothing(problem):
        _refuse_broken_ranges(problem, impossible)
        dropped |= impossible
        problem = posed(frozenset(dropped))
    if not problem.unknowns:
        return problem, None, dropped
    found = best(problem, [] if dropped or known is None else known(problem))
    if found.sizes is not None or not choosing:
        return problem, found, dropped
    every = frozenset(unknown.label for unknown in problem.unknowns)
    before = frozenset(dropped)

    starts: dict[frozenset[str], FloatArray | None] = {}

    def feasible(labels: frozenset[str]) -> bool:
        starts[labels] = feasible_sizes(posed(before | (every - labels)))
        return starts[labels] is not None

    sets = feasible_subsets(problem.unknowns, feasible)
    if not sets:
        _refuse_broken_ranges(
            problem, dict.fromkeys(every, "no setting keeps it together with the other effects")
        )
    optima: list[tuple[Problem, Optimum | None]] = []
    for labels in sets:
        start, each = starts.get(labels), posed(before | (every - labels))
        optima.append((each, None if start is None else best(each, [start])))
    chosen, optimum = max(optima, key=lambda pair: _products(pair[0], pair[1] and pair[1].sizes))
    found = {} if optimum is None or optimum.sizes is None else _by_label(chosen, optimum.sizes)
    for label in [unknown.label for unknown in problem.unknowns if unknown.label not in found]:
        alone = posed(before | (every - {label}))
        missed = _missed(alone, label, {})
        if found and largest_allowed(alone, np.zeros(1), 0) >= alone.unknowns[0].low:
            with_others = posed(before | (every - found.keys() - {label}))
            missed = "beside the others " + _missed(with_others, label, found)
        dropped[label] = missed
    return chosen, optimum, dropped


def _by_label(problem: Problem, sizes: FloatArray) -> dict[str, float]:
    return {u.label: float(size) for u, size in zip(problem.unknowns, sizes, strict=True)}


def _products(problem: Problem, sizes: FloatArray | None) -> list[float]:
    """The logarithms of the products of steps, rank after rank."""
    if sizes is None or not sizes.size:
        return []
    steps = [u.steps(float(s)) for u, s in zip(problem.unknowns, sizes, strict=True)]
    levels = sorted({unknown.level for unknown in problem.unknowns})
    pairs = list(zip(problem.unknowns, steps, strict=True))
    return [
        float(sum(u.weight * np.log(s) for u, s in pairs if u.level == level)) for level in levels
    ]


def _missed(problem: Problem, label: str, beside: Mapping[str, float]) -> str:
    """By how much one step of an effect is missed beside others of certain sizes.

    Args:
        problem: of all of them.
        label: of the effect.
        beside: sizes of the others by label.
    """
    (index,) = [i for i, u in enumerate(problem.unknowns) if u.label == label]
    unknown = problem.unknowns[index]
    sizes = np.array([beside.get(other.label, 0.0) for other in problem.unknowns])
    sizes[index] = largest_allowed(problem, sizes, index)
    return imperceptible(unknown, float(sizes[index]), bindings(problem, sizes, [index])[0])


def backends(*, second_opinion: bool = True) -> list[Backend]:
    """The solvers that propose, loaded when first needed."""
    from tune.optimisation.backends.casadi_ import Ipopt
    from tune.optimisation.backends.nlopt_ import Slsqp

    return [Slsqp(), Ipopt()] if second_opinion else [Slsqp(_ROUGHLY)]


def _refuse_broken_ranges(problem: Problem, impossible: dict[str, str]) -> None:
    """A range is a promise: its lower end is met or nothing is written."""
    broken = tuple(
        f"{unknown.label}: its range starts at {unknown.wish.low:g}, {impossible[unknown.label]}"
        for unknown in problem.unknowns
        if unknown.wish.kind == "range"
        and unknown.label in impossible
        and unknown.high >= unknown.low
        and unknown.wish.low
    )
    if broken:
        raise NoFeasibleEffectError(broken)
