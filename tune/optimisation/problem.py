"""The design problem of elements that share a moment: unknowns, moments, loops and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.effects import EFFECT_NAMES, EffectName, Effects
from tune.documents.hand import hand_of
from tune.documents.perception import PerceptionTable, references
from tune.documents.scene import MARGINS, Margin, Scene
from tune.loop.filters import Filters, used_filters
from tune.optimisation.loops import Loops
from tune.optimisation.region import Region
from tune.optimisation.unknown import Unknown
from tune.rendering.rendered import Shares

FloatArray = NDArray[np.float64]

#: Sizes below this part of the reference are as good as nothing: a ten-thousandth of a step.
NOTHING = 1e-5
#: Sizes above this multiple of the reference are no haptic effect on any device (46 steps at 34 %).
BOUNDLESS = 1e6
#: A device made lighter (less damped) keeps at least this part of what it has.
REMAINS = 1e-3
#: An effect of which less than this part is felt, or its opposite, counts as felt this little: no
#: size of it that is sensible then reaches a step worth having, and logarithms stay finite.
BARELY_FELT = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Elements felt at once: which unknowns add up, and the motion of each element.

    Attributes:
        elements: names.
        members: indices of unknowns, for K, B and M.
        reach: (penetration, speed, acceleration) for each unknown, in the order of ``members``.
        one_sided: one of the elements pushes only: the moment must be absolutely stable.
    """

    elements: tuple[str, ...]
    members: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
    reach: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    one_sided: bool = False

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
    """Unknowns of elements that share moments, and everything that bounds them."""

    unknowns: tuple[Unknown, ...]
    moments: tuple[Moment, ...]
    margin: Margin
    loops: Loops
    limits: Limits

    @property
    def region(self) -> Region:
        """What the device and the hand may be."""
        return self.loops.region

    @property
    def filters(self) -> Filters:
        """Those that the unknowns use."""
        return self.loops.filters

    def shares(self, *, sprung: bool) -> FloatArray:
        """What each unknown adds to K, B and M of the moments with a spring, or of those without.

        Returns:
            The signs, shape (moments, 3, unknowns).
        """
        moments = [moment for moment in self.moments if bool(moment.members[0]) == sprung]
        shares = np.zeros((len(moments), len(EFFECT_NAMES), len(self.unknowns)))
        for row, moment in zip(shares, moments, strict=True):
            for effect, members in enumerate(moment.members):
                for index in members:
                    row[effect, index] = self.unknowns[index].sign
        return shares

    def effects(self, moment: Moment, sizes: FloatArray) -> Effects:
        """The sum of effects of one moment; an effect no element has is absent."""
        total = [
            float(sum(self.unknowns[i].sign * sizes[i] for i in indices)) if indices else None
            for indices in moment.members
        ]
        return Effects(stiffness=total[0], damping=total[1], mass=total[2])


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What is to be tuned: a scene on a device, with what is perceptible and where it must hold.

    Attributes:
        device: as it is stored.
        scene: what is wanted.
        table: Weber fractions and thresholds.
        region: that must be safe.
        slack: part of the margin that is kept on top of it.

    Loops and moments are built when first asked for and kept.
    """

    device: Device
    scene: Scene
    table: PerceptionTable
    region: Region
    slack: float = 0.0
    _loops: dict[Filters, Loops] = field(
        default_factory=dict[Filters, Loops], init=False, repr=False, compare=False
    )
    _subsets: dict[str, list[tuple[str, ...]]] = field(
        default_factory=dict[str, list[tuple[str, ...]]], init=False, repr=False, compare=False
    )

    @classmethod
    def of(cls, device: Device, scene: Scene, table: PerceptionTable) -> Job:
        """The job over the device's simultaneous box."""
        extra = max(margin.extra_delay_samples for margin in MARGINS.values())
        region = Region.of(device, hand_of(scene.hand, device.motion), extra=extra)
        return cls(device=device, scene=scene, table=table, region=region)

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
    job: Job,
    *,
    elements: Sequence[str],
    filters: Filters,
    gone: frozenset[str] = frozenset(),
) -> Problem:
    """The problem of some elements of a scene on a device.

    Args:
        job: device, scene, perception and region.
        elements: names that share moments.
        filters: cut-offs of the estimators.
        gone: labels "element.effect" that are left out.
    """
    device, scene = job.device, job.scene
    margin = MARGINS[scene.margin]
    if job.slack:
        margin = margin.model_copy(update={"gain": margin.gain * (1 + job.slack)})
    unknowns = tuple(
        _unknown(job, element, effect, margin, filters)
        for element in elements
        for effect in scene.elements[element].wishes()
        if f"{element}.{effect}" not in gone
    )
    within = set(elements)
    subsets = [subset for name in elements for subset in job.subsets(name) if within >= {*subset}]
    moments = tuple(
        _moment(device, scene, subset, unknowns)
        for subset in sorted(subsets, key=len)
        if any(u.element in subset for u in unknowns)
    )
    wanted = {unknown.effect: 0.0 for unknown in unknowns}
    limit = device.force_limit
    return Problem(
        unknowns=unknowns,
        moments=moments,
        margin=margin,
        loops=job.loops(used_filters(filters, Effects(**wanted))),
        limits=Limits(
            continuous_force=None if limit is None else limit.continuous,
            peak_force=None if limit is None else limit.peak,
            encoder_resolution=(
                None if device.encoder_resolution is None else device.encoder_resolution.value
            ),
            ripple=scene.ripple_limit or job.table.threshold(device.motion),
        ),
    )


def _unknown(
    job: Job, element: str, effect: EffectName, margin: Margin, filters: Filters
) -> Unknown:
    device, scene, table, region = job.device, job.scene, job.table, job.region
    given = scene.elements[element]
    wish = given.wishes()[effect]
    bare = references(device, table, scene.motion(element, device.motion).penetration)[effect]
    felt = bare / _share(device, filters, effect)
    high = BOUNDLESS * bare if wish.high is None else abs(wish.high)
    low = wish.low if wish.kind == "range" and wish.low else min(NOTHING * bare, high)
    if wish.sign < 0:
        # The bare device must keep the same margin downwards: M >= -m_low/g, B >= -b_low/g.
        lowest = {"mass": region.box.mass[0], "damping": region.box.damping[0]}[effect]
        most = min(lowest / margin.gain, (1 - REMAINS) * min(bare, felt))
        high = most if wish.high is None else min(high, most)
    return Unknown(
        element=element,
        effect=effect,
        sign=wish.sign,
        low=low,
        high=high,
        wish=wish,
        reference=felt,
        weber=getattr(table, effect).value,
        level=0 if wish.kind == "value" else given.priority,
    )


def _share(device: Device, filters: Filters, effect: EffectName) -> float:
    """The part of a commanded effect that a hand feels as such; all of a spring."""
    if effect == "stiffness":
        return 1.0
    shares = Shares.of(device, filters)
    return max((shares.damping if effect == "damping" else shares.mass).mean, BARELY_FELT)


def _moment(
    device: Device, scene: Scene, subset: tuple[str, ...], unknowns: tuple[Unknown, ...]
) -> Moment:
    motions = {name: scene.motion(name, device.motion) for name in subset}
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
            tuple(motions[unknowns[i].element].speed for i in b),
            tuple(motions[unknowns[i].element].acceleration for i in m),
        ),
        one_sided=any(scene.elements[name].one_sided for name in subset),
    )
