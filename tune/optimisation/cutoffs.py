"""Filter cut-offs where a scene leaves them free: as little filtering as does nearly as well."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from tune.documents.estimators import DERIVATIVES, filter_of
from tune.documents.scene import EffectName, Effects
from tune.loop.loop import Filters, used_filters
from tune.optimisation.backends import climb
from tune.optimisation.feasibility import largest_allowed, least_beside
from tune.optimisation.limits import Unknown
from tune.optimisation.problem import (
    COARSE,
    CutoffAxis,
    DesignTask,
    may_saturate,
    problem_of,
)
from tune.optimisation.solve import (
    CutoffObjective,
    Tuned,
    groups,
    tune_with_filters,
)

#: The two cut-offs, and the effect that uses each.
_CUTOFFS, _USES = ("velocity_filter_hz", "acceleration_filter_hz"), ("damping", "mass")
#: Hills this much lower than the highest are climbed too: between first choices as much may lie.
_LESS = 0.25
#: Acceleration filters this much worse may yet be the best with another velocity filter.
_FAMILY = 0.6
#: So many starts are climbed from, the best, one of a kind, and so many of them with one kind of
#: acceleration filter.
_CLIMBED, _ALIKE = 5, 3
#: A search ends where no more than this, in the logarithm of the product, can be gained.
_SAME = 2e-3
#: Step of the logarithm of a cut-off at which what is best is looked around in the end.
_AROUND = 0.05
#: Part of it that counts where effects of a second rank tell kinds apart.
_FINER = 0.5
#: This little is given for less filtering.
_GOOD_ENOUGH = 2e-3
#: Cut-offs that are nearer than this in the logarithm are not told apart by a climb.
_APART = 0.01
#: Two objectives that differ by less, by rounding or by where a solver ends, are one.
_TIED = 1e-6
#: Cut-offs that are looked at where no effect can have a step.
_FINE = 24


def choose_filters(
    task: DesignTask, say: Callable[[str], None]
) -> list[tuple[Filters, CutoffObjective]]:
    """The fixed filters, and for free ones the least filtering that does nearly as well as any.

    Free cut-offs are looked for coarsely, for all elements together, one after the other in both
    orders, then together by a simplex that walks, on a logarithmic scale above which there is none;
    free kinds likewise. A filter is there for an effect that uses it only: the velocity's for a
    damper, the other for a mass. What cannot be kept with the best of all that is left out once
    more, and looked for without it: first what its element cannot keep by itself. The best of other
    kinds follow, each with what groups that use filters are worth with it at most: nothing is
    proved here.
    """
    done = frozenset(dict(task.left_out))
    search = _search_of(task, say, done)
    best = search.best()
    for alone in (True, False):
        left_out = search.left_out(best)
        gone = done | (_hopeless(task, say, left_out - done) if alone else left_out)
        if gone == done or not (fewer := _search_of(task, say, gone)).free:
            continue
        found, done = fewer.best(), gone
        axes = zip(DERIVATIVES, search.axes, fewer.axes, strict=True)
        idle = [which for which, mine, its in axes if mine.used and not its.used]
        names = [f"{which}_filter{end}" for which in idle for end in ("", "_hz", "_order")]
        used = (filter_of(found, which) for which in DERIVATIVES if which not in idle)
        names += ["filter_damping_ratio"] * all(each.order < 2 for each in used)
        found = replace(found, **{name: getattr(best, name) for name in names})
        best = search.better(found, best)
    return search.ranked(best)


def _hopeless(
    task: DesignTask, say: Callable[[str], None], left_out: frozenset[str]
) -> frozenset[str]:
    """Those of some labels that are not kept where nothing but their element is looked for."""
    elements = task.scene.elements
    if len(elements) == 1:  # nothing else was looked for
        return left_out
    every = [(name, f"{name}.{effect}") for name in elements for effect in elements[name].wishes()]
    found = set[str]()
    for mine in dict.fromkeys(name for name, label in every if label in left_out):
        search = _search_of(task, say, frozenset(label for name, label in every if name != mine))
        own = {label for name, label in every if name == mine}
        found |= own & search.left_out(search.best())
    return left_out & found


def _search_of(
    task: DesignTask, say: Callable[[str], None], gone: frozenset[str] = frozenset()
) -> _Search:
    """The search for filters of all effects but those that are gone, by label."""
    loop, elements = task.scene.loop, task.scene.elements
    wishes = {
        effect
        for name, element in elements.items()
        for effect in element.wishes()
        if f"{name}.{effect}" not in gone
    }
    windowed = loop.velocity_window_samples if "damping" in wishes else None
    nyquist = 0.5 / task.device.sample_time.high
    with_velocity = "damping" in wishes and windowed is None
    velocity = loop.velocity_filter_hz if with_velocity else "none"
    acceleration = loop.acceleration_filter_hz if "mass" in wishes else "none"
    axes = CutoffAxis.of(velocity, nyquist), CutoffAxis.of(acceleration, nyquist)
    there = [1.0 if axis.used else None for axis in axes]
    kinds: dict[Filters, None] = {}
    for ratio, pair in product(loop.ratios(), product(*map(loop.kinds, DERIVATIVES))):
        settings: dict[str, Any] = {"velocity_window_samples": windowed}
        for which, (kind, order), hertz in zip(DERIVATIVES, pair, there, strict=True):
            settings |= {f"{which}_filter": kind, f"{which}_filter_order": order}
            settings[f"{which}_filter_hz"] = hertz
        filters = Filters(**settings, filter_damping_ratio=ratio)
        kinds[_kind_of(used_filters(filters, Effects(damping=0.0, mass=0.0)))] = None
    return _Search(task, list(kinds), axes, say, gone)


class _Search:
    """Filters that were tried, and what they are worth."""

    def __init__(
        self,
        task: DesignTask,
        kinds: Sequence[Filters],
        axes: tuple[CutoffAxis, CutoffAxis],
        say: Callable[[str], None],
        gone: frozenset[str],
    ) -> None:
        #: Orders, damping ratio and window of filters are those of one of these kinds, the usual
        #: first; the axes are the choices of the velocity and the acceleration filter.
        self.task, self.kinds, self.axes, self.say = task, kinds, axes, say
        #: Labels of effects that are not looked for.
        self.gone = gone
        self.free = [index for index, axis in enumerate(axes) if axis.free]
        #: Of what ends a search: kinds are told apart by effects of the second rank as well.
        self.unit = _FINER if len(kinds) > 1 and len(task.ranks) > 1 else 1.0
        #: Of what is looked at.
        self.kind = kinds[0]
        #: Worth of all elements.
        self.tried: dict[Filters, CutoffObjective] = {}
        #: Each group as tuned by the filters that it uses, and as it was tuned last.
        self.known: dict[tuple[tuple[str, ...], Filters], Tuned] = {}
        self.last: dict[tuple[str, ...], Tuned] = {}
        #: Whether all effects of each group are kept, by the filters that it uses.
        self.keeps_all: dict[tuple[tuple[str, ...], Filters], bool] = {}
        #: Effects of each group that uses a filter, and how many of them over all its elements.
        self.wished: dict[tuple[str, ...], int] = {}
        self.asked: dict[tuple[str, ...], frozenset[EffectName]] = {}
        #: Those of some filters that some effects use.
        self.used: dict[tuple[frozenset[EffectName], Filters], Filters] = {}
        elements = task.scene.elements
        for group in groups(task.scene):
            wishes: list[EffectName] = [
                e for name in group for e in elements[name].wishes() if f"{name}.{e}" not in gone
            ]
            if "damping" in wishes or "mass" in wishes:
                self.asked[group], self.wished[group] = frozenset(wishes), len(wishes)

    def best(self) -> Filters:
        """The least filtering that is worth nearly as much as the best that is found."""
        free = self.free
        point = [axis.first[(len(axis.first) - 1) // 2] for axis in self.axes]
        if not free:
            return self._filters(point)
        starts = sorted(self._starts(point, free), key=self.tried.__getitem__, reverse=True)
        climbed: dict[Filters, object] = {}
        for start in starts:
            kind = _kind_of(start)
            family = filter_of(start, "acceleration")[::2], start.filter_damping_ratio
            alike = [*climbed.values()].count(family)
            if kind not in climbed and alike < _ALIKE and len(climbed) < _CLIMBED:
                self._refined(self._place(start), free)
                climbed[kind] = family
        if len(self.kinds) > 1:
            self._polish()
        best = self._least_good()
        # A filter that no kept effect uses tells why there is none, or is found where few suit.
        for index in [each for each in free if not self._is_used(best, each)]:
            near = (_kind_of(best), *self._kinds_beside(best, index))
            nearest = [self._nearest(best, index, kind) for kind in near]
            nearest.sort(key=lambda pair: -pair[0])
            kept = self._objective(self._place(best)).kept
            for reached, found in nearest:
                if reached >= 1 and self._objective(self._place(found)).kept > kept:
                    self._refined(self._place(found), [index])
                    if 1 - index in free:
                        self._refine_others(1 - index)
                    break
            after = self._least_good()
            best = after if self._is_used(after, index) else nearest[0][1]
        return best

    def _refine_others(self, index: int) -> None:
        """Climb from the best of the kinds that differ from the best in one filter."""
        start = self._least_good()
        beside = self._kinds_beside(start, index)
        found = [each for kind in beside for each in self._uphill(kind, start, index)]
        if found:
            self._refined(self._place(max(found, key=self.tried.__getitem__)), self.free)

    def left_out(self, filters: Filters) -> frozenset[str]:
        """Labels of the effects that are not kept with some filters."""
        if not self.free:
            return frozenset()
        self._objective(self._place(filters))
        kept = {unknown.label for unknown in self._kept(filters)}
        elements = self.task.scene.elements
        asked = (f"{e}.{f}" for group in self.asked for e in group for f in elements[e].wishes())
        return frozenset(asked) - kept

    def better(self, filters: Filters, best: Filters) -> Filters:
        """Some filters where they are worth more than the best, or the best."""
        mine, its = (self._objective(self._place(each)) for each in (filters, best))
        enough = CutoffObjective(kept=its.kept, value=its.value + _GOOD_ENOUGH * self.unit)
        return filters if mine > enough else best

    def ranked(self, best: Filters) -> list[tuple[Filters, CutoffObjective]]:
        """The best filters, then those of each other kind that keep as much."""
        if not self.free:
            return [(best, CutoffObjective(kept=(), value=0.0))]
        most = self._objective(self._place(best))
        found: dict[Filters, Filters] = {}
        for filters in (best, *sorted(self.tried, key=self.tried.__getitem__, reverse=True)):
            if self.tried[filters].kept == most.kept:
                damping, mass = (0.0 if self._is_used(filters, i) else None for i in (0, 1))
                used = used_filters(filters, Effects(damping=damping, mass=mass))
                found.setdefault(_kind_of(used), filters)
        return [(each, self.tried[each]) for each in found.values()]

    def _least_good(self) -> Filters:
        """The first kind, and least filtering of it, that is worth nearly as much as the best."""
        most = max(self.tried.values())
        enough = CutoffObjective(kept=most.kept, value=most.value - _GOOD_ENOUGH * self.unit)
        good = [filters for filters, objective in self.tried.items() if objective >= enough]

        def lag(each: Filters) -> float:
            """How much is filtered: a measure of the lag of both estimates, s."""
            return sum(1 / hertz for name in _CUTOFFS if (hertz := getattr(each, name)))

        return min(good, key=lambda each: (self.kinds.index(_kind_of(each)), lag(each)))

    def _place(self, filters: Filters) -> list[float]:
        """Where filters are on both axes, of whose kind are those that are looked at from now."""
        self.kind = _kind_of(filters)
        cutoffs = (getattr(filters, name) for name in _CUTOFFS)
        return [axis.place(each) for axis, each in zip(self.axes, cutoffs, strict=True)]

    def _is_used(self, filters: Filters, index: int) -> bool:
        """Whether an effect that is kept uses one of the filters."""
        return any(unknown.effect == _USES[index] for unknown in self._kept(filters))

    def _kept(self, filters: Filters) -> list[Unknown]:
        """The effects that are kept with some filters, which were tried."""
        tuned = (self.known[elements, self._of(elements, filters)] for elements in self.asked)
        kept = (each.problem for each in tuned if each.optimum.sizes is not None)
        return [unknown for problem in kept for unknown in problem.unknowns]

    def _nearest(self, filters: Filters, index: int, kind: Filters) -> tuple[float, Filters]:
        """How near to a step an effect comes with one filter chosen anew, and both filters."""
        cutoffs = {name: getattr(filters, name) for name in _CUTOFFS}
        point = self._place(replace(kind, **cutoffs))
        low, *_, high, beyond = self.axes[index].first
        places = beyond, *np.linspace(low, high, _FINE, endpoint=False).tolist()
        line = [[*point[:index], place, *point[index + 1 :]] for place in places]
        found = [(self._reached(each, index), self._filters(each)) for each in line]
        return max(found, key=lambda pair: pair[0])

    def _reached(self, point: Sequence[float], index: int) -> float:
        """How much of a step an effect has that uses one of the filters, but for springs alone."""
        filters, most = self._filters(point), 0.0
        for elements in (each for each, wishes in self.asked.items() if _USES[index] in wishes):
            cut, used = may_saturate(self.task, elements), self._of(elements, filters)
            problem = problem_of(self.task, elements=elements, filters=used, cut=cut)
            for place, unknown in enumerate(problem.unknowns):
                if unknown.effect == _USES[index]:
                    size = largest_allowed(problem, least_beside(problem), place)
                    most = max(most, unknown.steps(size))
        return most

    def _starts(self, middle: list[float], free: Sequence[int]) -> list[Filters]:
        """Filters to climb from: one cut-off after the other, in both orders from the middle."""
        # Where no line through the middle keeps every effect, all pairs of first choices are asked,
        # then lines of further kinds. Then kinds of one filter after the other, near the best.
        starts: dict[Filters, None] = {}
        pairs = [list(pair) for pair in product(*(axis.first[::-1] for axis in self.axes))]
        for kind in self.kinds:
            self.kind = kind
            for *before, last in [free, free[::-1]][: len(free)]:
                found = self._best_keeping_all(self._line(middle, before[0])) if before else middle
                starts |= dict.fromkeys(self._hills(self._line(found, last)) if found else ())
            if not starts and kind == self.kinds[0] and (found := self._best_keeping_all(pairs)):
                starts[self._filters(found)] = None
            if starts:
                break
        else:
            # That all effects can be kept is not always soon told.
            self.kind = self.kinds[0]
            for index in (*free, free[0]):
                line = self._line(middle, index)
                middle = _most([(self._objective(each), each) for each in line])
            return [self._filters(middle)]
        for index in reversed(free) if len(self.kinds) > 1 else ():
            ordered = sorted(starts, key=self.tried.__getitem__)
            enough = self.tried[ordered[-1]].value - _FAMILY
            for start in {_kind_of(each): each for each in ordered}.values():
                if self.tried[start].value >= enough:
                    for kind in self._kinds_beside(start, index):
                        starts |= dict.fromkeys(self._uphill(kind, start, index))
        usual = [each for each in starts if _kind_of(each) == self.kinds[0]]
        good: list[Filters] = []
        for some in ([*starts], usual):
            enough = max((self.tried[each].value for each in some), default=0.0) - _LESS
            good += [each for each in some if self.tried[each].value >= enough]
        return list(dict.fromkeys(good))

    def _line(self, point: Sequence[float], index: int) -> list[list[float]]:
        """Points with the first choices of one cut-off, least filtering first."""
        places = reversed(self.axes[index].first)
        return [[*point[:index], place, *point[index + 1 :]] for place in places]

    def _kinds_beside(self, filters: Filters, index: int) -> list[Filters]:
        """Kinds that are another one in one filter alone, the damping ratio the one of both."""
        mine, other = _kind_of(filters), DERIVATIVES[1 - index]
        kept = filter_of(mine, other)[::2]
        same = [kind for kind in self.kinds if filter_of(kind, other)[::2] == kept]
        # The ratio goes with the acceleration filter where that is chosen too and has two poles.
        if index == 0 and self.axes[1].free and mine.acceleration_filter_order > 1:
            # Of one ratio the cut-off may be another one for the same kind as well.
            return [kind for kind in same if kind.filter_damping_ratio == mine.filter_damping_ratio]
        return [kind for kind in same if kind != mine]

    def _uphill(self, kind: Filters, filters: Filters, index: int) -> Iterator[Filters]:
        """Those of a kind, if any, that keep every effect, uphill along one axis from near others.

        Where none do near them, on the line across. A velocity filter may have several hills.
        """
        point, step = self._place(filters), math.log(COARSE) / 3
        self.kind = kind
        near = [self._beside(point, index, count * step) for count in (0, -1, 1, -2, 2, -3, 3)]
        hills = list(self._hills(self._line(near[0], index))) if index == 0 else []
        if hills:
            yield from hills
            return

        def value(point: list[float]) -> float:
            objective = self._objective_of_all(point)
            return -math.inf if objective is None else objective.value

        # That one is not kept is soon told, so it is looked farther for where all are.
        kept = (each for each in near if self._objective_of_all(each))
        point = next(kept, None) or self._best_keeping_all(self._line(near[0], 1 - index))
        if point is not None:
            for way in (-1, 1):
                # Far out a filter hardly matters any more.
                strides = (way * step * 2**count for count in range(8))
                further = self._beside(point, index, next(strides))
                while value(further) > value(point) + _TIED:
                    point, further = further, self._beside(further, index, next(strides))
            yield self._filters(point)

    def _beside(self, point: list[float], index: int, way: float) -> list[float]:
        """A point so far along one axis, as far as there are filters."""
        return [*point[:index], self.axes[index].moved(point[index], way), *point[index + 1 :]]

    def _hills(self, line: Sequence[list[float]]) -> Iterator[Filters]:
        """Filters of a line, the first without one, that keep all, worth what those beside are."""
        objectives = [self._objective_of_all(each) for each in line]
        values = [-math.inf if objective is None else objective.value for objective in objectives]
        # No filter is beside no other.
        before, after = [-math.inf, -math.inf, *values[1:]], [-math.inf, *values[2:], -math.inf]
        for point, value, *others in zip(line, values, before, after, strict=False):
            if math.isfinite(value) and value >= max(others):
                yield self._filters(point)

    def _best_keeping_all(self, points: Sequence[list[float]]) -> list[float] | None:
        """The point that is worth most of those that keep every effect; None where none does."""
        good = [(reached, each) for each in points if (reached := self._objective_of_all(each))]
        return _most(good) if good else None

    def _objective_of_all(self, point: Sequence[float]) -> CutoffObjective | None:
        """What all elements are worth; None where not all effects are kept, which is soon told."""
        filters = self._filters(point)
        for elements in self.asked:
            used = self._of(elements, filters)
            if (elements, used) not in self.keeps_all:
                self._say(filters)
                last, wished = self.last.get(elements), self.wished[elements]
                found = tune_with_filters(
                    self.task, elements, used, last, choosing=False, gone=self.gone
                )
                self.keeps_all[elements, used] = sum(found.objective.kept) == wished
                if self.keeps_all[elements, used]:
                    self.known[elements, used] = self.last[elements] = found
            if not self.keeps_all[elements, used]:
                return None
        return self._objective(point)

    def _say(self, filters: Filters) -> None:
        velocity, acceleration = (filter_of(filters, which) for which in DERIVATIVES)
        self.say(f"trying filters: velocity {velocity}, acceleration {acceleration}")

    def _refined(self, point: list[float], free: Sequence[int]) -> None:
        """Try points from one on to one that is worth more than all around it."""
        kept = self._objective(point).kept
        every = sum(kept) == sum(self.wished.values())
        # Beyond the highest cut-off there is no filter, and nothing to climb.
        free = [i for i in free if self.axes[i].hertz(point[i]) is not None]
        if not free:
            return

        def on_axes(places: Sequence[float]) -> list[float]:
            chosen = dict(zip(free, places, strict=True))
            return [chosen.get(index, place) for index, place in enumerate(point)]

        def value(places: Sequence[float]) -> float:
            # That not all are kept is soon told; which of them is not asked where all can be.
            reached = (self._objective_of_all if every else self._objective)(on_axes(places))
            return reached.value if reached and reached.kept >= kept else -math.inf

        ends = [(self.axes[i].first[0], self.axes[i].first[-2]) for i in free]
        start = [point[i] for i in free]
        known = max(worth.value for worth in self.tried.values() if worth.kept >= kept)
        stride, gain = math.log(COARSE) / 2, _SAME * self.unit / 2
        found = climb(value, start, ends, stride=stride, gain=gain, apart=_APART, known=known)
        # Where a cut-off ends at the highest, none at all may be worth more.
        highest = [self.axes[i].first[-2:] for i in free]
        value([none if at >= top else at for at, (top, none) in zip(found, highest, strict=True)])

    def _polish(self) -> None:
        """Move the best filters as long as some around them are worth more (compass search)."""
        # A ridge that bends ends a climb before its highest point.
        most = max(self.tried, key=self.tried.__getitem__)
        best, here = self.tried[most], self._place(most)
        every = sum(best.kept) == sum(self.wished.values())
        moved = True
        while moved:
            enough = CutoffObjective(best.kept, best.value + _SAME * self.unit / 2)
            around = [here]
            for index in self.free:
                around += [
                    self._beside(p, index, way) for p in around for way in (-_AROUND, _AROUND)
                ]
            found = [
                (reached, point)
                for point in around
                if (reached := (self._objective_of_all if every else self._objective)(point))
                and reached > enough
            ]
            moved = bool(found)
            best, here = max([*found, (best, here)])

    def _objective(self, point: Sequence[float]) -> CutoffObjective:
        filters = self._filters(point)
        if filters not in self.tried:
            self._say(filters)
            total = CutoffObjective(kept=(0,) * len(self.task.ranks), value=0.0)
            for elements in self.asked:
                total = total.plus(self._tuned(elements, self._of(elements, filters)).objective)
            self.tried[filters] = total
        return self.tried[filters]

    def _of(self, elements: tuple[str, ...], filters: Filters) -> Filters:
        """Those of the filters that a group uses."""
        used = self.asked[elements]
        if (used, filters) not in self.used:
            acting = Effects(**dict.fromkeys(used, 0.0))
            self.used[used, filters] = used_filters(filters, acting)
        return self.used[used, filters]

    def _tuned(self, elements: tuple[str, ...], filters: Filters) -> Tuned:
        """One group; known if it was tried before with the filters that it uses."""
        if (elements, filters) not in self.known:
            last = self.last.get(elements)
            found = tune_with_filters(self.task, elements, filters, last, gone=self.gone)
            self.known[elements, filters] = self.last[elements] = found
            if sum(found.objective.kept) == self.wished[elements]:  # though not soon told before
                self.keeps_all[elements, filters] = True
        return self.known[elements, filters]

    def _filters(self, point: Sequence[float]) -> Filters:
        velocity, acceleration = (
            axis.hertz(place) for axis, place in zip(self.axes, point, strict=True)
        )
        return replace(self.kind, velocity_filter_hz=velocity, acceleration_filter_hz=acceleration)


def _most(found: Sequence[tuple[CutoffObjective, list[float]]]) -> list[float]:
    """The first of the points that are worth most; they tie where a cut-off changes nothing."""
    most = max(objective for objective, _ in found)
    enough = CutoffObjective(kept=most.kept, value=most.value - _TIED)
    return next(point for objective, point in found if objective >= enough)


def _kind_of(filters: Filters) -> Filters:
    """Filters without their cut-offs."""
    return replace(filters, **dict.fromkeys(_CUTOFFS))
