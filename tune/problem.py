"""The design problem of elements that share a moment: unknowns, moments, loops and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.effects import EFFECT_NAMES, EffectName, Effects
from tune.hand import hand_of
from tune.loop import Filters, Loop
from tune.perception import PerceptionTable, perceived_steps, references, value_at_steps
from tune.region import Region
from tune.scene import MARGINS, Margin, Scene, Wish
from tune.stacking import stacked

FloatArray = NDArray[np.float64]

#: Sizes below this part of the reference are as good as nothing: a ten-thousandth of a step.
NOTHING = 1e-5
#: Sizes above this multiple of the reference are no haptic effect on any device (46 steps at 34 %).
BOUNDLESS = 1e6
#: A device made lighter (less damped) keeps at least this part of what it has.
REMAINS = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """One effect of one element whose size is looked for.

    Attributes:
        element: name in the scene.
        effect: which of K, B, M.
        sign: -1 where something is taken away from the device.
        low: least size allowed, SI.
        high: largest size wanted or physically sensible.
        wish: what the scene says.
        reference: what the effect is compared with, SI.
        weber: Weber fraction.
        level: rank; wanted values are level 0, then the priorities of the elements.
    """

    element: str
    effect: EffectName
    sign: int
    low: float
    high: float
    wish: Wish
    reference: float
    weber: float
    level: int

    @property
    def label(self) -> str:
        """Name for messages and keys, element.effect."""
        return f"{self.element}.{self.effect}"

    def steps(self, size: float) -> float:
        """Perceived steps of a size."""
        return perceived_steps(self.sign * size, self.reference, self.weber)

    @property
    def goal(self) -> float:
        """Steps of a wanted value, 0 where as much as possible is wanted."""
        return self.steps(self.high) if self.wish.kind == "value" else 0.0

    def height(self, size: float) -> float:
        """What is raised: the steps, for a wanted value how many it falls short of, negative."""
        return self.steps(size) - self.goal

    def size_at(self, steps: float) -> float:
        """The size that is perceived as so many steps."""
        return self.sign * value_at_steps(steps, self.reference, self.weber, self.sign)


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Elements felt at once: which unknowns add up, and the motion of each element.

    Attributes:
        elements: names.
        members: indices of unknowns, for K, B and M.
        reach: (penetration, speed, acceleration) for each unknown, in the order of ``members``.
    """

    elements: tuple[str, ...]
    members: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
    reach: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


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
        present: loops of the corners of the region at every delay the device may have.
        late: the same with up to the margin's extra delay as well.
        nominal: the device alone at its best estimate and longest delay, for the ripple.
    """

    unknowns: tuple[Unknown, ...]
    moments: tuple[Moment, ...]
    margin: Margin
    region: Region
    filters: Filters
    present: tuple[Loop, ...]
    late: tuple[Loop, ...]
    nominal: Loop
    limits: Limits

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
    """

    device: Device
    scene: Scene
    table: PerceptionTable
    region: Region
    slack: float = 0.0

    @classmethod
    def of(cls, device: Device, scene: Scene, table: PerceptionTable) -> Job:
        """The job over the device's simultaneous box."""
        extra = max(margin.extra_delay_samples for margin in MARGINS.values())
        region = Region.of(device, hand_of(scene.hand, device.motion), extra=extra)
        return cls(device=device, scene=scene, table=table, region=region)


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
    device, scene, region = job.device, job.scene, job.region
    margin = MARGINS[scene.margin]
    if job.slack:
        margin = margin.model_copy(update={"gain": margin.gain * (1 + job.slack)})
    unknowns = tuple(
        _unknown(job, element, effect, margin)
        for element in elements
        for effect in scene.elements[element].wishes()
        if f"{element}.{effect}" not in gone
    )
    moments = tuple(
        _moment(device, scene, subset, unknowns)
        for subset in scene.subsets()
        if set(subset) <= set(elements) and any(u.element in subset for u in unknowns)
    )
    limit = device.force_limit
    loops = region.loops(filters, margin.extra_delay_samples)
    later = (device.delay.high - device.delay.value) / device.sample_time.value
    return Problem(
        unknowns=unknowns,
        moments=moments,
        margin=margin,
        region=region,
        filters=filters,
        present=_side_by_side([one.loop for one in loops if not one.beyond]),
        late=_side_by_side([one.loop for one in loops]),
        nominal=Loop.from_parts(device, filters, extra_delay_samples=later),
        limits=Limits(
            continuous_force=None if limit is None else limit.continuous,
            peak_force=None if limit is None else limit.peak,
            encoder_resolution=(
                None if device.encoder_resolution is None else device.encoder_resolution.value
            ),
            ripple=scene.ripple_limit or job.table.threshold(device.motion),
        ),
    )


def _side_by_side(loops: Sequence[Loop]) -> tuple[Loop, ...]:
    """One loop of all that are free and one of all that a hand holds."""
    alike = [[loop for loop in loops if loop.held == held] for held in (False, True)]
    return tuple(stacked(group) for group in alike if group)


def _unknown(job: Job, element: str, effect: EffectName, margin: Margin) -> Unknown:
    device, scene, table, region = job.device, job.scene, job.table, job.region
    given = scene.elements[element]
    wish = given.wishes()[effect]
    reference = references(device, table, scene.motion(element, device.motion).penetration)[effect]
    high = BOUNDLESS * reference if wish.high is None else abs(wish.high)
    if wish.sign < 0:
        # The bare device must keep the same margin downwards: M >= -m_low/g, B >= -b_low/g.
        lowest = {"mass": region.box.mass[0], "damping": region.box.damping[0]}[effect]
        most = min(lowest / margin.gain, (1 - REMAINS) * reference)
        high = most if wish.high is None else min(high, most)
    low = wish.low if wish.kind == "range" and wish.low else NOTHING * reference
    return Unknown(
        element=element,
        effect=effect,
        sign=wish.sign,
        low=low,
        high=high,
        wish=wish,
        reference=reference,
        weber=getattr(table, effect).value,
        level=0 if wish.kind == "value" else given.priority,
    )


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
    )
