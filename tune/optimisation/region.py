"""Region: everything a profile must hold for, as the loops of its corners.

The corners propose; that the whole region between them holds is for the certificate to prove, and
where it finds a worse point, that point joins the region as one more loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain, product
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np

from identification import Box, Device, Mode, Quantity
from tune.documents import LoopError
from tune.documents.scene import EffectName, Effects, Hand
from tune.loop.loop import Filters, Loop, stack_loops
from tune.loop.plant import LONGEST_DELAY, WHOLE, HandNumbers, ModeNumbers, SampledPlant
from tune.loop.polynomials import FloatArray
from tune.rendering import force_ripple
from tune.stability.verdict import last_within, stable_values

_Given = ParamSpec("_Given")
_Answer = TypeVar("_Answer")


def remembered(function: Callable[_Given, _Answer]) -> Callable[_Given, _Answer]:
    """The function, with its last answers kept; devices, which are frozen, may be asked about."""
    return cast("Callable[_Given, _Answer]", lru_cache(maxsize=8)(function))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantPoint:
    """A point of the uncertain region: one device with one hand, SI units."""

    mass: float
    damping: float
    sample_time: float
    delay: float
    position_stiffness: float = 0.0  # slope of the device's own force by position, N/m
    # (frequency in Hz, damping ratio) of each mode of the mechanism
    modes: tuple[tuple[float, float], ...] = ()
    current_lag: float = 0.0
    # (mass, damping, stiffness), or None for the device alone
    hand: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayedLoops:
    """Loops at one delay, and by how many samples it exceeds the longest the device may have."""

    loop: Loop
    beyond: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """Box of the device, box of the hand, and points found later."""

    box: Box
    modes: tuple[Mode, ...] = ()
    current_lag: Quantity | None = None
    # stiffness of friction that holds before it slides, N/m above zero, or None
    presliding: tuple[float, float] | None = None
    hand: Hand | None = None  # grips; the device alone is in the region in any case
    found: tuple[PlantPoint, ...] = ()  # points between the corners that were worse than they
    # Plants are sampled when first asked for and kept, whatever the filters around them.
    _plants: dict[tuple[float, float], tuple[SampledPlant, ...]] = field(
        default_factory=dict[tuple[float, float], tuple[SampledPlant, ...]],
        init=False,
        repr=False,
        compare=False,
    )

    @staticmethod
    @remembered
    def of(device: Device, hand: Hand | None, *, extra: int) -> Region:
        """The simultaneous box of a device, to be judged with up to ``extra`` samples of delay.

        Kept, with its plants, for who asks about the same device again. Raises LoopError for a
        delay too long for its margin to be judged.
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
        return Region(
            box=box,
            modes=device.modes,
            current_lag=device.current_lag,
            presliding=None if held is None else (held.low, held.high),
            hand=hand,
        )

    def loops(self, filters: Filters, extra: float) -> tuple[DelayedLoops, ...]:
        """Loops of all corners at both ends of the delay and every whole sample up to the extra."""
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
            alike: dict[tuple[bool, bool], list[PlantPoint]] = {}
            for point in self._corners(step, samples * step):
                key = (point.hand is None, point.position_stiffness == 0)
                alike.setdefault(key, []).append(point)
            self._plants[step, samples] = tuple(
                self._plant(each, samples) for each in alike.values()
            )
        return self._plants[step, samples]

    def _plant(self, points: Sequence[PlantPoint], samples: float) -> SampledPlant:
        """Spots of one sample time and delay, all in a hand or all without, all sprung or none."""

        def column(name: str) -> FloatArray:
            return np.array([getattr(point, name) for point in points])

        grips = [point.hand for point in points if point.hand is not None]
        hand = [np.array(numbers) for numbers in zip(*grips, strict=True)]
        return SampledPlant.from_numbers(
            mass=column("mass"),
            damping=column("damping"),
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
            current_lag=column("current_lag"),
            position_stiffness=column("position_stiffness"),
            hand=HandNumbers(mass=hand[0], damping=hand[1], stiffness=hand[2]) if hand else None,
        )

    def _corners(self, step: float, delay: float) -> Iterator[PlantPoint]:
        """Every corner at one sample time and delay, and the devices that were worse than they."""
        # Modes shift and are damped all together.
        ends = [(_pair(m.frequency_hz), _pair(m.damping_ratio)) for m in self.modes]
        ways = dict.fromkeys(
            tuple((frequency[fast], ratio[damped]) for frequency, ratio in ends)
            for fast, damped in product((0, 1), repeat=2)
        )
        grips: list[tuple[float, float, float] | None] = [None]
        if (hand := self.hand) is not None:
            grips += product(_ends(hand.mass), _ends(hand.damping), _ends(hand.stiffness))
        lags = (0.0,) if self.current_lag is None else _ends(self.current_lag)
        masses, dampings = dict.fromkeys(self.box.mass), dict.fromkeys(self.box.damping)
        slopes = dict.fromkeys(self.box.position_stiffness)
        if self.presliding is not None:
            pairs = zip(self.box.position_stiffness, self.presliding, strict=True)
            slopes |= dict.fromkeys(own + held for own, held in pairs)
        for mass, damping, slope, way, lag, grip in product(
            masses, dampings, slopes, ways, lags, grips
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
        yield from (replace(each, sample_time=step, delay=delay) for each in self.found)


@remembered
def _nominal_plants(device: Device, hand: Hand | None) -> tuple[SampledPlant, ...]:
    """The device at its best estimate and longest delay, alone and in the hand if there is one."""
    later = (device.delay.high - device.delay.value) / device.sample_time.value
    grips = (None,) if hand is None else (None, hand)
    return tuple(SampledPlant.of(device, grip, later) for grip in grips)


def _pair(interval: Quantity) -> tuple[float, float]:
    return interval.low, interval.high


def _ends(interval: Quantity) -> tuple[float, ...]:
    """Both ends of an interval, or the one number."""
    return tuple(dict.fromkeys(_pair(interval)))


def _snapped(samples: float) -> float:
    """A delay in samples; one that no clock could tell from a whole number is that number."""
    whole = float(round(samples))
    return whole if abs(samples - whole) <= WHOLE * max(1.0, samples) else float(samples)


def _delays(first: float, last: float, extra: float) -> list[float]:
    """Both ends of the delay, the whole samples between them and beyond, and the very last."""
    whole = range(int(np.ceil(first)), int(np.floor(last + extra)) + 1)
    return sorted({first, last, last + extra, *map(float, whole)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loops:
    """The loops of a region with one set of filters, built once and kept for every element."""

    region: Region
    filters: Filters
    # loops of the corners of the region at every delay the device may have, with up to the margin's
    # extra delay on top of it
    late: tuple[Loop, ...]
    nominal: Loop  # the device alone at its best estimate and longest delay, for the ripple
    held: Loop | None  # the same in the scene's hand; None without one
    _each: tuple[DelayedLoops, ...] = field(repr=False)
    # They belong to the device, and so does what one effect may be alone: an element only adds its
    # own wishes and motion.
    _known: dict[tuple[object, ...], Any] = field(
        default_factory=dict[tuple[object, ...], Any], init=False, repr=False
    )

    @staticmethod
    @remembered
    def of(device: Device, region: Region, filters: Filters, extra: float) -> Loops:
        """The loops of a device, with up to ``extra`` samples of delay on top of its own."""
        loops = region.loops(filters, extra)
        plants = _nominal_plants(device, region.hand)
        nominal, *held = (Loop.around(plant, filters) for plant in plants)
        return Loops(
            region=region,
            filters=filters,
            late=_side_by_side([one.loop for one in loops]),
            nominal=nominal,
            held=held[0] if held else None,
            _each=loops,
        )

    @property
    def present(self) -> tuple[Loop, ...]:
        """The late loops without the margin's extra delay."""
        loops = (one.loop for one in self._each if not one.beyond)
        return self._kept(("present",), lambda: _side_by_side([*loops]))

    def ripple(self, effects: Effects, resolution: float) -> FloatArray:
        """Force ripple on the device alone or in the hand, whichever is more, N rms."""
        noise = force_ripple(self.nominal, effects, resolution)
        if self.held is None:
            return noise
        return np.maximum(noise, force_ripple(self.held, effects, resolution))

    def latest(self, extra: float) -> tuple[Loop, ...]:
        """Loops of all corners at the device's longest delay and ``extra`` samples more."""
        return self._kept(
            ("latest", extra), lambda: _side_by_side(self.region.latest(self.filters, extra))
        )

    def between(self, extra: float) -> tuple[Loop, ...]:
        """The late loops, and those half-way between the samples of the margin's extra delay."""
        halves = (self.latest(part - 0.5) for part in range(1, int(extra) + 1))
        return self._kept(
            ("between", extra), lambda: _side_by_side([*self.late, *chain.from_iterable(halves)])
        )

    def end_alone(self, effect: EffectName, sign: int, *, late: bool) -> float:
        """The size of one effect, felt alone, up to which it is stable; 0 or inf possible."""
        # The gain margin of a size is this over it, because a gain only scales it.
        which, loops = ("late", self.late) if late else ("present", self.present)

        def least_end() -> float:
            """Over all loops, of the stable sizes that are connected to nothing."""
            found = (stable_values(loop, effect, sign=sign) for loop in loops)
            return min(float(np.min(np.where(low[0] == 0, high[0], 0.0))) for low, high in found)

        return self._kept((effect, sign, which), least_end)

    def quiet_alone(
        self, effect: EffectName, sign: int, *, resolution: float, limit: float, top: float
    ) -> float:
        """The size of one effect, felt alone, up to which the ripple keeps to its limit, N rms."""

        def noise(size: float) -> float:
            effects = Effects(**{effect: sign * size})
            return float(self.ripple(effects, resolution))

        # Sizes up to the top are looked at; inf is the answer where all of them keep to it.
        key = (effect, sign, f"ripple {resolution!r} {limit!r}", top)
        return self._kept(key, lambda: last_within(noise, limit, top))

    def _kept(self, key: tuple[object, ...], compute: Callable[[], _Answer]) -> _Answer:
        if key not in self._known:
            self._known[key] = compute()
        return self._known[key]


def _side_by_side(loops: Sequence[Loop]) -> tuple[Loop, ...]:
    """One loop of all that are free and one of all whose position is bound."""
    alike = [[loop for loop in loops if loop.grounded == grounded] for grounded in (False, True)]
    return tuple(stack_loops(group) for group in alike if group)
