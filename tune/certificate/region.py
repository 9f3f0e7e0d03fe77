"""Region: everything that is not known exactly, as one box of intervals, and the points in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification import counted
from tune.certificate.affine import FloatArray
from tune.documents.profile import Design, HandBox, HandPlace
from tune.documents.scene import EFFECT_NAMES

Interval = tuple[float, float]
#: Stiffness, damping and mass, each a number or one of each cell, shape (cells,).
Sizes = tuple[float | FloatArray, float | FloatArray, float | FloatArray]
#: Settings examined in one run: more would take memory and save no time.
_AT_ONCE = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class ModePoint:
    """One vibration mode."""

    frequency_hz: float  # without damping, Hz
    damping_ratio: float  # ζ
    at_encoder: float  # e, participation at motor and encoder
    at_handle: float  # h, participation where the hand holds


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One way everything may be."""

    mass: float  # rigid mass, kg
    damping: float  # N·s/m
    sample_time: float  # s
    delay_samples: float  # delay from command to measurement in samples, any real number from 0 on
    modes: tuple[ModePoint, ...] = ()  # vibration modes of the mechanism
    hand: HandPlace | None = None  # the grip; None is no hand
    current_lag: float = 0.0  # time constant of the current loop, s; 0 is none
    position_stiffness: float = 0.0  # of the device's own force by position, N/m; 0 is none

    @property
    def plain(self) -> bool:
        """A rigid mass on a damper, whole samples late: the plant of the printed equation."""
        return (
            not self.modes
            and self.hand is None
            and self.current_lag == 0
            and self.position_stiffness == 0
            and self.delay_samples == int(self.delay_samples)
        )

    @property
    def grounded(self) -> bool:
        """A spring of the device or of the hand binds the position."""
        return self.position_stiffness != 0 or (self.hand is not None and self.hand.stiffness > 0)

    def words(self) -> str:
        """The point for people."""
        parts = [
            f"mass {self.mass:.6g}",
            f"damping {self.damping:.6g}",
            f"sample time {self.sample_time:.6g} s",
            f"delay {counted(f'{self.delay_samples:.6g}', 'sample')}",
        ]
        if self.position_stiffness:
            parts.append(f"position stiffness {self.position_stiffness:.6g}")
        if self.current_lag:
            parts.append(f"current lag {self.current_lag:.6g} s")
        parts += [
            f"mode at {mode.frequency_hz:.6g} Hz damped {mode.damping_ratio:.4g}"
            for mode in self.modes
        ]
        if self.hand is not None:
            parts.append(
                f"hand of mass {self.hand.mass:.4g}, damping {self.hand.damping:.4g}, "
                f"stiffness {self.hand.stiffness:.4g}"
            )
        return ", ".join(parts)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What the controller plays, by which estimates of velocity and acceleration.

    Velocity (z-1)/(Tz) times a filter of order one, (1-a)z/(z-a), a = exp(-2π·f·T), or of order
    two with the poles exp(-2π·f·T·(ζ ± j√(1-ζ²))), any of unit gain at z = 1; or the mean over
    a window of n samples, (z^n - 1)/(nTz^n). Acceleration ((z-1)/(Tz))² times such a filter. Orders
    three and four have the two poles and a once or twice. A tracking filter of two states more than
    the order k of the derivative is carried on by its lag: times 1 + ℓ(z-1)/z, ℓ = k/2 + Σ p/(1-p)
    over its poles p.
    """

    stiffness: float  # N/m
    damping: float  # N·s/m
    mass: float  # kg
    velocity_filter_hz: float | None  # cut-off, Hz, or None for no filter
    acceleration_filter_hz: float | None  # cut-off, Hz, or None for no filter
    velocity_filter_order: int = 1  # number of poles
    acceleration_filter_order: int = 2  # number of poles
    velocity_filter: str = "low-pass"  # or "tracking"
    acceleration_filter: str = "low-pass"  # or "tracking"
    filter_damping_ratio: float = 1.0  # ζ of the first two poles; at 1 both are the same
    velocity_window_samples: int | None = None  # samples of a window instead of a velocity filter

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Stiffness, N/m, damping, N·s/m, and mass, kg."""
        return self.stiffness, self.damping, self.mass

    def estimate(self, power: int) -> tuple[float | None, int, bool]:
        """Of the derivative of that order: (cut-off, number of poles, whether it is carried on)."""
        if power == 1:
            kind, order = self.velocity_filter, self.velocity_filter_order
            cutoff_hz = self.velocity_filter_hz
        else:
            kind, order = self.acceleration_filter, self.acceleration_filter_order
            cutoff_hz = self.acceleration_filter_hz
        return cutoff_hz, order, kind == "tracking" and order == power + 2


def groups_of_equal_effects(settings: Sequence[Setting]) -> list[list[int]]:
    """Numbers of the settings that play the same effects, so many at most that suit one run."""
    groups: dict[tuple[bool, ...], list[int]] = {}
    for number, setting in enumerate(settings):
        groups.setdefault(tuple(map(bool, setting.sizes)), []).append(number)
    return [
        numbers[start : start + _AT_ONCE]
        for numbers in groups.values()
        for start in range(0, len(numbers), _AT_ONCE)
    ]


def setting_of(design: Design, combination: tuple[str, ...]) -> Setting | None:
    """The sum of effects of some elements; None if nothing acts."""
    chosen = [design.elements[name] for name in combination]
    totals = {name: sum(getattr(element, name) for element in chosen) for name in EFFECT_NAMES}
    return Setting(**totals, **design.loop.filter_settings()) if any(totals.values()) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeRegion:
    """One vibration mode: intervals of frequency (Hz) and damping ratio, its participations."""

    frequency_hz: Interval
    damping_ratio: Interval
    at_encoder: float
    at_handle: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A box of devices, hands and delays."""

    mass: Interval  # kg
    damping: Interval  # N·s/m
    sample_time: Interval  # s
    delay: Interval  # of the device, s; extra samples of delay come on top
    modes: tuple[ModeRegion, ...] = ()  # vibration modes
    current_lag: Interval = (0.0, 0.0)  # s
    position_stiffness: Interval = (0.0, 0.0)  # of the device's own force; positive, or none
    hand: HandBox | None = None  # grips; None is no hand

    @property
    def grounded(self) -> bool:
        """Whether a spring of device or hand holds the position, everywhere in the region."""
        return self.position_stiffness[0] > 0 or (
            self.hand is not None and self.hand.stiffness[0] > 0
        )

    def words(self, combination: tuple[str, ...]) -> str:
        """Elements that are felt at once in this region, for people."""
        return " + ".join(combination) + (" in a hand" if self.hand is not None else "")

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
        """The point with the given value of every side and samples of delay on top."""
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

    def reactive(self) -> tuple[int, int] | None:
        """Places among the sides of a mass and a spring that act at the same place."""
        if self.hand is None:
            return None
        # At one frequency they act by their reactance k - m·ω² only, so that of all their pairs
        # those on the way from heaviest and softest to lightest and stiffest are enough.
        return (0 if self.hand.mass == (0.0, 0.0) and not self.modes else 6), 8

    def merged(self) -> Region:
        """This region in fewer dimensions: a grip on a rigid device adds to all it has."""
        if self.hand is None or self.modes:
            return self
        return replace(
            self,
            mass=_sum(self.mass, self.hand.mass),
            damping=_sum(self.damping, self.hand.damping),
            position_stiffness=(0.0, 0.0),
            hand=HandBox(
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
    hand = HandBox(**{name: (each.low, each.high) for name, each in design.hand})
    return (*alone, *(replace(each, hand=hand) for each in alone))


def _sum(a: Interval, b: Interval) -> Interval:
    if b == (0.0, 0.0):
        return a
    # One step outwards against rounding of the sums.
    return float(np.nextafter(a[0] + b[0], -np.inf)), float(np.nextafter(a[1] + b[1], np.inf))
