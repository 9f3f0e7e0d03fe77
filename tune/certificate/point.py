"""A point of the uncertain region: one device, hand and loop, and what the controller plays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tune.certificate.affine import FloatArray
from tune.documents.certified import HandPlace
from tune.documents.profile import Design


@dataclass(frozen=True, slots=True, kw_only=True)
class ModePoint:
    """One vibration mode.

    Attributes:
        frequency_hz: without damping, Hz.
        damping_ratio: ζ.
        at_encoder: e, participation at motor and encoder.
        at_handle: h, participation where the hand holds.
    """

    frequency_hz: float
    damping_ratio: float
    at_encoder: float
    at_handle: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One way everything may be.

    Attributes:
        mass: rigid mass, kg.
        damping: N·s/m.
        sample_time: s.
        delay_samples: delay from command to measurement in samples, any real number from 0 on.
        modes: vibration modes of the mechanism.
        hand: the grip; None is no hand.
        current_lag: time constant of the current loop, s; 0 is none.
        position_stiffness: of the device's own force by position, N/m; 0 is none.
    """

    mass: float
    damping: float
    sample_time: float
    delay_samples: float
    modes: tuple[ModePoint, ...] = ()
    hand: HandPlace | None = None
    current_lag: float = 0.0
    position_stiffness: float = 0.0

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
            f"delay {self.delay_samples:.6g} samples",
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
    two with the poles exp(-2π·f·T·(ζ ± j√(1-ζ²))), either of unit gain at z = 1; or the mean over
    a window of n samples, (z^n - 1)/(nTz^n). Acceleration ((z-1)/(Tz))² times such a filter.

    Attributes:
        stiffness: N/m.
        damping: N·s/m.
        mass: kg.
        velocity_filter_hz: cut-off, Hz, or None for no filter.
        acceleration_filter_hz: cut-off, Hz, or None for no filter.
        velocity_filter_order: 1 or 2.
        acceleration_filter_order: 1 or 2.
        filter_damping_ratio: ζ of filters of order two; at 1 both poles are the same.
        velocity_window_samples: samples of a window instead of a velocity filter.
    """

    stiffness: float
    damping: float
    mass: float
    velocity_filter_hz: float | None
    acceleration_filter_hz: float | None
    velocity_filter_order: int = 1
    acceleration_filter_order: int = 2
    filter_damping_ratio: float = 1.0
    velocity_window_samples: int | None = None

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Stiffness, N/m, damping, N·s/m, and mass, kg."""
        return self.stiffness, self.damping, self.mass


#: Stiffness, damping and mass, each a number or one of each cell, shape (cells,).
Sizes = tuple[float | FloatArray, float | FloatArray, float | FloatArray]


#: Settings examined in one run: more would take memory and save no time.
_AT_ONCE = 64


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


def setting_of(design: Design, moment: tuple[str, ...]) -> Setting | None:
    """The sum of effects of some elements; None if nothing acts."""
    chosen = [design.elements[name] for name in moment]
    totals = [
        sum(getattr(element, effect) for element in chosen)
        for effect in ("stiffness", "damping", "mass")
    ]
    if not any(totals):
        return None
    return Setting(
        stiffness=totals[0],
        damping=totals[1],
        mass=totals[2],
        **design.loop.filter_settings(),
    )
