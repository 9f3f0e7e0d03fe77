"""The design problem of elements that share a moment: unknowns, moments, loops and limits.

One file: the parts of one problem, none of use alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import cast

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.effects import EFFECT_NAMES, EffectName, Effects
from tune.documents.perception import PerceptionTable
from tune.documents.scene import DEFAULT_MOTION, MARGINS, Margin, Scene, Wish, hand_of
from tune.loop.filters import Filters, used_filters
from tune.optimisation.linear import LinearLimits, force_rows, lead_limits
from tune.optimisation.loops import Loops
from tune.optimisation.region import Region
from tune.optimisation.rendering import renderings
from tune.optimisation.scene_unknowns import NOTHING, Asking
from tune.optimisation.unknown import Unknown
from tune.rendering.rendered import Shares

FloatArray = NDArray[np.float64]
#: Of the gain of a clamp, kept for what lies between the corners of the box.
ROOM = 2e-3
_NONE: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Elements felt at once: which unknowns add up, and the motion of each element.

    Attributes:
        elements: names.
        members: indices of unknowns, for K, B and M.
        reach: (penetration, m; speed, m/s; acceleration, m/s²) for each unknown, in the order of
            ``members``; None where the force is cut by a clamp and bounds nothing.
        absolute: the moment must be absolutely stable: the clamp of one of its springs may be
            reached, as that of a wall always is.
        meeting: a wall is met beside other elements; its ripple is told, not bound.
    """

    elements: tuple[str, ...]
    members: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
    reach: tuple[tuple[float | None, ...], tuple[float | None, ...], tuple[float | None, ...]]
    absolute: bool = False
    meeting: bool = False

    @property
    def lone(self) -> int | None:
        """The only unknown of the moment, None where there are several or none."""
        found = [index for indices in self.members for index in indices]
        return found[0] if len(found) == 1 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What bounds a size besides stability; None where nothing is known."""

    continuous_force: float | None
    peak_force: float | None
    encoder_resolution: float | None
    ripple: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Unknowns of elements that share moments, and everything that bounds them.

    Attributes:
        unknowns: whose sizes are looked for.
        moments: elements felt at once.
        margin: of gain and delay.
        loops: of the region.
        limits: of force, ripple and encoder.
        linear: limits of force and rendering as rows.
        cut: elements whose force may be cut at its limit.
        proved_gain: what the proof of a clamp has to reach; the margin's, and room for what lies
            between the corners of the box.
    """

    unknowns: tuple[Unknown, ...]
    moments: tuple[Moment, ...]
    margin: Margin
    loops: Loops
    limits: Limits
    linear: LinearLimits
    cut: frozenset[str] = frozenset()
    proved_gain: float = 1.0

    @property
    def low(self) -> FloatArray:
        """The least sizes that are kept, shape (unknowns,)."""
        return np.array([unknown.low for unknown in self.unknowns])

    @property
    def nothing(self) -> FloatArray:
        """Sizes as good as none, that leave no loop without its spring, shape (unknowns,)."""
        return NOTHING * np.array([unknown.scale.reference for unknown in self.unknowns])

    @property
    def high(self) -> FloatArray:
        """The largest sizes wanted, shape (unknowns,)."""
        return np.array([unknown.high for unknown in self.unknowns])

    @property
    def region(self) -> Region:
        """What the device and the hand may be."""
        return self.loops.region

    @property
    def filters(self) -> Filters:
        """Those that the unknowns use."""
        return self.loops.filters

    def shares(self, *, sprung: bool, meetings: bool = True) -> FloatArray:
        """What each unknown adds to K, B and M of the moments with a spring, or of those without.

        Args:
            sprung: with a spring.
            meetings: those of walls with others as well.

        Returns:
            The signs, shape (moments, 3, unknowns).
        """
        moments = [
            moment
            for moment in self.moments
            if bool(moment.members[0]) == sprung and (meetings or not moment.meeting)
        ]
        shares = np.zeros((len(moments), len(EFFECT_NAMES), len(self.unknowns)))
        for row, moment in zip(shares, moments, strict=True):
            for effect, members in enumerate(moment.members):
                for index in members:
                    row[effect, index] = self.unknowns[index].sign
        return shares

    def effects(self, moment: Moment, sizes: FloatArray) -> Effects:
        """The sum of effects of one moment; an effect no element has is absent.

        Sizes have shape (unknowns,).
        """
        total = [
            float(sum(self.unknowns[i].sign * sizes[i] for i in indices)) if indices else None
            for indices in moment.members
        ]
        return Effects(stiffness=total[0], damping=total[1], mass=total[2])


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignTask:
    """What is to be tuned: a scene on a device, with what is perceptible and where it must hold.

    Attributes:
        device: as it is stored.
        scene: what is wanted.
        table: Weber fractions and thresholds.
        region: that must be safe.
        slack: part of the margin that is kept on top of it.
        favour: an effect whose steps count more in the product; None for none.
        apart: pairs that could not be kept together, beside those of the scene.

    Loops and moments are built when first asked for and kept.
    """

    device: Device
    scene: Scene
    table: PerceptionTable
    region: Region
    slack: float = 0.0
    favour: EffectName | None = None
    apart: tuple[tuple[str, str], ...] = ()
    _loops: dict[Filters, Loops] = field(
        default_factory=dict[Filters, Loops], init=False, repr=False, compare=False
    )
    _subsets: dict[str, list[tuple[str, ...]]] = field(
        default_factory=dict[str, list[tuple[str, ...]]], init=False, repr=False, compare=False
    )

    @classmethod
    def of(
        cls,
        device: Device,
        scene: Scene,
        table: PerceptionTable,
        favour: EffectName | None = None,
    ) -> DesignTask:
        """The task over the device's simultaneous box."""
        extra = max(margin.extra_delay_samples for margin in MARGINS.values())
        region = Region.of(device, hand_of(scene.hand, device.motion), extra=extra)
        return cls(device=device, scene=scene, table=table, region=region, favour=favour)

    def without(self, pair: tuple[str, str]) -> DesignTask:
        """The task with one more pair of elements that are never met together."""
        order = list(self.scene.elements)
        first, second = sorted(pair, key=order.index)
        scene = self.scene.model_copy(update={"apart": (*self.scene.apart, (first, second))})
        return replace(self, scene=scene, apart=(*self.apart, (first, second)))

    def spring_lags(self, margin: Margin) -> tuple[float, float]:
        """Delay, half a sample and current lag, s: the margin's latest, and as they are stated."""
        box, lag = self.region.box, self.region.current_lag
        step = self.device.sample_time
        late = box.delay[1] + (margin.extra_delay_samples + 0.5) * box.sample_time[1]
        present = self.device.delay.value + 0.5 * step.value
        return (late, present) if lag is None else (late + lag.high, present + lag.value)

    def loops(self, filters: Filters) -> Loops:
        """The loops with these filters at all corners, to the margin's extra delay."""
        if filters not in self._loops:
            extra = MARGINS[self.scene.margin].extra_delay_samples
            self._loops[filters] = Loops.of(self.device, self.region, filters, extra)
        return self._loops[filters]

    def subsets(self, element: str) -> list[tuple[str, ...]]:
        """Every set of elements, this one the first of them, that can be felt at one moment."""
        if not self._subsets:
            for subset in self.scene.subsets():
                self._subsets.setdefault(subset[0], []).append(subset)
        return self._subsets[element]


def pose(
    task: DesignTask,
    *,
    elements: Sequence[str],
    filters: Filters,
    gone: frozenset[str] = frozenset(),
    cut: frozenset[str] = frozenset(),
    settled: Mapping[str, float] = _NONE,
    room: float = 0.0,
    felt: bool = True,
) -> Problem:
    """The problem of some elements of a scene on a device, beside others that are settled.

    Args:
        task: device, scene, perception and region.
        elements: names that share moments.
        filters: cut-offs of the estimators.
        gone: labels "element.effect" that are left out.
        cut: elements whose force may be cut at its limit, so that no penetration is assumed.
        settled: sizes by label, "element.effect", of elements that were tuned before.
        room: part of the gain margin kept beyond it by linear limits, for the proof of clamps.
        felt: effects are perceptible and felt as what they are; else only safe.
    """
    device, scene = task.device, task.scene
    margin = MARGINS[scene.margin]
    # Walls are proved up to their linear limit, and beyond it nothing is: room is left for it.
    room = max(room, 2 * ROOM) if scene.walls.intersection(elements) else room
    kept = margin.gain * (1 + task.slack)
    margin = margin.model_copy(update={"gain": kept * (1 + room)})
    asking = Asking(
        device=device,
        scene=scene,
        box=task.region.box,
        table=task.table,
        favour=task.favour,
        gain=margin.gain,
        filters=filters,
        felt=felt,
    )
    unknowns = tuple(
        asking.unknown(element, effect)
        for element in elements
        for effect in scene.elements[element].wishes()
        if f"{element}.{effect}" not in gone
    ) + tuple(_settled(asking, *each) for each in settled.items())
    within = {*elements, *(unknown.element for unknown in unknowns)}
    subsets = [
        subset
        for name in within
        for subset in task.subsets(name)
        if within >= {*subset} and not {*elements}.isdisjoint(subset)
    ]
    moments = tuple(
        _moment(device, scene, subset, unknowns, cut)
        for subset in sorted(subsets, key=lambda each: (len(each), each))
        if any(u.element in subset for u in unknowns)
    )
    wanted = {unknown.effect: 0.0 for unknown in unknowns}
    used = used_filters(filters, Effects(**wanted))
    limit = device.force_limit
    continuous, peak = (None, None) if limit is None else (limit.continuous, limit.peak)
    forces = force_rows(moments, len(unknowns), continuous, peak)
    ends = renderings(unknowns, Shares.of(device, used), asking.scale, scene.walls) if felt else ()
    walls = [
        (name, scene.motion(name, device.motion).speed, lead)
        for name in elements
        if (lead := scene.lead(name, device.motion)) is not None
    ]
    lags = task.spring_lags(margin)
    return Problem(
        unknowns=unknowns,
        moments=moments,
        margin=margin,
        loops=task.loops(used),
        limits=Limits(
            continuous_force=continuous,
            peak_force=peak,
            encoder_resolution=(
                None if device.encoder_resolution is None else device.encoder_resolution.value
            ),
            ripple=scene.ripple_limit or task.table.threshold(device.motion),
        ),
        linear=LinearLimits.of(forces, len(unknowns), ends, lead_limits(walls, unknowns, *lags)),
        cut=cut,
        proved_gain=kept * (1 + ROOM),
    )


def _settled(asking: Asking, label: str, size: float) -> Unknown:
    """An effect whose size is not looked for any more."""
    element, _, effect = label.rpartition(".")
    known = asking.unknown(element, cast("EffectName", effect))
    wish = Wish(kind="value", low=known.sign * size, high=known.sign * size)
    return replace(known, low=size, high=size, wish=wish, level=-1, weight=0.0, yields=0.0)


def _moment(
    device: Device,
    scene: Scene,
    subset: tuple[str, ...],
    unknowns: tuple[Unknown, ...],
    cut: frozenset[str],
) -> Moment:
    motions = {name: scene.motion(name, device.motion, cut=name in cut) for name in subset}
    clamped = {name for name in subset if name in cut and name in scene.walls}
    chosen = [
        [i for i, u in enumerate(unknowns) if u.element in subset and u.effect == effect]
        for effect in EFFECT_NAMES
    ]
    k, b, m = (tuple(part) for part in chosen)
    return Moment(
        elements=subset,
        members=(k, b, m),
        reach=(
            tuple(motions[unknowns[i].element].penetration for i in k),
            tuple(
                None if unknowns[i].element in clamped else motions[unknowns[i].element].speed
                for i in b
            ),
            tuple(motions[unknowns[i].element].acceleration for i in m),
        ),
        absolute=any(unknowns[i].element in cut | scene.walls for i in k),
        meeting=bool(scene.walls.intersection(subset)) and not scene.walls.issuperset(subset),
    )


def may_saturate(task: DesignTask, elements: Sequence[str]) -> frozenset[str]:
    """Elements whose springs the usual motion would bound, and which may be cut at the force limit.

    They state no penetration, and nothing felt with them has mass or takes something away: what
    pumps must not be cut. A wall is met by all there is, and is cut all the same.
    """
    device, scene = task.device, task.scene
    limit, usual = device.force_limit, DEFAULT_MOTION[device.motion].penetration
    if limit is None or usual is None or not task.region.box.damping[0] > 0:
        return frozenset()
    # A force that friction masks is none to be cut at.
    if limit.continuous <= max(device.coulomb_friction.value, task.table.threshold(device.motion)):
        return frozenset()
    within = set(elements)
    groups = [set(s) for name in elements for s in task.subsets(name) if within >= {*s}]
    cut: set[str] = set()
    for name in elements:
        wish = scene.elements[name].stiffness
        if wish is None or scene.elements[name].penetration is not None:
            continue
        enough = wish.high is not None and wish.high * usual <= limit.continuous
        pumps = any(scene.elements[other].fades for s in groups if name in s for other in s)
        if name in scene.walls or (not enough and not pumps):
            cut.add(name)
    return frozenset(cut)
