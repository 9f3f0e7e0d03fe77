"""Loops: what is asked of a device and its filters, built once and kept for every element.

The loops of the corners and delays belong to the device, and so does what one effect may be alone:
an element only adds its own wishes and motion. What was computed for one element is therefore kept
for the next.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from identification import Device
from tune.documents.effects import EffectName, Effects
from tune.loop.filters import Filters
from tune.loop.loop import Loop, stack_loops
from tune.optimisation.region import Region
from tune.rendering.ripple import force_ripple
from tune.stability.search import last_within
from tune.stability.verdict import stable_values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loops:
    """The loops of a region with one set of filters.

    Attributes:
        region: of device and hand.
        filters: of the controller.
        present: loops of the corners of the region at every delay the device may have.
        late: the same with up to the margin's extra delay as well.
        nominal: the device alone at its best estimate and longest delay, for the ripple.
    """

    region: Region
    filters: Filters
    present: tuple[Loop, ...]
    late: tuple[Loop, ...]
    nominal: Loop
    _latest: dict[float, tuple[Loop, ...]] = field(
        default_factory=dict[float, tuple[Loop, ...]], init=False, repr=False
    )
    _between: dict[float, tuple[Loop, ...]] = field(
        default_factory=dict[float, tuple[Loop, ...]], init=False, repr=False
    )
    _ends: dict[tuple[EffectName, int, str, float], float] = field(
        default_factory=dict[tuple[EffectName, int, str, float], float], init=False, repr=False
    )

    @classmethod
    def of(cls, device: Device, region: Region, filters: Filters, extra: float) -> Loops:
        """The loops of a device.

        Args:
            device: whose best estimate the ripple is for.
            region: of it and the hand.
            filters: of the controller.
            extra: samples of delay on top of the device's, at most.
        """
        loops = region.loops(filters, extra)
        later = (device.delay.high - device.delay.value) / device.sample_time.value
        return cls(
            region=region,
            filters=filters,
            present=_side_by_side([one.loop for one in loops if not one.beyond]),
            late=_side_by_side([one.loop for one in loops]),
            nominal=Loop.from_parts(device, filters, extra_delay_samples=later),
        )

    def latest(self, extra: float) -> tuple[Loop, ...]:
        """Loops of all corners at the device's longest delay and ``extra`` samples more."""
        if extra not in self._latest:
            self._latest[extra] = _side_by_side(self.region.latest(self.filters, extra))
        return self._latest[extra]

    def between(self, extra: float) -> tuple[Loop, ...]:
        """The late loops, and those half-way between the samples of the margin's extra delay."""
        if extra not in self._between:
            halves = [self.latest(part - 0.5) for part in range(1, int(extra) + 1)]
            late = [*self.late, *(loop for each in halves for loop in each)]
            self._between[extra] = _side_by_side(late)
        return self._between[extra]

    def end_alone(self, effect: EffectName, sign: int, *, late: bool) -> float:
        """The size of one effect, felt alone, up to which it is stable; 0 or inf possible.

        Its gain margin is this over its size, because a gain only scales it.
        """
        which, loops = ("late", self.late) if late else ("present", self.present)
        return self._kept((effect, sign, which, 0.0), lambda: _end(loops, effect, sign))

    def end_alone_at(self, effect: EffectName, sign: int, extra: float) -> float:
        """Stable size of one effect, felt alone, ``extra`` samples beyond the longest delay."""
        return self._kept(
            (effect, sign, "latest", extra), lambda: _end(self.latest(extra), effect, sign)
        )

    def quiet_alone(
        self, effect: EffectName, sign: int, *, resolution: float, limit: float, top: float
    ) -> float:
        """The size of one effect, felt alone, up to which the ripple keeps to its limit.

        Args:
            effect: which.
            sign: -1 where it is taken away.
            resolution: of the encoder, m (rad).
            limit: N rms (N·m).
            top: sizes looked at; inf is the answer where all of them keep to it.
        """

        def noise(size: float) -> float:
            effects = Effects(**{effect: sign * size})
            return float(force_ripple(self.nominal, effects, resolution))

        key = (effect, sign, f"ripple {resolution!r} {limit!r}", top)
        return self._kept(key, lambda: last_within(noise, limit, top))

    def _kept(self, key: tuple[EffectName, int, str, float], compute: Callable[[], float]) -> float:
        if key not in self._ends:
            self._ends[key] = compute()
        return self._ends[key]


def _side_by_side(loops: Sequence[Loop]) -> tuple[Loop, ...]:
    """One loop of all that are free and one of all whose position is bound."""
    alike = [[loop for loop in loops if loop.grounded == grounded] for grounded in (False, True)]
    return tuple(stack_loops(group) for group in alike if group)


def _end(loops: Sequence[Loop], effect: EffectName, sign: int) -> float:
    """Least end, over all loops, of the stable sizes that are connected to nothing."""
    ends: list[float] = []
    for loop in loops:
        low, high = stable_values(loop, effect, sign=sign)
        ends.append(float(np.min(np.where(low[0] == 0, high[0], 0.0))))
    return min(ends)
