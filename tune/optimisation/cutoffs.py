"""Filter cut-offs where a scene leaves them free: as little filtering as does nearly as well."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identification import rounded
from tune.documents.effects import EffectName
from tune.documents.scene import Cutoff
from tune.loop.filters import Filters
from tune.optimisation.problem import Job
from tune.optimisation.solve import groups
from tune.rendering.rendered import FASTEST

FloatArray = NDArray[np.float64]

#: Hz; a filter must pass the motions people make.
LOWEST = FASTEST
#: Ratio of neighbouring cut-offs at first. Worth changes over several octaves: where ripple limits
#: a mass it rises with each octave of filtering, until force, stability or honey makes it fall.
_COARSE = 2.0
#: A search ends where it has shrunk to this, relative, and its ends are worth the same.
_CLOSE = 0.04
#: Worth is a sum of logarithms of steps; this little of it, a thousandth of all steps multiplied,
#: is not worth another try.
_SAME = 1e-3
#: This little is given for less filtering.
_GOOD_ENOUGH = 2e-3
#: Searches for two cut-offs together, for a simplex can shrink too early on a ridge: each from
#: where the last one ended, until one gains nothing; two or three are usual.
_SEARCHES = 4
#: Tries of one search; twenty to forty are usual.
_MOST = 80
#: Digits of a written cut-off.
_DIGITS = 4


def choose_filters(job: Job, say: Callable[[str], None]) -> Filters:
    """The fixed cut-offs, and for free ones the least filtering that does nearly as well as any.

    What a cut-off is worth is told by `worth`, for all elements together. Free cut-offs are looked
    for octave by octave, one after the other, then together without derivatives, on a logarithmic
    scale above which there is no filter.
    A filter is only there for an effect that uses it: without a damper no velocity filter, without
    a virtual mass no acceleration filter.
    """
    scene = job.scene
    wishes = {effect for element in scene.elements.values() for effect in element.wishes()}
    windowed = scene.loop.velocity_window_samples if "damping" in wishes else None
    kind = Filters(
        velocity_filter_order=scene.loop.velocity_filter_order,
        acceleration_filter_order=scene.loop.acceleration_filter_order,
        filter_damping_ratio=scene.loop.filter_damping_ratio,
        velocity_window_samples=windowed,
    )
    nyquist = 0.5 / job.device.sample_time.high
    velocity, acceleration = scene.loop.velocity_filter_hz, scene.loop.acceleration_filter_hz
    search = _Search(
        job=job,
        kind=kind,
        say=say,
        axes=(
            _Axis.of(velocity if "damping" in wishes and windowed is None else "none", nyquist),
            _Axis.of(acceleration if "mass" in wishes else "none", nyquist),
        ),
    )
    return search.best()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Axis:
    """The choices of one cut-off on a logarithmic scale.

    Attributes:
        first: places to begin with, ascending; beyond the last but one there is no filter. One
            place where the cut-off is not free.
        fixed: Hz or none, where it is not free.
    """

    first: tuple[float, ...]
    fixed: float | None = None

    @classmethod
    def of(cls, cutoff: Cutoff, nyquist: float) -> _Axis:
        if cutoff != "free" or nyquist <= LOWEST:
            return cls(first=(0.0,), fixed=cutoff if isinstance(cutoff, float) else None)
        low, high = math.log(LOWEST), math.log(nyquist)
        count = math.ceil((high - low) / math.log(_COARSE))
        return cls(first=tuple(low + (high - low) * k / count for k in range(count + 2)))

    @property
    def free(self) -> bool:
        return len(self.first) > 1

    def hertz(self, place: float) -> float | None:
        """The cut-off as it is written; None for no filter."""
        if not self.free:
            return self.fixed
        low, high = self.first[0], self.first[-2]
        mirrored = low + abs(place - low)  # below the lowest nothing is flat, and no search ends
        return None if mirrored > high else rounded(math.exp(mirrored), _DIGITS)


@dataclass(slots=True, kw_only=True)
class _Search:
    """Filters that were tried, and what they are worth.

    Attributes:
        job: what is tuned.
        kind: order, damping ratio and window of the filters.
        say: called before each try.
        axes: choices of the velocity and the acceleration filter.
        tried: worth of all elements.
        known: worth of each group by the filters that it uses.
    """

    job: Job
    kind: Filters
    say: Callable[[str], None]
    axes: tuple[_Axis, _Axis]
    tried: dict[Filters, float] = field(default_factory=dict[Filters, float])
    known: dict[tuple[tuple[str, ...], Filters], float] = field(
        default_factory=dict[tuple[tuple[str, ...], Filters], float]
    )

    def best(self) -> Filters:
        """The least filtering of all tried that is worth nearly as much as the best."""
        free = [index for index, axis in enumerate(self.axes) if axis.free]
        point = [axis.first[(len(axis.first) - 1) // 2] for axis in self.axes]
        if not free:
            return self._filters(point)
        # What is looked for first is looked for again once the other cut-off is known.
        for index in free if len(free) == 1 else (1, 0, 1):
            point = max(self._octaves(point, index), key=self._worth)
        for chosen in [free] if self._coupled() else [[index] for index in free]:
            point = self._refined(point, chosen)
        enough = max(self.tried.values()) - _GOOD_ENOUGH
        return min((f for f, worth in self.tried.items() if worth >= enough), key=_lag)

    def _octaves(self, point: Sequence[float], index: int) -> list[list[float]]:
        """The point with each first choice of one cut-off, least filtering first."""
        places = reversed(self.axes[index].first)
        return [[*point[:index], place, *point[index + 1 :]] for place in places]

    def _coupled(self) -> bool:
        """True where elements that are tuned together use both filters, and both are free."""
        return all(axis.free for axis in self.axes) and any(
            {"damping", "mass"} <= self._used(elements) for elements in groups(self.job.scene)
        )

    def _used(self, elements: Sequence[str]) -> set[EffectName]:
        return {effect for name in elements for effect in self.job.scene.elements[name].wishes()}

    def _refined(self, point: list[float], free: Sequence[int]) -> list[float]:
        """From a point to one that is worth more than all around it."""
        from scipy.optimize import minimize

        def whole(places: FloatArray) -> list[float]:
            chosen = dict(zip(free, places.tolist(), strict=True))
            return [chosen.get(index, place) for index, place in enumerate(point)]

        step = math.log(_COARSE) / 2
        for _ in range(_SEARCHES if len(free) > 1 else 1):
            before = self._worth(point)
            start = np.array([point[index] for index in free])
            found = minimize(
                # A refused scene is worth minus infinity, which no simplex can weigh.
                lambda places: -max(self._worth(whole(places)), -sys.float_info.max),
                start,
                method="Nelder-Mead",
                options={
                    "initial_simplex": start + step * np.eye(start.size + 1, start.size, -1),
                    "xatol": _CLOSE,
                    "fatol": _SAME,
                    "maxfev": _MOST,
                },
            )
            point = whole(found.x)
            if self._worth(point) <= before + _SAME:
                break
            step = -step / 2  # a simplex of another size, on the other side
        return point

    def _worth(self, point: Sequence[float]) -> float:
        filters = self._filters(point)
        if filters not in self.tried:
            self.say(
                f"trying filters: velocity {_hertz(filters.velocity_filter_hz)}, "
                f"acceleration {_hertz(filters.acceleration_filter_hz)}"
            )
            self.tried[filters] = sum(
                self._worth_of(elements, filters) for elements in groups(self.job.scene)
            )
        return self.tried[filters]

    def _worth_of(self, elements: tuple[str, ...], filters: Filters) -> float:
        """Of one group; known if it was tried before with the filters that it uses."""
        used = self._used(elements)
        if "damping" not in used:
            filters = replace(filters, velocity_filter_hz=None)
        if "mass" not in used:
            filters = replace(filters, acceleration_filter_hz=None)
        if not used & {"damping", "mass"}:
            return 0.0
        if (elements, filters) not in self.known:
            self.known[elements, filters] = worth_of_group(self.job, elements, filters)
        return self.known[elements, filters]

    def _filters(self, point: Sequence[float]) -> Filters:
        velocity, acceleration = (
            axis.hertz(place) for axis, place in zip(self.axes, point, strict=True)
        )
        return replace(self.kind, velocity_filter_hz=velocity, acceleration_filter_hz=acceleration)


def _lag(filters: Filters) -> float:
    """How much is filtered: a measure of the lag of both estimates, s."""
    return sum(
        1 / hertz for hertz in (filters.velocity_filter_hz, filters.acceleration_filter_hz) if hertz
    )


def _hertz(cutoff: float | None) -> str:
    return "none" if cutoff is None else f"{cutoff:g} Hz"
