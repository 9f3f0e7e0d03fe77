"""Region: everything a profile must hold for, as the loops of its corners.

The corners propose; that the whole region between them holds is for the certificate to prove, and
where it finds a worse point, that point joins the region as one more loop. One file: corners and
later points become loops in the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from identification import Box, Device, Mode, Quantity
from tune.documents.errors import LoopError
from tune.documents.scene import Hand
from tune.loop.filters import Filters
from tune.loop.loop import Loop
from tune.loop.mechanism import HandNumbers, ModeNumbers
from tune.loop.sampled_plant import LONGEST_DELAY, WHOLE, SampledPlant


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantPoint:
    """A point of the uncertain region: one device with one hand, SI units.

    Attributes:
        position_stiffness: slope of the device's own force by position, N/m.
        modes: (frequency in Hz, damping ratio) of each mode of the mechanism.
        hand: (mass, damping, stiffness), or None for the device alone.
    """

    mass: float
    damping: float
    sample_time: float
    delay: float
    position_stiffness: float = 0.0
    modes: tuple[tuple[float, float], ...] = ()
    current_lag: float = 0.0
    hand: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayedLoops:
    """Loops at one delay, and by how many samples it exceeds the longest the device may have."""

    loop: Loop
    beyond: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """Box of the device, box of the hand, and points found later.

    Attributes:
        box: of the device, simultaneous.
        modes: of the mechanism, each with its intervals.
        current_lag: s, or None.
        presliding: stiffness of friction that holds before it slides, N/m above zero, or None.
        hand: grips; the device alone is in the region in any case.
        found: points between the corners that were worse than they.

    Plants are sampled when first asked for and kept, whatever the filters around them.
    """

    box: Box
    modes: tuple[Mode, ...] = ()
    current_lag: Quantity | None = None
    presliding: tuple[float, float] | None = None
    hand: Hand | None = None
    found: tuple[PlantPoint, ...] = ()
    _plants: dict[tuple[float, float], tuple[SampledPlant, ...]] = field(
        default_factory=dict[tuple[float, float], tuple[SampledPlant, ...]],
        init=False,
        repr=False,
        compare=False,
    )

    @classmethod
    def of(cls, device: Device, hand: Hand | None, *, extra: int) -> Region:
        """The simultaneous box of a device, to be judged with up to ``extra`` samples of delay.

        Raises:
            LoopError: a delay too long for its margin to be judged.
        """
        box = device.simultaneous_box()
        longest = box.delay[1] / box.sample_time[0]
        if longest > LONGEST_DELAY - extra:
            raise LoopError(
                f"delay: up to {box.delay[1]:g} s is {longest:.4g} samples of "
                f"{box.sample_time[0]:g} s, at most {LONGEST_DELAY - extra} can be tuned. State "
                "the sample time of the haptic loop and the true delay, or tune for a longer "
                "sample time"
            )
        held = device.presliding_stiffness
        return cls(
            box=box,
            modes=device.modes,
            current_lag=device.current_lag,
            presliding=None if held is None else (held.low, held.high),
            hand=hand,
        )

    def loops(self, filters: Filters, extra: float) -> tuple[DelayedLoops, ...]:
        """Loops of all corners at the ends of the delay, at every whole sample between and beyond.

        Args:
            filters: of the controller.
            extra: samples of delay on top of the device's, at most.
        """
        late: list[DelayedLoops] = []
        for step in dict.fromkeys(self.box.sample_time):
            first, last = (_snapped(delay / step) for delay in self.box.delay)
            for samples in _delays(first, last, extra):
                beyond = max(0.0, samples - last)
                late += [
                    DelayedLoops(loop=Loop.around(plant, filters), beyond=beyond)
                    for plant in self._at(step, samples)
                ]
        for point in self.found:
            samples = _snapped(point.delay / point.sample_time)
            beyond = max(0.0, samples - _snapped(self.box.delay[1] / point.sample_time))
            if beyond <= extra:
                plant = self._plant([point], samples)
                late.append(DelayedLoops(loop=Loop.around(plant, filters), beyond=beyond))
        return tuple(late)

    def latest(self, filters: Filters, extra: float) -> tuple[Loop, ...]:
        """Loops of all corners at the device's longest delay and ``extra`` samples more."""
        return tuple(
            Loop.around(plant, filters)
            for step in dict.fromkeys(self.box.sample_time)
            for plant in self._at(step, _snapped(self.box.delay[1] / step) + extra)
        )

    def _at(self, step: float, samples: float) -> tuple[SampledPlant, ...]:
        """All corners at one sample time and delay: the device alone, held by friction, in hand."""
        if (step, samples) not in self._plants:
            points = list(self._corners(step, samples * step))
            alike: dict[tuple[bool, bool], list[PlantPoint]] = {}
            for point in points:
                key = (point.hand is None, point.position_stiffness == 0)
                alike.setdefault(key, []).append(point)
            self._plants[step, samples] = tuple(
                self._plant(each, samples) for each in alike.values()
            )
        return self._plants[step, samples]

    def _plant(self, points: Sequence[PlantPoint], samples: float) -> SampledPlant:
        """Spots of one sample time and delay, all in a hand or all without, all sprung or none."""
        grips = [point.hand for point in points if point.hand is not None]
        return SampledPlant.from_numbers(
            mass=np.array([point.mass for point in points]),
            damping=np.array([point.damping for point in points]),
            sample_time=points[0].sample_time,
            delay_samples=samples,
            modes=tuple(
                ModeNumbers(
                    frequency_hz=np.array([point.modes[index][0] for point in points]),
                    damping_ratio=np.array([point.modes[index][1] for point in points]),
                    at_encoder=mode.at_encoder,
                    at_handle=mode.at_handle,
                )
                for index, mode in enumerate(self.modes)
            ),
            current_lag=np.array([point.current_lag for point in points]),
            position_stiffness=np.array([point.position_stiffness for point in points]),
            hand=(
                None
                if not grips
                else HandNumbers(
                    mass=np.array([grip[0] for grip in grips]),
                    damping=np.array([grip[1] for grip in grips]),
                    stiffness=np.array([grip[2] for grip in grips]),
                )
            ),
        )

    def _corners(self, step: float, delay: float) -> Iterator[PlantPoint]:
        """Every corner at one sample time and delay; modes shift and are damped all together."""
        ways = ((),)
        if self.modes:
            ways = tuple(
                tuple(
                    (_end(mode.frequency_hz, fast), _end(mode.damping_ratio, damped))
                    for mode in self.modes
                )
                for fast, damped in product((False, True), repeat=2)
            )
        grips: list[tuple[float, float, float] | None] = [None]
        if self.hand is not None:
            hand = self.hand
            grips += list(product(_ends(hand.mass), _ends(hand.damping), _ends(hand.stiffness)))
        lags = (0.0,) if self.current_lag is None else _ends(self.current_lag)
        masses, dampings = dict.fromkeys(self.box.mass), dict.fromkeys(self.box.damping)
        slopes = dict.fromkeys(self.box.position_stiffness)
        if self.presliding is not None:
            pairs = zip(self.box.position_stiffness, self.presliding, strict=True)
            slopes |= dict.fromkeys(own + held for own, held in pairs)
        for mass, damping, slope, way, lag, grip in product(
            masses, dampings, slopes, dict.fromkeys(ways), lags, grips
        ):
            yield PlantPoint(
                mass=mass,
                damping=damping,
                sample_time=step,
                delay=delay,
                position_stiffness=slope,
                modes=way,
                current_lag=lag,
                hand=grip,
            )


def _end(interval: Quantity, upper: bool) -> float:  # noqa: FBT001 - one side or the other
    return interval.high if upper else interval.low


def _ends(interval: Quantity) -> tuple[float, ...]:
    """Both ends of an interval, or the one number."""
    return tuple(dict.fromkeys((interval.low, interval.high)))


def _snapped(samples: float) -> float:
    """A delay in samples; one that no clock could tell from a whole number is that number."""
    whole = float(round(samples))
    return whole if abs(samples - whole) <= WHOLE * max(1.0, samples) else float(samples)


def _delays(first: float, last: float, extra: float) -> list[float]:
    """Both ends of the delay, the whole samples between them and beyond, and the very last."""
    whole = range(int(np.ceil(first)), int(np.floor(last + extra)) + 1)
    return sorted({first, last, last + extra, *map(float, whole)})
