"""Elements that meet to their largest perceivable effects, exactly or to compare filters."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from identification import as_stored
from tune.documents.profile import AbsoluteStability
from tune.documents.scene import MARGINS, Scene
from tune.loop.loop import Filters
from tune.loop.polynomials import FloatArray
from tune.optimisation.backends import Backend, Ipopt, Scenario, Slsqp
from tune.optimisation.describe import why_unproved
from tune.optimisation.feasibility import (
    bindings,
    imperceptible,
    largest_allowed,
    least_beside,
    passes_cheap_limits,
    reasons_for_nothing,
    round_sizes,
    stable_in_doubles,
)
from tune.optimisation.limits import Unknown
from tune.optimisation.nash import (
    AllFound,
    Optimum,
    Solution,
    feasible_sizes,
    feasible_subsets,
    largest_product,
)
from tune.optimisation.problem import DesignTask, Problem, may_saturate, problem_of
from tune.optimisation.saturation import (
    MOST_LOST,
    Tried,
    largest_sets,
    soften,
    step_back,
    witness_of,
)

#: No bounds but those of the problem.
_ANY: Mapping[str, float] = MappingProxyType({})

#: Why the damper of a wall goes with its spring.
_NO_WALL = "without its stiffness it would be no wall"
#: In the logarithm of the product, where cut-offs are still looked for.
_ROUGHLY = 1e-6


def groups(scene: Scene) -> tuple[tuple[str, ...], ...]:
    """Elements connected through ``together``, in the order in which they are tuned."""
    found: list[frozenset[str]] = [frozenset({name}) for name in scene.elements]
    for group in scene.together:
        for together in (scene.walls.intersection(group), frozenset(group) - scene.walls):
            joined = frozenset[str]().union(*(each for each in found if each & together))
            found = [each for each in found if not each & together] + [joined] * bool(joined)
    order = list(scene.elements)

    # Each group is one problem beside those before it: walls are met everywhere and come after the
    # others of their priority.
    def place(group: tuple[str, ...]) -> tuple[int, bool, int]:
        return *rank_of(scene, group), order.index(group[0])

    return tuple(sorted((tuple(sorted(g, key=order.index)) for g in found), key=place))


def rank_of(scene: Scene, group: Sequence[str]) -> tuple[int, bool]:
    """The first priority in a group, and whether it is of walls, which come later."""
    return min(scene.elements[name].priority for name in group), group[0] in scene.walls


def solve(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    before: Sequence[Solution] = (),
) -> Solution:
    """Tune one group; effects of which a step is out of reach are dropped, with what they miss."""
    met = _met(task, elements)
    beside = {
        label: size
        for solved in before
        for label, size in solved.by_label().items()
        if label.rpartition(".")[0] in met
    }
    known = frozenset[str]().union(*(solved.problem.cut for solved in before))
    # Springs into which a hand may go as deep as it likes are cut at the limit of force, where they
    # can be proved safe so at the scene's margin; else the usual motion bounds them. What was tuned
    # before may be felt beside them.
    cut = may_saturate(task, elements)
    walls = cut & task.scene.walls
    free = _solved(task, elements, filters, known | cut, beside)
    if free.dropped and beside and free.clash is None:
        alone = _solved(task, elements, filters, known | cut, {})
        if len(alone.dropped) < len(free.dropped):
            others = (label.rpartition(".")[0] for label in reversed(beside))
            pairs = (_pair(task, elements, (*elements, other)) for other in others)
            free = replace(free, clash=next((pair for pair in pairs if pair is not None), None))
    if free.clash is not None or cut == walls or not (free.stepped_back or free.dropped):
        return free
    usual = _solved(task, elements, filters, known | walls, beside)
    return max(usual, free, key=lambda each: (each.sizes.size, _products(each.problem, each.sizes)))


def _met(task: DesignTask, elements: Sequence[str]) -> set[str]:
    """Elements that share some combination with some of these."""
    own = {*elements}
    every = (subset for subsets in task.subsets.values() for subset in subsets)
    return {name for subset in every if not own.isdisjoint(subset) for name in subset}


def _solved(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    cut: frozenset[str],
    settled: Mapping[str, float],
    gone: Mapping[str, str] | None = None,
) -> Solution:
    """One group with certain springs cut at the limit of force, beside what is settled.

    What is proved to less than one step is gone, with its reason, and the rest is tuned without it.
    All solvers are asked where linear limits alone bind.
    """
    kept: dict[str, float] = {}
    left_out = gone

    def tuned(room: float, most: Mapping[str, float] = _ANY) -> Tried:
        most = kept | {label: min(size, kept.get(label, size)) for label, size in most.items()}
        return optimum_of(
            task,
            elements,
            filters,
            cut=cut,
            settled=settled,
            room=room,
            most=most,
            choosing=not room and not most,
            second_opinion=not room and not most,
            gone=left_out,
        )

    problem, optimum, dropped = tuned(0.0)
    left_out = dropped  # so it stays: nothing is chosen anew
    nothing = Solution(problem=problem, sizes=np.empty(0), dropped=dropped, method="none")
    if optimum.sizes is None:
        return nothing
    linear = sizes = round_sizes(problem, optimum.sizes)
    for u, size in zip(problem.unknowns, linear.tolist(), strict=True):
        if u.element in task.parts and not u.settled and u.wish.kind != "value":
            kept[u.label] = u.rounded_at(task.parts[u.element] * u.steps(size))
    if kept:
        less, other, also = tuned(0.0)
        if other.sizes is not None and also == dropped:
            sizes = round_sizes(less, other.sizes)
    found: AllFound = {}
    alone: dict[str, float] = {}
    tightest: tuple[str, ...] = ()
    if any(combination.absolute for combination in problem.combinations):
        sizes, found, tightest = step_back(problem, sizes, tuned, dropped)
        gain = min(one.gain for one in found.values())
        short = gain < problem.proved_gain
        if settled:  # about what stiffness the group has where nothing is met beside it
            bare, most_alone, _ = optimum_of(
                task, elements, filters, cut=cut, second_opinion=False, choosing=False
            )
            if most_alone.sizes is not None:
                pairs = zip(bare.unknowns, most_alone.sizes.tolist(), strict=True)
                alone = {u.label: size for u, size in pairs if u.effect == "stiffness"}
        # Of springs what they have alone, of dampers what linear limits leave them.
        pairs = zip(problem.unknowns, linear.tolist(), strict=True)
        most = alone | {u.label: size for u, size in pairs if u.effect == "damping"}
        if short or _steps_lost(problem, sizes, most) > MOST_LOST:
            soft = soften(problem, linear, alone, tuned, dropped)
            clash = _pair(task, elements, tightest) if soft is None else None
            # Beside one that is proved, though soft, room is left once.
            once = clash and not {*clash} & task.parts.keys() and task.with_room_for(*clash)
            if clash is not None and (short or once):
                return replace(nothing, clash=clash)
            if soft is None and short:
                own = [u for u in problem.unknowns if not u.settled]
                label = min(own, key=lambda u: u.effect != "stiffness").label
                left = dropped | keep_promises(problem, {label: why_unproved(task, label, gain)})
                return _solved(task, elements, filters, cut, settled, left)
            sizes, found = soft or (sizes, found)
    return replace(
        nothing,
        sizes=sizes,
        method=" and ".join(optimum.methods) or "start",
        disagreement=optimum.disagreements,
        absolute=found,
        alone=alone,
        tightest=tightest,
        stepped_back=frozenset(np.flatnonzero(sizes < linear).tolist()),
    )


def _steps_lost(problem: Problem, sizes: FloatArray, most: Mapping[str, float]) -> float:
    """Most steps that an effect is below the most that it may have, by label, if that is known."""
    both = [(u, u.steps(size)) for u, size in zip(problem.unknowns, sizes.tolist(), strict=True)]
    return max((u.steps(most[u.label]) - n for u, n in both if u.label in most), default=0.0)


def _pair(
    task: DesignTask, elements: Sequence[str], combination: tuple[str, ...]
) -> tuple[str, str] | None:
    """A wall and another element, one of them tuned before, of which one may leave more room."""
    scene = task.scene

    def leaves_room(pair: tuple[str, str]) -> bool:
        return task.with_room_for(*pair) is not None

    pairs = [
        (wall, other)
        for wall in combination
        for other in combination
        if wall in scene.walls
        and other not in scene.walls
        and (wall in elements) != (other in elements)
        and {wall, other} not in map(set, scene.apart)
    ]
    # Or that may be told apart, as what the scene asks for together may not. Of the least priority.
    may = [pair for pair in pairs if leaves_room(pair) or not task.asks_for_both(pair)]
    return max(may, key=lambda p: (scene.elements[p[1]].priority, leaves_room(p)), default=None)


def witnesses_of(task: DesignTask, solutions: Sequence[Solution]) -> dict[str, AbsoluteStability]:
    """What proves the clamps of solutions, by combination, as stored; nothing where none may be."""
    kept, slack = MARGINS[task.scene.margin], task.slack
    return {
        " + ".join(names): as_stored(witness_of(one, kept, slack))
        for names, one in proofs_of(solutions).items()
    }


def proofs_of(solutions: Sequence[Solution]) -> AllFound:
    """Gains of combinations that must be absolutely stable, of what is left, part of no other."""
    there = {unknown.element for solved in solutions for unknown in solved.problem.unknowns}
    found = {
        tuple(name for name in names if name in there): one
        for solved in solutions
        for names, one in solved.absolute.items()
    }
    return {names: found[names] for names in largest_sets(found)}


def optimum_of(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    *,
    cut: frozenset[str] = frozenset(),
    settled: Mapping[str, float] = MappingProxyType({}),
    room: float = 0.0,
    most: Mapping[str, float] = _ANY,
    second_opinion: bool = True,
    known: Callable[[Problem], tuple[Sequence[FloatArray], Sequence[Scenario]]] | None = None,
    gone: Mapping[str, str] | None = None,
    choosing: bool = True,
) -> Tried:
    """The problem of what is kept, its optimum not rounded, and why the rest is dropped.

    Beside the choices of `problem_of`, ``known`` gives sizes of all effects of a problem to begin
    with, allowed as far as doubles tell, where there are some, and corners that bound them; no
    effect is larger than the ``most`` that its label has. What is ``gone`` is left out, with the
    reason, as is what the task leaves out. Where effects that are possible alone are not so
    together, it is chosen which are kept; without ``choosing`` the optimum has no sizes there.
    Without a second opinion only the quickest solver is asked, for roughly its answer.
    """

    def problem_without(gone: frozenset[str]) -> Problem:
        # Without its stiffness the damper of a wall would act everywhere.
        gone |= {f"{e}.damping" for e in task.scene.walls if f"{e}.stiffness" in gone}
        found = problem_of(
            task, elements=elements, filters=filters, gone=gone, cut=cut, settled=settled, room=room
        )
        return found.limited_to(most) if most else found

    left = task.left_out_of(elements) | dict(gone or {})
    solvers = backends() if second_opinion else [Slsqp(_ROUGHLY)]
    dropped = dict(left)
    problem = problem_without(frozenset(dropped))
    while impossible := reasons_for_nothing(problem):
        dropped |= keep_promises(problem, impossible)
        problem = problem_without(frozenset(dropped))
    asked = [f"{e}.{effect}" for e in elements for effect in task.scene.elements[e].wishes()]
    own = {unknown.label for unknown in problem.unknowns if not unknown.settled}
    dropped |= {label: _NO_WALL for label in asked if label not in own and label not in dropped}
    if not own:
        return problem, Optimum(sizes=None), dropped
    whole = len(dropped) == len(left)
    begin = known(problem) if whole and known is not None else ((), ())
    found = largest_product(problem, solvers, *begin)
    if found.sizes is not None or not choosing:
        return problem, found, dropped
    every, before = frozenset(own), frozenset(dropped)
    starts: dict[frozenset[str], FloatArray | None] = {}

    def feasible(labels: frozenset[str]) -> bool:
        trial = problem_without(before | (every - labels))
        whole = labels <= {unknown.label for unknown in trial.unknowns}
        starts[labels] = feasible_sizes(trial) if labels and whole else None
        return not labels or starts[labels] is not None

    sets = feasible_subsets([u for u in problem.unknowns if not u.settled], feasible)
    if not sets:
        broken = _broken_ranges(problem, own, feasible)
        return optimum_of(
            task,
            elements,
            filters,
            cut=cut,
            settled=settled,
            room=room,
            most=most,
            second_opinion=second_opinion,
            known=known,
            gone=dropped | broken,
        )
    optima: list[tuple[Problem, Optimum]] = []
    for labels in sets:
        start, each = starts.get(labels), problem_without(before | (every - labels))
        found = Optimum(sizes=None) if start is None else largest_product(each, solvers, [start])
        optima.append((each, found))
    chosen, optimum = max(optima, key=lambda pair: _products(pair[0], pair[1].sizes))
    beside: dict[str, float] = {}
    if optimum.sizes is not None:
        names = (unknown.label for unknown in chosen.unknowns)
        beside = dict(zip(names, optimum.sizes.tolist(), strict=True))
    for label in [u.label for u in problem.unknowns if u.label in own and u.label not in beside]:
        dropped[label] = _shortfall(
            problem_without(before | (every - beside.keys() - {label})), label, beside
        )
    return chosen, optimum, dropped


def _products(problem: Problem, sizes: FloatArray | None) -> list[float]:
    """The logarithms of the products of steps, rank after rank."""
    if sizes is None or not sizes.size:
        return []
    steps = [u.steps(float(s)) for u, s in zip(problem.unknowns, sizes, strict=True)]
    levels = sorted({unknown.level for unknown in problem.unknowns if not unknown.settled})
    pairs = [each for each in zip(problem.unknowns, steps, strict=True) if not each[0].settled]
    return [
        float(sum(u.weight * np.log(s) for u, s in pairs if u.level == level)) for level in levels
    ]


def _shortfall(problem: Problem, label: str, beside: Mapping[str, float]) -> str:
    """By how much one step of an effect is missed, by itself or else beside what is kept."""
    places = [i for i, u in enumerate(problem.unknowns) if u.label == label]
    if not places:
        return _NO_WALL
    index, unknown = places[0], problem.unknowns[places[0]]
    found = np.array([beside.get(other.label, 0.0) for other in problem.unknowns])
    for words, sizes in (("", least_beside(problem)), ("beside the others ", found)):
        sizes[index] = largest_allowed(problem, sizes, index)
        if sizes[index] < unknown.low or words:
            word = bindings(problem, sizes, [index])[0]
            return words + imperceptible(unknown, float(sizes[index]), word)
    raise AssertionError("one of both is returned")


def backends() -> list[Backend]:
    """The solvers that propose."""
    return [Slsqp(), Ipopt()]


def keep_promises(problem: Problem, reasons: Mapping[str, str]) -> dict[str, str]:
    """Reasons by label, with all of an element that misses its range, which is a promise."""
    found = dict(reasons)
    for unknown in problem.unknowns:
        if unknown.label in reasons and _promises(unknown):
            mates = (each.label for each in problem.unknowns if each.element == unknown.element)
            found = dict.fromkeys(mates, f"it goes with its {unknown.effect}") | found
            start = f"its range starts at {unknown.wish.low:g}, {reasons[unknown.label]}"
            found[unknown.label] = start
    return found


def _promises(unknown: Unknown) -> bool:
    """Whether nothing is played of its element unless its range is met."""
    wish = unknown.wish
    return wish.kind == "range" and bool(wish.low) and unknown.high >= unknown.low


def _broken_ranges(
    problem: Problem, own: Collection[str], feasible: Callable[[frozenset[str]], bool]
) -> dict[str, str]:
    """Elements whose ranges cannot be met even by themselves, with reasons; else the faintest."""
    ranges = [u for u in problem.unknowns if u.label in own and _promises(u)]
    whole = {
        name: frozenset(u.label for u in problem.unknowns if u.element == name and u.label in own)
        for name in dict.fromkeys(u.element for u in ranges)
    }
    promised = {name: frozenset(u.label for u in ranges if u.element == name) for name in whole}
    broken = [n for n in whole if not feasible(promised[n]) and not feasible(whole[n])]
    if broken:
        alone = {u.label: _most_alone(problem, u) for u in ranges if u.element in broken}
        return keep_promises(problem, alone)
    beside = "which no setting that was found keeps beside the other ranges"
    last = max(u.level for u in ranges)
    return keep_promises(problem, {[u for u in ranges if u.level == last][-1].label: beside})


def _most_alone(problem: Problem, unknown: Unknown) -> str:
    """How far an effect falls short of its range where nothing else is asked for, and why."""
    sizes, index = problem.nothing, problem.unknowns.index(unknown)
    sizes[index] = most = largest_allowed(problem, sizes, index)
    if most >= unknown.low:
        return "no setting keeps it, not even without the other elements"
    word = bindings(problem, sizes, [index])[0]
    return f"at most {most:.4g} is kept even without the other elements, limited by {word}"


#: What a rank counts beside the one before it.
_NEXT_RANK = 0.1
#: Parts to which sizes that were good with other cut-offs are taken back until they are allowed.
_TAKEN_BACK = (1.0, 0.9995, 0.98, 0.9, 0.75, 0.5, 0.25)


class CutoffObjective(NamedTuple):
    """What elements are worth with certain filters; the greater is worth more.

    By rank as many effects as can be kept count first, the first rank first; then the sum of the
    logarithms of steps, those of a wanted value over all that it asks for, each rank a tenth of the
    one before.
    """

    kept: tuple[int, ...]
    value: float

    def plus(self, other: CutoffObjective) -> CutoffObjective:
        """The objective of both groups together."""
        kept = tuple(a + b for a, b in zip(self.kept, other.kept, strict=True))
        return CutoffObjective(kept=kept, value=self.value + other.value)


def worth_of(task: DesignTask, solutions: Sequence[Solution]) -> CutoffObjective:
    """What solutions of all groups are worth together."""
    left = [solved for solved in solutions if solved.sizes.size]
    own = [u.level for solved in left for u in solved.problem.unknowns if not u.settled]
    value = sum(value_of(task, solved.problem, solved.sizes) for solved in left)
    return CutoffObjective(kept=tuple(map(own.count, task.ranks)), value=value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuned:
    """A group tuned with certain filters: the problem of what is kept, its optimum."""

    objective: CutoffObjective
    problem: Problem
    optimum: Optimum


def tune_with_filters(
    task: DesignTask,
    elements: Sequence[str],
    filters: Filters,
    before: Tuned | None = None,
    *,
    choosing: bool = True,
    gone: frozenset[str] = frozenset(),
) -> Tuned:
    """A group tuned by one solver, from where it was with other filters, without what is gone.

    Of effects that cannot be kept together the best set is chosen, at a cost; without ``choosing``
    all of them count as left out.
    """

    def known(problem: Problem) -> tuple[list[FloatArray], Sequence[Scenario]]:
        if before is None or before.optimum.sizes is None:
            return [], ()
        sizes, labels = before.optimum.sizes, [u.label for u in before.problem.unknowns]
        if sizes.size < 2 or [u.label for u in problem.unknowns] != labels:
            return [], ()
        # Allowed as far as doubles tell: what is written in the end is not found from here.
        points = np.maximum(np.minimum(np.outer(_TAKEN_BACK, sizes), problem.high), problem.low)
        points = points[passes_cheap_limits(problem, points)]
        return [*points[stable_in_doubles(problem, points)][:1]], before.optimum.scenarios

    problem, optimum, dropped = optimum_of(
        task,
        elements,
        filters,
        cut=may_saturate(task, elements),
        second_opinion=False,
        known=known,
        choosing=choosing,
        gone=dict.fromkeys(gone, ""),
    )
    sizes = np.empty(0) if optimum.sizes is None else optimum.sizes
    levels = [unknown.level for unknown in problem.unknowns] if sizes.size else []
    # A range that is missed costs more than all else that could be kept instead.
    wishes = {name: task.scene.elements[name].wishes() for name in elements}
    missed = sum(
        f"{name}.{effect}" in dropped.keys() - gone
        for name in elements
        for effect, wish in wishes[name].items()
        if wish.kind == "range" and wish.low
    )
    most = sum(map(len, wishes.values()))
    kept = tuple(levels.count(rank) - missed * most for rank in task.ranks)
    objective = CutoffObjective(kept=kept, value=value_of(task, problem, sizes))
    return Tuned(objective=objective, problem=problem, optimum=optimum)


def value_of(task: DesignTask, problem: Problem, sizes: FloatArray) -> float:
    """The sum of the logarithms of steps, weighed by rank."""
    value = 0.0
    for u, size in zip(problem.unknowns, sizes.tolist(), strict=bool(sizes.size)):
        if not u.settled:
            weight = u.weight * _NEXT_RANK ** task.ranks.index(u.level)
            # Steps of a wanted value count as all there is to reach.
            goal = u.steps(u.high) if u.wish.kind == "value" else 1.0
            value += weight * float(np.log(u.steps(size) / goal))
    return value
