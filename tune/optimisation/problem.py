"""Design problem of elements that share a combination: unknowns, combinations, loops and limits."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from types import MappingProxyType
from typing import cast

import numpy as np

from identification import Device, round_to_digits
from tune.documents.perception import PerceptionTable, Scale
from tune.documents.scene import (
    DEFAULT_MOTION,
    EFFECT_NAMES,
    MARGINS,
    Cutoff,
    EffectName,
    Effects,
    Element,
    Margin,
    Scene,
    Wish,
    hand_of,
)
from tune.loop.loop import Filters, used_filters
from tune.loop.polynomials import FloatArray
from tune.optimisation.limits import (
    Combination,
    LinearLimits,
    Unknown,
    renderings,
)
from tune.optimisation.region import Loops, Region
from tune.rendering import FASTEST, Shares

#: N: an actuator without any force is taken to have this much.
_NO_FORCE = 1e-30
#: Of the gain of a clamp, kept for what lies between the corners of the box.
ROOM = 2e-3
#: Sizes below this part of the reference are as good as nothing: a ten-thousandth of a step.
_NOTHING = 1e-5
#: Steps that an effect keeps at least: no hand tells less from nothing. The rest is for rounding.
_LEAST = 1 + 2e-5
#: Sizes above this multiple of the reference are no haptic effect on any device (46 steps at 34 %).
_BOUNDLESS = 1e6
#: A device made lighter (less damped) keeps at least this part of what it has.
_REMAINS = 1e-3
#: Exponent of the steps of a favoured effect (the asymmetric bargaining solution).
_FAVOURED = 4.0
#: Steps of its stiffness that a wall gives up for more damping.
_YIELDS = 0.5
#: Part of the most that a lead allows below which damping that is judged as it is binds nothing.
_ANY_DAMPING = 1e-6
#: An effect of which less than this part is felt, or its opposite, counts as felt this little: no
#: size of it that is sensible then reaches a step worth having, and logarithms stay finite.
_BARELY_FELT = 1e-3
#: Ratio of neighbouring cut-offs at first. Worth changes over several octaves: of a mass limited by
#: ripple it rises with each, until force, stability or phantom damping makes it fall.
COARSE = 3.0
#: Digits of a written cut-off.
_CUTOFF_DIGITS = 4
#: Margin beyond the one asked for, and less claimed of what is beyond it, relative, where a proof
#: came too close to the edge; at the last two nothing beyond it is claimed, and at the last no
#: multiplier has taps of more samples than these.
SLACK, LONGER = (1e-3, 1e-2, 5e-2, 6e-2), 85


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What bounds a size besides stability; None where nothing is known."""

    continuous_force: float | None
    peak_force: float | None
    encoder_resolution: float | None
    ripple: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Unknowns of elements that share combinations, and everything that bounds them."""

    unknowns: tuple[Unknown, ...]
    combinations: tuple[Combination, ...]
    margin: Margin
    loops: Loops
    limits: Limits
    linear: LinearLimits  # limits of force and rendering as rows
    cut: frozenset[str] = frozenset()  # elements whose force may be cut at its limit
    # what the proof of a clamp has to reach; the margin's, and room for what lies between the
    # corners of the box
    proved_gain: float = 1.0
    # part of the gain margin that linear limits keep beyond it, for the proof of clamps
    room: float = 0.0
    slack: float = 0.0  # part of it that is kept because a proof failed before

    def limited_to(self, most: Mapping[str, float]) -> Problem:
        """The problem in which effects are no larger than this, by label."""
        limited = (replace(u, high=min(u.high, most.get(u.label, u.high))) for u in self.unknowns)
        return replace(self, unknowns=tuple(limited))

    @property
    def low(self) -> FloatArray:
        """The least sizes that are kept."""
        return np.array([unknown.low for unknown in self.unknowns])

    @property
    def nothing(self) -> FloatArray:
        """Sizes as good as none, that leave no loop without its spring."""
        return _NOTHING * np.array([unknown.scale.reference for unknown in self.unknowns])

    @property
    def high(self) -> FloatArray:
        """The largest sizes wanted."""
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
        """What each unknown adds to K, B and M of combinations with a spring, or of those without.

        Signs of shape (combinations, 3, unknowns); meetings are those of walls with others.
        """
        combinations = [
            combination
            for combination in self.combinations
            if bool(combination.members[0]) == sprung and (meetings or not combination.meeting)
        ]
        shares = np.zeros((len(combinations), len(EFFECT_NAMES), len(self.unknowns)))
        for row, combination in zip(shares, combinations, strict=True):
            for effect, members in enumerate(combination.members):
                for index in members:
                    row[effect, index] = self.unknowns[index].sign
        return shares

    def effects(self, combination: Combination, sizes: FloatArray) -> Effects:
        """The sum of effects of one combination; an effect no element has is absent."""
        total = [
            float(sum(self.unknowns[i].sign * sizes[i] for i in indices)) if indices else None
            for indices in combination.members
        ]
        return Effects(stiffness=total[0], damping=total[1], mass=total[2])


#: Parts of their steps that elements keep where a wall is met beside them; and tried in turn after
#: it where the scene asks for both together.
_FOR_WALLS, _TOGETHER = 0.8, (0.6, 0.4, 0.2)


@dataclass(frozen=True, kw_only=True)
class DesignTask:
    """What is to be tuned: a scene on a device, with what is perceptible and where it must hold."""

    device: Device
    scene: Scene
    table: PerceptionTable
    region: Region  # that must be safe
    slack: float = 0.0  # part of the margin that is kept on top of it
    # an effect whose steps count more in the product; None for none
    favour: EffectName | None = None
    # pairs that could not be kept together, beside those of the scene
    apart: tuple[tuple[str, str], ...] = ()
    # effects by label, "element.effect", that are not looked for, with the reason
    left_out: tuple[tuple[str, str], ...] = ()
    # of their steps that elements are given, for a wall that is met beside them
    parts: Mapping[str, float] = field(default_factory=dict[str, float])
    # Loops and combinations are built when first asked for and kept.
    _loops: dict[Filters, Loops] = field(
        default_factory=dict[Filters, Loops], init=False, repr=False, compare=False
    )

    @classmethod
    def of(
        cls, device: Device, scene: Scene, table: PerceptionTable, favour: EffectName | None = None
    ) -> DesignTask:
        """The task over the device's simultaneous box."""
        extra = max(margin.extra_delay_samples for margin in MARGINS.values())
        region = Region.of(device, hand_of(scene.hand, device.motion), extra=extra)
        return cls(device=device, scene=scene, table=table, region=region, favour=favour)

    @cached_property
    def ranks(self) -> tuple[int, ...]:
        """Ranks of the scene; see `Unknown`."""
        elements = self.scene.elements.values()
        return tuple(sorted({level_of(e, effect) for e in elements for effect in e.wishes()}))

    def asks_for_both(self, pair: tuple[str, str]) -> bool:
        """Whether the scene asks for a pair of elements together."""
        return any({*pair} <= {*group} for group in self.scene.together)

    def without(self, pair: tuple[str, str]) -> DesignTask:
        """The task with one more pair of elements that are never met together."""
        order = list(self.scene.elements)
        first, second = sorted(pair, key=order.index)
        scene = self.scene.model_copy(update={"apart": (*self.scene.apart, (first, second))})
        parts = {name: part for name, part in self.parts.items() if name not in pair}
        return replace(self, scene=scene, apart=(*self.apart, (first, second)), parts=parts)

    def apart_as_needed(self, there: Collection[str]) -> DesignTask:
        """The task whose pairs apart are of elements that are there: the others give no force."""
        needed = tuple(pair for pair in self.apart if {*pair} <= {*there})
        own = self.scene.apart[: len(self.scene.apart) - len(self.apart)]
        scene = self.scene.model_copy(update={"apart": (*own, *needed)})
        return replace(self, scene=scene, apart=needed)

    def with_room_for(self, wall: str, other: str) -> DesignTask | None:
        """The task in which an element leaves more room for a wall that it is met with.

        None where it has left all it may, or is wanted as it is: of another priority it leaves some
        to a wall that the scene asks for together with it, and none to others.
        """
        mine, its = (self.scene.elements[name] for name in (wall, other))
        fixed = all(wish.kind == "value" for wish in its.wishes().values())
        together = self.asks_for_both((wall, other))
        equal = mine.priority == its.priority
        parts = (_FOR_WALLS, *_TOGETHER * (together and equal))
        less = next((part for part in parts if part < self.parts.get(other, 1.0)), None)
        if less is None or fixed or not (equal or together):
            return None
        return replace(self, parts={**self.parts, other: less})

    def without_lost_walls(self, dropped: Mapping[str, str]) -> DesignTask | None:
        """The task without walls that are dropped, by label, for which nothing has to leave room.

        None where nothing did, or none is dropped.
        """
        known = dict(self.left_out)
        lost = {name for name in self.scene.walls if f"{name}.stiffness" in dropped.keys() - known}
        if not lost or not self.parts:
            return None
        left = [(at, why) for at, why in dropped.items() if at.rpartition(".")[0] in lost]
        return replace(self, parts={}, left_out=(*self.left_out, *left))

    def with_less_to_prove(
        self, unproved: Sequence[tuple[str, ...]], why: str
    ) -> DesignTask | None:
        """The task with a wall told apart from what it is not proved with, or without elements."""
        scene, names = self.scene, min(unproved, key=len, default=())
        for wall, other in product(names, names):
            pair = wall, other
            if wall in scene.walls and other not in scene.walls and not self.asks_for_both(pair):
                return self.without(pair)
        # Elements that are not proved alone go, with the reason, else the last one of least
        # priority of the smallest combination. None where nothing would be left.
        go = [each for one in unproved if len(one) == 1 for each in one]
        if names and not go:
            go = [max(reversed(names), key=lambda name: scene.elements[name].priority)]
        gone = {label.rpartition(".")[0] for label, _ in self.left_out}.union(go)
        if not go or scene.elements.keys() <= gone:
            return None
        left = [
            (f"{name}.{effect}", why) for name in go for effect in scene.elements[name].wishes()
        ]
        return replace(self, left_out=(*self.left_out, *left))

    def left_out_of(self, elements: Sequence[str]) -> dict[str, str]:
        """What is left out of some elements, by label, with the reason."""
        return {at: why for at, why in self.left_out if at.rpartition(".")[0] in elements}

    def fades(self, element: str) -> bool:
        """Whether mass is looked for in an element, or what is taken from the device."""
        left = self.left_out_of([element])
        asked = (
            (effect, wish.sign)
            for effect, wish in self.scene.elements[element].wishes().items()
            if f"{element}.{effect}" not in left
        )
        return any(effect == "mass" or sign < 0 for effect, sign in asked)

    def loops(self, filters: Filters) -> Loops:
        """The loops with these filters at all corners, to the margin's extra delay."""
        if filters not in self._loops:
            extra = MARGINS[self.scene.margin].extra_delay_samples
            self._loops[filters] = Loops.of(self.device, self.region, filters, extra)
        return self._loops[filters]

    @cached_property
    def subsets(self) -> dict[str, list[tuple[str, ...]]]:
        """Every set of elements that can be felt at one moment, by the first of them."""
        found: dict[str, list[tuple[str, ...]]] = {}
        for subset in self.scene.combinations():
            found.setdefault(subset[0], []).append(subset)
        return found


def problem_of(
    task: DesignTask,
    *,
    elements: Sequence[str],
    filters: Filters,
    gone: frozenset[str] = frozenset(),
    cut: frozenset[str] = frozenset(),
    settled: Mapping[str, float] = MappingProxyType({}),
    room: float = 0.0,
    felt: bool = True,
) -> Problem:
    """The problem of elements that share combinations, beside others that are settled, by label.

    Labels, "element.effect", that are gone are left out. No penetration is assumed of elements
    whose force may be cut at its limit. Room is a part of the gain margin that linear limits keep
    beyond it, for the proof of clamps. Effects that need not be felt are only to be safe.
    """
    device, scene = task.device, task.scene
    margin = MARGINS[scene.margin]
    # Walls are proved up to their linear limit, and beyond it nothing is: room is left for it.
    room = max(room, 2 * ROOM) if scene.walls.intersection(elements) else room
    kept = margin.gain * (1 + task.slack)
    margin = margin.model_copy(update={"gain": kept * (1 + room)})
    asking = _Asking(task=task, gain=margin.gain, filters=filters, felt=felt)
    unknowns = tuple(
        asking.unknown(element, effect)
        for element in elements
        for effect in scene.elements[element].wishes()
        if f"{element}.{effect}" not in gone
    ) + tuple(asking.settled(*each) for each in settled.items())
    within = {*elements, *(unknown.element for unknown in unknowns)}
    subsets = [
        subset
        for name in within
        for subset in task.subsets[name]
        if within >= {*subset} and not {*elements}.isdisjoint(subset)
    ]
    combinations = tuple(
        _combination(task, subset, unknowns, cut)
        for subset in sorted(subsets, key=lambda each: (len(each), each))
        if any(u.element in subset for u in unknowns)
    )
    wanted = {unknown.effect: 0.0 for unknown in unknowns}
    used = used_filters(filters, Effects(**wanted))
    limit, encoder = device.force_limit, device.encoder_resolution
    continuous, peak = (None, None) if limit is None else (limit.continuous, limit.peak)
    forces = _force_rows(combinations, len(unknowns), continuous, peak)
    ends = renderings(unknowns, Shares.of(device, used), asking.scale, scene.walls) if felt else ()
    leads = _lead_limits(task, margin, elements, unknowns, felt=felt)
    return Problem(
        unknowns=unknowns,
        combinations=combinations,
        margin=margin,
        loops=task.loops(used),
        limits=Limits(
            continuous_force=continuous,
            peak_force=peak,
            encoder_resolution=None if encoder is None else encoder.value,
            ripple=scene.ripple_limit or task.table.threshold(device.motion),
        ),
        linear=LinearLimits.of(forces, len(unknowns), ends, leads),
        cut=cut,
        proved_gain=kept * (1 + ROOM),
        room=room,
        slack=task.slack,
    )


def _force_rows(
    combinations: Sequence[Combination], unknowns: int, continuous: float | None, peak: float | None
) -> Iterator[FloatArray]:
    """Sustained force K·penetration and peak force K·penetration + |B|·speed + |M|·acceleration."""
    for each in combinations:
        costs = np.zeros((len(each.members), unknowns))
        for cost, members, reaches in zip(costs, each.members, each.reach, strict=True):
            cost[list(members)] = [reach or 0.0 for reach in reaches]
        if continuous is not None:
            yield costs[0] / max(continuous, _NO_FORCE)
        if peak is not None:
            yield costs.sum(axis=0) / max(peak, _NO_FORCE)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asking:
    """What all unknowns of a problem share: the gain of the margin, and whether they are felt."""

    task: DesignTask
    gain: float
    filters: Filters
    felt: bool

    def scale(self, name: str, effect: EffectName) -> Scale:
        """The scale of what is felt of one effect of an element."""
        device, table = self.task.device, self.task.table
        return Scale.of(effect, device, table, self.task.scene.motion(name, device.motion))

    def unknown(self, name: str, effect: EffectName) -> Unknown:
        """The unknown of one effect of an element."""
        given, box = self.task.scene.elements[name], self.task.region.box
        wish, felt = given.wishes()[effect], self.scale(name, effect)
        scale = felt.through(self._share(effect))
        bare = felt.reference
        high = _BOUNDLESS * max(bare, felt.floor) if wish.high is None else abs(wish.high)
        if wish.sign < 0:
            # The bare device must keep the same margin downwards: M >= -m_low/g, B >= -b_low/g.
            lowest = {"mass": box.mass[0], "damping": box.damping[0]}[effect]
            most = min(lowest / self.gain, (1 - _REMAINS) * min(bare, scale.reference))
            high = most if wish.high is None else min(high, most)
        least = abs(scale.value_at(_LEAST, wish.sign))
        if effect == "damping" and wish.kind == "value" and wish.sign > 0 and given.stiffness:
            least = min(least, high)  # it holds its spring, whether it is felt or not
        if not self.felt:
            least = min(_NOTHING * bare, high)
        starts = wish.low if wish.kind == "range" and wish.low else 0.0
        return Unknown(
            element=name,
            effect=effect,
            sign=wish.sign,
            low=max(least, starts),
            high=high,
            wish=wish,
            scale=scale,
            level=level_of(given, effect),
            yields=_YIELDS if effect == "stiffness" and _serves(given) else 0.0,
            weight=_FAVOURED if effect == self.task.favour else 1.0,
        )

    def settled(self, label: str, size: float) -> Unknown:
        """An effect whose size is not looked for any more."""
        element, _, effect = label.rpartition(".")
        known = self.unknown(element, cast("EffectName", effect))
        wish = Wish(kind="value", low=known.sign * size, high=known.sign * size)
        return replace(known, low=size, high=size, wish=wish, level=-1, weight=0.0, yields=0.0)

    def _share(self, effect: EffectName) -> float:
        """The part of a commanded effect that a hand feels as such; all of a spring."""
        if effect == "stiffness":
            return 1.0
        shares = Shares.of(self.task.device, self.filters)
        return max((shares.damping if effect == "damping" else shares.mass).mean, _BARELY_FELT)


def level_of(given: Element, effect: EffectName) -> int:
    """Rank of one effect of an element; see `Unknown`."""
    if given.wishes()[effect].kind == "value":
        return 0
    return 2 * given.priority + (effect == "damping" and _serves(given))


def _serves(given: Element) -> bool:
    """Whether it is a wall whose damping is there for its stiffness."""
    return given.one_sided and given.favour != "both"


def _lead_limits(
    task: DesignTask,
    margin: Margin,
    elements: Sequence[str],
    unknowns: Sequence[Unknown],
    *,
    felt: bool,
) -> Iterator[tuple[int, int, float, float]]:
    """Walls whose damper more than repays the lag of their spring, and acts before the face a bit.

    0 <= speed·(B/K - τ) <= lead (docs/theory.md, 11), where the damping is not a wanted value. Of
    gains that are judged as they are, not ``felt``, a lead that is stated limits the damper.
    """
    scene, motion, step = task.scene, task.device.motion, task.device.sample_time
    box, lag = task.region.box, task.region.current_lag
    # τ: delay, half a sample and current lag, s, the margin's latest, and as they are stated.
    late = box.delay[1] + (margin.extra_delay_samples + 0.5) * box.sample_time[1]
    present = task.device.delay.value + 0.5 * step.value
    late, present = (late, present) if lag is None else (late + lag.high, present + lag.value)
    for name in elements:
        lead = scene.lead(name, motion)
        own = {u.effect: i for i, u in enumerate(unknowns) if u.element == name and not u.settled}
        K, B = own.get("stiffness"), own.get("damping")
        if lead is None or K is None or B is None:
            continue
        most = present + lead / scene.motion(name, motion).speed
        if unknowns[B].wish.kind != "value":
            yield K, B, late, most
        elif not felt and scene.elements[name].lead and unknowns[B].wish.sign > 0:
            yield K, B, _ANY_DAMPING * most, most


def _combination(
    task: DesignTask, subset: tuple[str, ...], unknowns: tuple[Unknown, ...], cut: frozenset[str]
) -> Combination:
    scene = task.scene
    own = [scene.motion(u.element, task.device.motion, cut=u.element in cut) for u in unknowns]
    clamped = cut & scene.walls
    k, b, m = (
        tuple(i for i, u in enumerate(unknowns) if u.element in subset and u.effect == effect)
        for effect in EFFECT_NAMES
    )
    return Combination(
        elements=subset,
        members=(k, b, m),
        reach=(
            tuple(own[i].penetration for i in k),
            tuple(None if unknowns[i].element in clamped else own[i].speed for i in b),
            tuple(own[i].acceleration for i in m),
        ),
        absolute=any(unknowns[i].element in cut | scene.walls for i in k),
        meeting=bool(scene.walls.intersection(subset)) and not scene.walls.issuperset(subset),
    )


def may_saturate(task: DesignTask, elements: Sequence[str]) -> frozenset[str]:
    """Elements whose springs the usual motion would bound, that may be cut at the force limit."""
    device, scene = task.device, task.scene
    limit, usual = device.force_limit, DEFAULT_MOTION[device.motion].penetration
    if limit is None or usual is None or not task.region.box.damping[0] > 0:
        return frozenset()
    # A force that friction masks is none to be cut at.
    if limit.continuous <= max(device.coulomb_friction.value, task.table.threshold(device.motion)):
        return frozenset()
    within = set(elements)
    groups = [set(s) for name in elements for s in task.subsets[name] if within >= {*s}]
    fading = {name for name in elements if task.fades(name)}
    # They state no penetration, and nothing felt with them has mass or takes something away: what
    # pumps must not be cut. A wall is met by all there is, and is cut all the same.
    cut: set[str] = set()
    for name in elements:
        wish = scene.elements[name].stiffness
        if wish is None or scene.elements[name].penetration is not None:
            continue
        enough = wish.high is not None and wish.high * usual <= limit.continuous
        pumps = any(name in s and fading & s for s in groups)
        if name in scene.walls or (not enough and not pumps):
            cut.add(name)
    return frozenset(cut)


@dataclass(frozen=True, slots=True, kw_only=True)
class CutoffAxis:
    """The choices of one cut-off on a logarithmic scale, from coarse places to written hertz."""

    first: tuple[float, ...]  # beyond the last but one there is no filter; one place where fixed
    fixed: float | None = None  # the cut-off where it is not free

    @classmethod
    def of(cls, cutoff: Cutoff, nyquist: float) -> CutoffAxis:
        """The choices of a cut-off as a scene states it, up to the Nyquist frequency, Hz."""
        if cutoff != "free" or nyquist <= FASTEST:
            return cls(first=(0.0,), fixed=cutoff if isinstance(cutoff, float) else None)
        # A filter must pass the motions people make.
        low, high = math.log(FASTEST), math.log(nyquist)
        count = math.ceil((high - low) / math.log(COARSE))
        return cls(first=tuple(low + (high - low) * k / count for k in range(count + 2)))

    @property
    def free(self) -> bool:
        """Whether there is more than one choice."""
        return len(self.first) > 1

    @property
    def used(self) -> bool:
        """Whether there may be a filter."""
        return self.free or self.fixed is not None

    def place(self, hertz: float | None) -> float:
        """Where a cut-off is, as written, rounded up at most; beyond all of them for no filter."""
        return min(math.log(hertz), self.first[-2]) if self.free and hertz else self.first[-1]

    def moved(self, place: float, way: float) -> float:
        """A place so much farther along, as far as there are filters."""
        low, high = self.first[0], self.first[-2]
        return min(max(min(place, high) + way, low), high)

    def hertz(self, place: float) -> float | None:
        """The cut-off as it is written; None for no filter."""
        if not self.free:
            return self.fixed
        return None if place > self.first[-2] else round_to_digits(math.exp(place), _CUTOFF_DIGITS)
