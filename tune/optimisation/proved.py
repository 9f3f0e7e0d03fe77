"""Groups of a scene tuned one after the other, and the filters that leave most once proved."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tune.documents.scene import Effects
from tune.loop.loop import Filters, used_filters
from tune.optimisation.feasibility import feasible_points, largest_allowed
from tune.optimisation.limits import Unknown
from tune.optimisation.nash import Solution
from tune.optimisation.problem import CutoffAxis, DesignTask
from tune.optimisation.saturation import prove_combinations
from tune.optimisation.solve import CutoffObjective, groups, rank_of, solve, worth_of

Progress = Callable[[str], None]

#: Choices of filters whose clamps are proved in turn.
MOST_PROVED = 4
#: The cut-off of the velocity is raised by this factor, for walls so many times at first.
_LESS_LAG, _RAISED = 1.25, 2
#: A pair that had to be told apart counts as half of the product.
_APART = math.log(2)
#: What a proof held back is raised by no less than this part, up to so little below its limit, and
#: so often halved until it holds.
_LEAST_RAISE, _BELOW, _HALVINGS = 0.02, 1e-5, 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Proved:
    """What some filters leave once clamps are proved."""

    choice: Filters  # of which the filters are, with a cut-off of the velocity that was raised
    raised: int  # so many times
    filters: Filters
    task: DesignTask  # with the pairs that had to be told apart
    solutions: list[Solution]  # the largest effects of every group
    # what is kept, and the logarithm of the product less what pairs apart count
    worth: CutoffObjective
    held_back: bool  # whether proofs leave less than linear limits do


def best_proved(
    task: DesignTask,
    choices: Sequence[tuple[Filters, CutoffObjective]],
    known: dict[Filters, Proved],
    say: Progress,
) -> Proved:
    """The filters that leave most once clamps are proved, and the largest effects with them.

    Choices come with what they are worth at most, the best first. Walls are proved larger with less
    lag than is best for linear limits: the cut-off of the velocity is raised as long as proofs hold
    them back. What is known of this task is not solved again, and what is found is added to it.
    """

    def proved(choice: Filters, raised: int) -> Proved:
        filters = _with_less_lag(task, choice, raised)
        if filters in known:
            return replace(known[filters], choice=choice, raised=raised)
        less, solutions = solve_groups(task, filters, say)
        filtered = [
            s for s in solutions if any(u.effect != "stiffness" for u in s.problem.unknowns)
        ]
        worth = worth_of(task, filtered)
        known[filters] = Proved(
            choice=choice,
            raised=raised,
            filters=filters,
            task=less,
            solutions=solutions,
            worth=worth._replace(value=worth.value - _APART * len(less.apart)),
            held_back=less != task or any(each.stepped_back for each in filtered),
        )
        return known[filters]

    best = proved(choices[0][0], 0)
    raised = _RAISED if best.held_back and task.scene.walls else 0
    for choice, bound in choices[:MOST_PROVED]:
        if bound <= best.worth:
            break
        best = max(best, proved(choice, raised), key=lambda each: each.worth)
    way = 1 if best.held_back else -1
    while not best.task.apart and best.raised + way >= 0:
        found = proved(best.choice, best.raised + way)
        if found.worth <= best.worth:
            break
        best = found
        if way < 0 and found.held_back:
            break
    return best


def _with_less_lag(task: DesignTask, filters: Filters, times: int) -> Filters:
    """Filters with a free cut-off of the velocity raised so many times, none beyond the highest."""
    axis = CutoffAxis.of(task.scene.loop.velocity_filter_hz, 0.5 / task.device.sample_time.high)
    hertz = filters.velocity_filter_hz
    if hertz is None or not axis.free or not times:
        return filters
    place = axis.place(hertz) + times * math.log(_LESS_LAG)
    raised = replace(filters, velocity_filter_hz=axis.hertz(place))
    return used_filters(raised, Effects(damping=0.0, mass=0.0))


def solve_groups(
    task: DesignTask, filters: Filters, say: Progress
) -> tuple[DesignTask, list[Solution]]:
    """The task, with the pairs told apart that need it, and the largest effects of every group."""
    found: dict[tuple[str, ...], Solution] = {}
    usual = order = groups(task.scene)
    while len(found) < len(order):
        elements = order[len(found)]
        say(f"tuning {', '.join(elements)} ({len(found) + 1} of {len(order)})")
        solved = solve(task, elements, filters, [*found.values()])
        if solved.clash is None:
            found[elements] = solved
            less = task.without_lost_walls(solved.dropped)
            if less is not None:
                task, found, order = less, {}, usual
            continue
        # A wall and an element that are not proved together are told apart where the element cannot
        # leave room for the wall.
        wall, other = solved.clash
        before, task = task, task.with_room_for(wall, other) or task.without(solved.clash)
        if before.parts != task.parts:  # tuned anew from the first that has more room, or less
            first = next(n for n, each in enumerate(order) if other in each)
            found = {each: found[each] for each in order[:first]}
            # Walls of one priority are not met with each other: those that are settled wait.
            rank = rank_of(task.scene, elements)
            place = next(n for n, each in enumerate(order) if rank_of(task.scene, each) == rank)
            order = (*order[:place], elements, *(e for e in order[place:] if e != elements))
    return task, [found[each] for each in usual]


def with_room_regained(solutions: Sequence[Solution]) -> list[Solution]:
    """Solutions in which each size that a proof held back is as large as its proof allows."""
    # All that are met were made smaller together, until what moves least was proved. Elements, that
    # of the fewest steps first, then their effects one by one are raised as far as the limits and
    # the multipliers at hand go, and again where that left room.
    found, before = list(solutions), list[Solution]()
    while found is not before:
        before = found
        for place, solved in enumerate(before):
            units = {index: solved.problem.unknowns[index] for index in solved.stepped_back}
            steps = {index: units[index].steps(float(found[place].sizes[index])) for index in units}
            alone = [(index,) for index in sorted(units, key=steps.__getitem__)]
            names = dict.fromkeys(units[index].element for (index,) in alone)
            whole = [tuple(i for i in units if units[i].element == name) for name in names]
            for indices in [each for each in whole if len(each) > 1] + alone:
                found = _raised(found, place, indices)
    return found


def _raised(solutions: list[Solution], place: int, indices: Sequence[int]) -> list[Solution]:
    """The solutions with some sizes of one larger by the same factor, as far as they are proved."""
    found, own = solutions, solutions[place]
    sizes = {index: float(own.sizes[index]) for index in indices}
    ends = [largest_allowed(own.problem, own.sizes, index) / sizes[index] for index in indices]
    low, trial = 1.0, 1 + _LEAST_RAISE
    high = most = min(ends) * (1 - _BELOW)
    for number in range(_HALVINGS):
        if not low < trial <= most:
            break
        larger = {own.problem.unknowns[index]: size * trial for index, size in sizes.items()}
        raised = _proved_with(found, larger)
        if raised is not None:
            found, low = raised, trial
        elif number:
            high = trial
        else:
            break
        trial = math.sqrt(low * high) if number else most
    return found


def _proved_with(
    solutions: Sequence[Solution], larger: Mapping[Unknown, float]
) -> list[Solution] | None:
    """The solutions with other sizes of some effects, if the multipliers at hand prove them all."""
    rounded = {
        u.label: u.high if size > u.high * (1 - 2 * _BELOW) else u.rounded_at(u.steps(size))
        for u, size in larger.items()
    }
    found = [*solutions]
    for place, solved in enumerate(solutions):
        labels = [each.label for each in solved.problem.unknowns]
        if not solved.sizes.size or rounded.keys().isdisjoint(labels):
            continue
        pairs = zip(labels, solved.sizes.tolist(), strict=True)
        sizes = np.array([rounded.get(label, size) for label, size in pairs])
        if not feasible_points(solved.problem, sizes[None])[0]:
            return None
        absolute = prove_combinations(solved.problem, sizes, solved.absolute, ())
        if any(one.gain < solved.problem.proved_gain for one in absolute.values()):
            return None
        found[place] = replace(solved, sizes=sizes, absolute=absolute)
    return found
