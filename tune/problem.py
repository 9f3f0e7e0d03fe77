"""The design problem of elements that share a moment: unknowns, moments, loops and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device
from tune.effects import EFFECT_NAMES, EffectName, Effects
from tune.errors import LoopError
from tune.loop import LONGEST_DELAY, Filters, Loop
from tune.perception import PerceptionTable, perceived_steps, references, value_at_steps
from tune.scene import MARGINS, Margin, Scene, Wish

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
class Region:
    """Everything a profile must hold for: corners of the box and whole delays.

    Attributes:
        mass: kg, shape (corners,).
        damping: N·s/m, shape (corners,).
        sample_time: s, shape (corners,).
        delays: whole samples the device's delay may be, without any extra.
    """

    mass: FloatArray
    damping: FloatArray
    sample_time: FloatArray
    delays: tuple[int, ...]

    @classmethod
    def of(cls, box: Box) -> Region:
        """Corners of the box, each once; a delay between two samples stands for both.

        Raises:
            LoopError: a delay too long for its margin to be judged.
        """
        corners = np.array(list(dict.fromkeys(product(box.mass, box.damping, box.sample_time))))
        first = int(np.floor(box.delay[0] / box.sample_time[1] + 1e-6))
        last = int(np.ceil(box.delay[1] / box.sample_time[0] - 1e-6))
        most = LONGEST_DELAY - max(margin.extra_delay_samples for margin in MARGINS.values())
        if last > most:
            raise LoopError(
                f"delay: up to {box.delay[1]:g} s is {last} samples of {box.sample_time[0]:g} s, "
                f"at most {most} can be tuned. State the sample time of the haptic loop and the "
                "true delay, or tune for a longer sample time"
            )
        return cls(
            mass=corners[:, 0],
            damping=corners[:, 1],
            sample_time=corners[:, 2],
            delays=tuple(range(first, last + 1)),
        )

    def loop(self, delay: int, filters: Filters) -> Loop:
        """The loops of all corners at one delay, shape (corners,)."""
        return Loop.from_numbers(
            mass=self.mass,
            damping=self.damping,
            sample_time=self.sample_time,
            delay_samples=delay,
            filters=filters,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Unknowns of elements that share moments, and everything that bounds them.

    Attributes:
        loops: by delay in samples, from the shortest to the longest with the extra, each of the
            corners of the region.
        nominal: the device at its best estimate, for the ripple.
    """

    unknowns: tuple[Unknown, ...]
    moments: tuple[Moment, ...]
    margin: Margin
    region: Region
    filters: Filters
    loops: dict[int, Loop]
    nominal: Loop
    limits: Limits

    def effects(self, moment: Moment, sizes: FloatArray) -> Effects:
        """The sum of effects of one moment; an effect no element has is absent."""
        total = [
            float(sum(self.unknowns[i].sign * sizes[i] for i in indices)) if indices else None
            for indices in moment.members
        ]
        return Effects(stiffness=total[0], damping=total[1], mass=total[2])

    def delays(self, extra: int) -> tuple[int, ...]:
        """Every whole delay of the device with up to ``extra`` more samples."""
        return tuple(range(self.region.delays[0], self.region.delays[-1] + extra + 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What is to be tuned: a scene on a device, with what is perceptible and where it must hold."""

    device: Device
    scene: Scene
    table: PerceptionTable
    region: Region

    @classmethod
    def of(cls, device: Device, scene: Scene, table: PerceptionTable) -> Job:
        """The job over the device's simultaneous box."""
        region = Region.of(device.simultaneous_box())
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
    last = region.delays[-1] + margin.extra_delay_samples
    return Problem(
        unknowns=unknowns,
        moments=moments,
        margin=margin,
        region=region,
        filters=filters,
        loops={d: region.loop(d, filters) for d in range(region.delays[0], last + 1)},
        nominal=Loop.from_numbers(
            mass=device.mass.value,
            damping=device.damping.value,
            sample_time=device.sample_time.value,
            delay_samples=region.delays[-1],
            filters=filters,
        ),
        limits=Limits(
            continuous_force=None if limit is None else limit.continuous,
            peak_force=None if limit is None else limit.peak,
            encoder_resolution=(
                None if device.encoder_resolution is None else device.encoder_resolution.value
            ),
            ripple=scene.ripple_limit or job.table.threshold(device.motion),
        ),
    )


def _unknown(job: Job, element: str, effect: EffectName, margin: Margin) -> Unknown:
    device, scene, table, region = job.device, job.scene, job.table, job.region
    given = scene.elements[element]
    wish = given.wishes()[effect]
    reference = references(device, table, scene.motion(element, device.motion).penetration)[effect]
    high = BOUNDLESS * reference if wish.high is None else abs(wish.high)
    if wish.sign < 0:
        # The bare device must keep the same margin downwards: M >= -m_low/g, B >= -b_low/g.
        lowest = {"mass": region.mass, "damping": region.damping}[effect].min()
        most = min(float(lowest) / margin.gain, (1 - REMAINS) * reference)
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
