"""Filter cut-offs where a scene leaves them free: as little filtering as does nearly as well.

One file: one search along two axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

from tune.documents.effects import EffectName
from tune.loop.filters import Filters
from tune.optimisation.cutoff_axis import COARSE, CutoffAxis
from tune.optimisation.cutoff_objective import (
    CutoffObjective,
    Tuned,
    ranks_of,
    slope_of,
    tune_all_effects,
    tune_with_filters,
)
from tune.optimisation.cutting_planes import maximise
from tune.optimisation.problem import DesignTask
from tune.optimisation.solve import groups

#: A search ends where no more than this, in the logarithm of the product, can be gained.
_SAME = 1e-3
#: This little is given for less filtering.
_GOOD_ENOUGH = 2e-3
#: Step on the logarithmic scale of cut-offs over which a slope is taken.
_STEP = 1e-4
#: Two worths that differ by less, by rounding or by where a solver ends, are one.
_TIED = 1e-6


def choose_filters(task: DesignTask, say: Callable[[str], None]) -> Filters:
    """The fixed cut-offs, and for free ones the least filtering that does nearly as well as any.

    What a cut-off is worth is told by `cutoff_objective`, for all elements together. Free cut-offs
    are looked for coarsely, one after the other in both orders, then together by cutting planes, on
    a logarithmic scale above which there is no filter.
    A filter is only there for an effect that uses it: without a damper no velocity filter, without
    a virtual mass no acceleration filter.
    """
    scene = task.scene
    wishes = {effect for element in scene.elements.values() for effect in element.wishes()}
    windowed = scene.loop.velocity_window_samples if "damping" in wishes else None
    kind = Filters(
        velocity_filter_order=scene.loop.velocity_filter_order,
        acceleration_filter_order=scene.loop.acceleration_filter_order,
        filter_damping_ratio=scene.loop.filter_damping_ratio,
        velocity_window_samples=windowed,
    )
    nyquist = 0.5 / task.device.sample_time.high
    with_velocity = "damping" in wishes and windowed is None
    velocity = scene.loop.velocity_filter_hz if with_velocity else "none"
    acceleration = scene.loop.acceleration_filter_hz if "mass" in wishes else "none"
    search = _Search(
        task=task,
        kind=kind,
        say=say,
        axes=(
            CutoffAxis.of(
                velocity if "damping" in wishes and windowed is None else "none", nyquist
            ),
            CutoffAxis.of(acceleration if "mass" in wishes else "none", nyquist),
        ),
    )
    return search.best()


@dataclass(slots=True, kw_only=True)
class _Search:
    """Filters that were tried, and what they are worth.

    Attributes:
        task: what is tuned.
        kind: order, damping ratio and window of the filters.
        say: called before each try.
        axes: choices of the velocity and the acceleration filter.
        tried: worth of all elements.
        known: each group as tuned by the filters that it uses.
        last: each group as it was tuned last.
        whole: whether all effects of each group are kept, by the filters that it uses.
        asked: effects of each group that uses a filter.
    """

    task: DesignTask
    kind: Filters
    say: Callable[[str], None]
    axes: tuple[CutoffAxis, CutoffAxis]
    tried: dict[Filters, CutoffObjective] = field(default_factory=dict[Filters, CutoffObjective])
    known: dict[tuple[tuple[str, ...], Filters], Tuned] = field(
        default_factory=dict[tuple[tuple[str, ...], Filters], Tuned]
    )
    last: dict[tuple[str, ...], Tuned] = field(default_factory=dict[tuple[str, ...], Tuned])
    whole: dict[tuple[tuple[str, ...], Filters], bool] = field(
        default_factory=dict[tuple[tuple[str, ...], Filters], bool]
    )
    asked: dict[tuple[str, ...], frozenset[EffectName]] = field(
        init=False, default_factory=dict[tuple[str, ...], frozenset[EffectName]]
    )

    def __post_init__(self) -> None:
        scene = self.task.scene
        for elements in groups(scene):
            wishes = frozenset[EffectName](
                effect for name in elements for effect in scene.elements[name].wishes()
            )
            if wishes & {"damping", "mass"}:
                self.asked[elements] = wishes

    def best(self) -> Filters:
        """The least filtering of all tried that is worth nearly as much as the best."""
        free = [index for index, axis in enumerate(self.axes) if axis.free]
        point = [axis.first[(len(axis.first) - 1) // 2] for axis in self.axes]
        if not free:
            return self._filters(point)
        if self._coupled():
            for start in self._starts(point):
                self._refined(start, free)
        else:
            for index in free:
                point = self._refined(self._along(point, index), [index])
        most = max(self.tried.values(), key=lambda each: each.order)
        enough = CutoffObjective(kept=most.kept, value=most.value - _GOOD_ENOUGH).order
        return min((f for f, worth in self.tried.items() if worth.order >= enough), key=_lag)

    def _starts(self, middle: list[float]) -> list[list[float]]:
        """Points to climb from: one cut-off after the other, in both orders.

        Where no line through the middle keeps every effect, all pairs of first choices are asked.
        """
        starts: list[list[float]] = []
        for first, then in ((1, 0), (0, 1)):
            found = self._best_whole(self._line(middle, first))
            again = found and self._best_whole(self._line(found, then))
            if again and again not in starts:
                starts.append(again)
        if starts:
            return starts
        pairs = [list(pair) for pair in product(*(axis.first[::-1] for axis in self.axes))]
        whole = self._best_whole(pairs)
        # That all effects can be kept is not always soon told.
        return [whole or _most([(self._worth(each), each) for each in pairs])]

    def _line(self, point: Sequence[float], index: int) -> list[list[float]]:
        """Points with the first choices of one cut-off, least filtering first."""
        places = reversed(self.axes[index].first)
        return [[*point[:index], place, *point[index + 1 :]] for place in places]

    def _along(self, point: Sequence[float], index: int) -> list[float]:
        """The point that is worth most among the first choices of one cut-off."""
        points = self._line(point, index)
        return self._best_whole(points) or _most([(self._worth(each), each) for each in points])

    def _best_whole(self, points: Sequence[list[float]]) -> list[float] | None:
        """The point that is worth most of those that keep every effect; None where none does."""
        whole = [(worth, each) for each in points if (worth := self._whole(each))]
        return _most(whole) if whole else None

    def _whole(self, point: Sequence[float]) -> CutoffObjective | None:
        """What all elements are worth; None where not all effects are kept, which is soon told."""
        filters = self._filters(point)
        for elements in self.asked:
            used = self._of(elements, filters)
            if (elements, used) not in self.whole:
                self._say(filters)
                found = tune_all_effects(self.task, elements, used, self.last.get(elements))
                self.whole[elements, used] = found is not None
                if found is not None:
                    self.known[elements, used] = self.last[elements] = found
            if not self.whole[elements, used]:
                return None
        return self._worth(point)

    def _say(self, filters: Filters) -> None:
        self.say(
            f"trying filters: velocity {_hertz(filters.velocity_filter_hz)}, "
            f"acceleration {_hertz(filters.acceleration_filter_hz)}"
        )

    def _coupled(self) -> bool:
        """True where elements that are tuned together use both filters, and both are free."""
        return all(axis.free for axis in self.axes) and any(
            {"damping", "mass"} <= asked for asked in self.asked.values()
        )

    def _refined(self, point: list[float], free: Sequence[int]) -> list[float]:
        """From a point to one that is worth more than all around it."""
        kept = self._worth(point).kept
        # Beyond the highest cut-off there is no filter, and nothing has a slope.
        free = [i for i in free if self.axes[i].hertz(point[i]) is not None]
        if not free:
            return point

        def whole(places: Sequence[float]) -> list[float]:
            chosen = dict(zip(free, places, strict=True))
            return [chosen.get(index, place) for index, place in enumerate(point)]

        def value(places: Sequence[float]) -> float:
            worth = self._worth(whole(places))
            return worth.value if worth.kept >= kept else -math.inf

        def slopes(places: Sequence[float]) -> list[float]:
            return [self._slope(whole(places), index) for index in free]

        ends = [(self.axes[i].first[0], self.axes[i].first[-2]) for i in free]
        start = [point[i] for i in free]
        radius = math.log(COARSE) / 2
        return whole(maximise(value, slopes, start, ends, radius=radius, gain=_SAME))

    def _slope(self, point: Sequence[float], index: int) -> float:
        """Slope of the objective by the logarithm of one cut-off."""
        here = self._filters(point)
        name = ("velocity_filter_hz", "acceleration_filter_hz")[index]
        hertz: float = getattr(here, name)
        step = -_STEP if math.log(hertz) + _STEP > self.axes[index].first[-2] else _STEP
        there = replace(here, **{name: hertz * math.exp(step)})
        total = 0.0
        for elements in self.asked:
            filters, moved = (self._of(elements, each) for each in (here, there))
            if filters != moved:
                total += slope_of(self.task, self._tuned(elements, filters), moved)
        return total / step

    def _worth(self, point: Sequence[float]) -> CutoffObjective:
        filters = self._filters(point)
        if filters not in self.tried:
            self._say(filters)
            total = CutoffObjective(kept=(0,) * len(ranks_of(self.task)), value=0.0)
            for elements in self.asked:
                total = total.plus(self._tuned(elements, self._of(elements, filters)).worth)
            self.tried[filters] = total
        return self.tried[filters]

    def _of(self, elements: tuple[str, ...], filters: Filters) -> Filters:
        """Those of the filters that a group uses."""
        if "damping" not in self.asked[elements]:
            filters = replace(filters, velocity_filter_hz=None)
        if "mass" not in self.asked[elements]:
            filters = replace(filters, acceleration_filter_hz=None)
        return filters

    def _tuned(self, elements: tuple[str, ...], filters: Filters) -> Tuned:
        """One group; known if it was tried before with the filters that it uses."""
        if (elements, filters) not in self.known:
            found = tune_with_filters(self.task, elements, filters, self.last.get(elements))
            self.known[elements, filters] = self.last[elements] = found
        return self.known[elements, filters]

    def _filters(self, point: Sequence[float]) -> Filters:
        velocity, acceleration = (
            axis.hertz(place) for axis, place in zip(self.axes, point, strict=True)
        )
        return replace(self.kind, velocity_filter_hz=velocity, acceleration_filter_hz=acceleration)


def _most(found: Sequence[tuple[CutoffObjective, list[float]]]) -> list[float]:
    """The first of the points that are worth most; they tie where a cut-off changes nothing."""
    most = max((worth for worth, _ in found), key=lambda each: each.order)
    enough = CutoffObjective(kept=most.kept, value=most.value - _TIED).order
    return next(point for worth, point in found if worth.order >= enough)


def _lag(filters: Filters) -> float:
    """How much is filtered: a measure of the lag of both estimates, s."""
    return sum(
        1 / hertz for hertz in (filters.velocity_filter_hz, filters.acceleration_filter_hz) if hertz
    )


def _hertz(cutoff: float | None) -> str:
    return "none" if cutoff is None else f"{cutoff:g} Hz"
