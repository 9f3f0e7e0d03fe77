"""What closes the loop of a simulated device: virtual effects, or a servo on a reference."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import choose_members, per_member
from datasets_synthetic.calls import Calls

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Element:
    """Effects that act as one; numbers, or arrays of shape (batch,).

    The force is -clamp(u) with u = K·(reading - place) + B·velocity + M·acceleration: between
    -level and level, of a wall between 0 and level on the side to which it pushes.

    Attributes:
        stiffness: K, N/m (N·m/rad).
        damping: B, N·s/m (N·m·s/rad).
        mass: M, kg (kg·m²).
        side: to which it pushes: -1 or 1 of a wall, which lies above its place or below it; 0 both.
        place: of the face of a wall and of the rest of another spring, m (rad).
        level: the most force of what has a spring or a side, N (N·m).
        fade_time: s, over which it fades in and out when it is entered and left; 0 switches it.
    """

    stiffness: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    mass: float | FloatArray = 0.0
    side: int | IntArray = 0
    place: float | FloatArray = 0.0
    level: float | FloatArray = np.inf
    fade_time: float | FloatArray = 0.0

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, each.name)) for each in fields(self)]

    def members(self, which: NDArray[np.intp]) -> Element:
        """The elements of these members, shape (members,); what all share stays one value."""
        chosen = {
            each.name: choose_members(getattr(self, each.name), which) for each in fields(self)
        }
        return replace(self, **chosen)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True, slots=True, kw_only=True)
class Controller:
    """Virtual effects on an axis; numbers, or arrays of shape (batch,).

    Attributes:
        stiffness: K, N/m (N·m/rad), any sign.
        damping: B, N·s/m (N·m·s/rad), any sign, on the estimated velocity.
        mass: M, kg (kg·m²), any sign, on the estimated acceleration.
        velocity_filter_hz: fc of the velocity filter, Hz; infinite means no filter.
        acceleration_filter_hz: fc of the acceleration filter, Hz; infinite means no filter.
        velocity_filter_order: poles of the velocity filter, 1 or 2.
        acceleration_filter_order: poles of the acceleration filter, 1 or 2.
        filter_damping_ratio: ζ of filters with two poles, above 0 and at most 1; at 1 they are
            equal.
        velocity_window_samples: n samples over which the velocity is (q[k] - q[k-n])/(n·T) instead
            of the backward difference, without any filter; 1 is the backward difference itself.
        side: -1 or 1 of a wall, which pushes to that side only; 0 to both. See ``Element``.
        place: where the spring is relaxed, m (rad).
        beside: elements that act with these effects.
        calls: what is asked of them all while they play; None for everything, always.

    Velocity is the backward difference (z-1)/(T·z) and acceleration its square, each through its
    low-pass: (1-a)·z/(z-a) with a = exp(-2π·fc·T), or (1-t+p)·z²/(z²-t·z+p) with the poles
    exp(-2π·fc·T·(ζ ± j·√(1-ζ²))). Both start from rest at the first reading.
    """

    stiffness: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    mass: float | FloatArray = 0.0
    velocity_filter_hz: float | FloatArray = np.inf
    acceleration_filter_hz: float | FloatArray = np.inf
    velocity_filter_order: int | IntArray = 1
    acceleration_filter_order: int | IntArray = 2
    filter_damping_ratio: float | FloatArray = 1.0
    velocity_window_samples: int | IntArray = 1
    side: int | IntArray = 0
    place: float | FloatArray = 0.0
    beside: tuple[Element, ...] = ()
    calls: Calls | None = None

    def __post_init__(self) -> None:
        for name in ("velocity_filter_order", "acceleration_filter_order"):
            if not np.all(np.isin(getattr(self, name), (1, 2))):
                raise ValueError(f"{name} must be 1 or 2, not {getattr(self, name)}")
        ratio, window = (
            np.asarray(self.filter_damping_ratio),
            np.asarray(self.velocity_window_samples),
        )
        if not np.all((ratio > 0) & (ratio <= 1)):
            raise ValueError(f"filter_damping_ratio must be above 0 and at most 1, not {ratio}")
        if not np.all(window >= 1):
            raise ValueError(f"velocity_window_samples must be 1 sample or more, not {window}")
        if np.any((window > 1) & np.isfinite(self.velocity_filter_hz)):
            raise ValueError(
                "a moving window has no velocity filter besides: leave one of them out"
            )

    def size(self) -> int:
        """Number of members the effects describe."""
        sizes = [np.size(getattr(self, name)) for name in _FIELDS]
        sizes += [] if self.calls is None else self.calls.sizes()
        return max(sizes + [size for each in self.beside for size in each.sizes()])

    @property
    def elements(self) -> tuple[Element, ...]:
        """The effects as one element, if there are any, and those beside them."""
        sizes = self.stiffness, self.damping, self.mass
        if self.beside and not any(np.any(each) for each in sizes):
            return self.beside
        own = Element(
            stiffness=self.stiffness,
            damping=self.damping,
            mass=self.mass,
            side=self.side,
            place=self.place,
        )
        return own, *self.beside

    def total_stiffness(self) -> FloatArray:
        """K of all that acts at once, N/m (N·m/rad); one number, or shape (batch,)."""
        return sum((np.asarray(each.stiffness) for each in self.elements), np.zeros(()))

    @property
    def has_mass(self) -> bool:
        """Whether anything acts on the acceleration."""
        return any(np.any(each.mass) for each in self.elements)

    def rows(self, which: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Every field of the elements of these members, each of shape (elements, members)."""
        laws = self.members(which).elements
        return {
            each.name: np.stack([per_member(getattr(e, each.name), which.size) for e in laws])
            for each in fields(Element)
        }

    def members(self, which: NDArray[np.intp]) -> Controller:
        """The effects of these members, shape (members,); what all share stays one value."""
        chosen: dict[str, FloatArray | IntArray] = {
            name: choose_members(getattr(self, name), which) for name in _FIELDS
        }
        chosen |= {name: chosen[name].astype(np.int64) for name in _WHOLE}
        calls = None if self.calls is None else self.calls.members(which)
        beside = tuple(each.members(which) for each in self.beside)
        return replace(self, calls=calls, beside=beside, **chosen)  # pyright: ignore[reportArgumentType]


_WHOLE = ("velocity_filter_order", "acceleration_filter_order", "velocity_window_samples", "side")
_FIELDS = (
    "stiffness",
    "damping",
    "mass",
    "velocity_filter_hz",
    "acceleration_filter_hz",
    "filter_damping_ratio",
    "place",
    *_WHOLE,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """Drives the device along a logged reference: F = kp·(r - q) - kd·(filtered velocity) + feed.

    The feed-forward is the force given to ``simulate``.

    Attributes:
        reference: r at each sample, m (rad), shape (n,) or (batch, n).
        stiffness: kp, N/m (N·m/rad), a number or shape (batch,).
        damping: kd, N·s/m (N·m·s/rad), a number or shape (batch,), on the velocity that
            ``Controller`` describes.
        velocity_filter_hz: of its filter, Hz, a number or shape (batch,); infinite means none.
    """

    reference: FloatArray
    stiffness: float | FloatArray
    damping: float | FloatArray = 0.0
    velocity_filter_hz: float | FloatArray = np.inf

    def regulator(self) -> Controller:
        """The part that looks at the position alone; kp·r is added to its force."""
        return Controller(
            stiffness=self.stiffness,
            damping=self.damping,
            velocity_filter_hz=self.velocity_filter_hz,
        )

    def size(self) -> int:
        """Number of members it describes."""
        return max(np.atleast_2d(self.reference).shape[0], self.regulator().size())
