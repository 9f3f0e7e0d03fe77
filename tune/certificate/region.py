"""Region: everything that is not known exactly, as one box of intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tune.certificate.affine import FloatArray
from tune.certificate.point import ModePoint, Point
from tune.documents.certified import HandPlace
from tune.documents.profile import Design

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeRegion:
    """One vibration mode: intervals of frequency (Hz) and damping ratio, its participations."""

    frequency_hz: Interval
    damping_ratio: Interval
    at_encoder: float
    at_handle: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HandRegion:
    """Intervals of a grip: kg, N·s/m, N/m."""

    mass: Interval
    damping: Interval
    stiffness: Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A box of devices, hands and delays.

    Attributes:
        mass: kg.
        damping: N·s/m.
        sample_time: s.
        delay: of the device, s; extra samples of delay come on top.
        modes: vibration modes.
        current_lag: s.
        position_stiffness: of the device's own force by position, N/m; positive, or none.
        hand: grips; None is no hand.
    """

    mass: Interval
    damping: Interval
    sample_time: Interval
    delay: Interval
    modes: tuple[ModeRegion, ...] = ()
    current_lag: Interval = (0.0, 0.0)
    position_stiffness: Interval = (0.0, 0.0)
    hand: HandRegion | None = None

    @property
    def grounded(self) -> bool:
        """Whether a spring of device or hand holds the position, everywhere in the region."""
        return self.position_stiffness[0] > 0 or (
            self.hand is not None and self.hand.stiffness[0] > 0
        )

    def words(self, moment: tuple[str, ...]) -> str:
        """Elements that are felt at once in this region, for people."""
        return " + ".join(moment) + (" in a hand" if self.hand is not None else "")

    def sides(self) -> tuple[Interval, ...]:
        """Every interval, in the order that `point` reads."""
        hand = self.hand
        return (
            self.mass,
            self.damping,
            self.sample_time,
            self.delay,
            self.current_lag,
            self.position_stiffness,
            *((hand.mass, hand.damping, hand.stiffness) if hand is not None else ()),
            *(side for mode in self.modes for side in (mode.frequency_hz, mode.damping_ratio)),
        )

    def point(self, values: FloatArray, extra: float) -> Point:
        """The point with the given value of every side and samples of delay on top.

        Values have shape (sides,), in the order of `sides`.
        """
        mass, damping, step, delay, lag, slope, *rest = (float(value) for value in values)
        hand = None
        if self.hand is not None:
            hand = HandPlace(mass=rest[0], damping=rest[1], stiffness=rest[2])
            rest = rest[3:]
        samples = delay / step + extra
        whole = round(samples)
        return Point(
            mass=mass,
            damping=damping,
            sample_time=step,
            # A quotient of two rounded numbers that is meant to be whole.
            delay_samples=float(whole) if abs(samples - whole) < 1e-12 * (1 + whole) else samples,
            hand=hand,
            current_lag=lag,
            position_stiffness=slope,
            modes=tuple(
                ModePoint(
                    frequency_hz=rest[2 * i],
                    damping_ratio=rest[2 * i + 1],
                    at_encoder=mode.at_encoder,
                    at_handle=mode.at_handle,
                )
                for i, mode in enumerate(self.modes)
            ),
        )

    def middle(self) -> FloatArray:
        """The middle of every side, shape (sides,)."""
        return np.array([(low + high) / 2 for low, high in self.sides()])

    def merged(self) -> Region:
        """This region in fewer dimensions: a grip on a rigid device adds to all it has."""
        if self.hand is None or self.modes:
            return self
        return replace(
            self,
            mass=_sum(self.mass, self.hand.mass),
            damping=_sum(self.damping, self.hand.damping),
            position_stiffness=(0.0, 0.0),
            hand=HandRegion(
                mass=(0.0, 0.0),
                damping=(0.0, 0.0),
                stiffness=_sum(self.hand.stiffness, self.position_stiffness),
            ),
        )


def regions_of(design: Design) -> tuple[Region, ...]:
    """The device alone, held by its friction before it slides, and both in the box of hands."""
    device = design.device
    box = device.simultaneous_box()
    lag = device.current_lag
    bare = Region(
        mass=box.mass,
        damping=box.damping,
        sample_time=box.sample_time,
        delay=box.delay,
        modes=tuple(
            ModeRegion(
                frequency_hz=(mode.frequency_hz.low, mode.frequency_hz.high),
                damping_ratio=(mode.damping_ratio.low, mode.damping_ratio.high),
                at_encoder=mode.at_encoder,
                at_handle=mode.at_handle,
            )
            for mode in device.modes
        ),
        current_lag=(0.0, 0.0) if lag is None else (lag.low, lag.high),
        position_stiffness=box.position_stiffness,
    )
    alone = (bare,)
    held = device.presliding_stiffness
    if held is not None:
        low, high = box.position_stiffness
        alone += (replace(bare, position_stiffness=(low + held.low, high + held.high)),)
    if design.hand is None:
        return alone
    hand = HandRegion(
        mass=(design.hand.mass.low, design.hand.mass.high),
        damping=(design.hand.damping.low, design.hand.damping.high),
        stiffness=(design.hand.stiffness.low, design.hand.stiffness.high),
    )
    return (*alone, *(replace(each, hand=hand) for each in alone))


def _sum(a: Interval, b: Interval) -> Interval:
    if b == (0.0, 0.0):
        return a
    # One step outwards against rounding of the sums.
    return float(np.nextafter(a[0] + b[0], -np.inf)), float(np.nextafter(a[1] + b[1], np.inf))
