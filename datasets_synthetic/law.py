"""Control law of a simulated controller: elements, estimators, a force for every reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.calls import Calls, Transitions
from datasets_synthetic.device import choose_members, per_member

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


class Estimates(Protocol):
    """Filters at work: one call a sample; every array shape (batch,)."""

    def update(self, reading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and acceleration (m/s²) after this reading (m), shape (batch,) each."""
        ...


class FirstOrderEstimates:
    """Velocity through one pole, acceleration through two equal ones, as difference equations."""

    __slots__ = (
        "_acceleration",
        "_acceleration_pole",
        "_last",
        "_sample_time",
        "_slope",
        "_velocity",
        "_velocity_pole",
    )

    def __init__(
        self,
        velocity_pole: FloatArray,
        acceleration_pole: FloatArray | None,
        sample_time: FloatArray,
    ) -> None:
        """Without a pole of acceleration that is not estimated and said to be zero."""
        self._velocity_pole = velocity_pole, 1 - velocity_pole
        self._acceleration_pole = (
            None if acceleration_pole is None else (acceleration_pole, 1 - acceleration_pole)
        )
        self._sample_time = sample_time
        self._last: FloatArray | None = None
        self._velocity = self._slope = self._acceleration = np.zeros_like(sample_time)

    def update(self, reading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and acceleration (m/s²) after this reading (m), shape (batch,) each."""
        last = reading if self._last is None else self._last
        change = (reading - last) / self._sample_time
        self._last = reading
        pole, rest = self._velocity_pole
        self._velocity = pole * self._velocity + rest * change
        if self._acceleration_pole is not None:
            pole, rest = self._acceleration_pole
            slope = pole * self._slope + rest * change
            change_of_slope = (slope - self._slope) / self._sample_time
            self._acceleration = pole * self._acceleration + rest * change_of_slope
            self._slope = slope
        return self._velocity, self._acceleration


class SectionEstimates:
    """Second-order sections of the differences, or a moving window; members may differ in kind.

    A section is x[k] = t·x[k-1] - p·x[k-2] + (1-t+p)·u[k]; p = 0 makes it one of first order.
    """

    __slots__ = (
        "_acceleration",
        "_change",
        "_last",
        "_past",
        "_row",
        "_sample_time",
        "_sections",
        "_velocity",
        "_window",
    )

    def __init__(
        self,
        velocity: tuple[FloatArray, FloatArray],
        acceleration: tuple[FloatArray, FloatArray],
        window: NDArray[np.int64],
        sample_time: FloatArray,
    ) -> None:
        """Sections (t, p) of both; window in samples, each shape (batch,)."""
        self._sections = (velocity, acceleration)
        self._window = window
        self._sample_time = sample_time
        self._last: FloatArray | None = None
        self._past = np.zeros((int(np.max(window)), sample_time.size))
        self._row = 0
        still = np.zeros_like(sample_time)
        self._change = still
        self._velocity, self._acceleration = (still, still), (still, still)

    def update(self, reading: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and acceleration (m/s²) after this reading (m), shape (batch,) each."""
        if self._last is None:
            self._past[:] = reading
        last = reading if self._last is None else self._last
        change = (reading - last) / self._sample_time
        self._last = reading
        velocity, acceleration = self._sections
        self._velocity = _section(velocity, self._velocity, self._mean_slope(reading))
        self._acceleration = _section(
            acceleration, self._acceleration, (change - self._change) / self._sample_time
        )
        self._change = change
        return self._velocity[0], self._acceleration[0]

    def _mean_slope(self, reading: FloatArray) -> FloatArray:
        """(reading - reading n samples ago)/(n·T)."""
        rows = self._past.shape[0]
        before = self._past[(self._row - self._window) % rows, np.arange(reading.size)]
        self._past[self._row] = reading
        self._row = (self._row + 1) % rows
        return (reading - before) / (self._window * self._sample_time)


def first_order_pole(cutoff: FloatArray | float, sample_time: FloatArray) -> FloatArray:
    """a = exp(-2π·fc·T) of a cut-off in Hz; 0 where it is infinite.

    Cut-off and sample time (s) broadcast; the answer has their shape and no unit.
    """
    return np.exp(-2 * np.pi * cutoff * sample_time)


def section(
    cutoff: FloatArray | float,
    order: NDArray[np.int64] | int,
    ratio: FloatArray | float,
    sample_time: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(t, p) of a filter with one pole, or with the pair of poles of this damping ratio.

    The pair is exp(-2π·fc·T·(ζ ± j·√(1-ζ²))), the matched poles of a second-order low-pass.
    """
    turn = np.where(np.isinf(cutoff), 0.0, 2 * np.pi * cutoff * sample_time)
    open_ = np.isinf(cutoff) & np.ones(sample_time.shape, dtype=bool)
    size = np.exp(-ratio * turn)
    pair = 2 * size * np.cos(np.sqrt(1 - np.square(ratio)) * turn)
    single = np.equal(order, 1)
    t = np.where(single, np.exp(-turn), pair)
    p = np.where(single, 0.0, size**2)
    return np.where(open_, 0.0, t), np.where(open_, 0.0, p)


def _section(
    poles: tuple[FloatArray, FloatArray], past: tuple[FloatArray, FloatArray], value: FloatArray
) -> tuple[FloatArray, FloatArray]:
    t, p = poles
    return t * past[0] - p * past[1] + (1 - t + p) * value, past[0]


class ControlLaw:
    """A Controller at work: one call a sample, remembering what its filters need.

    The estimates of velocity and acceleration follow every reading, whatever is felt.
    """

    __slots__ = ("_elements", "_estimates")

    def __init__(self, controller: Controller, sample_time: FloatArray) -> None:
        """Sample time in s, shape (batch,)."""
        self._estimates = _estimates(controller, sample_time)
        self._elements = ElementsAtWork(controller.elements, controller.calls, sample_time)

    def force(self, reading: FloatArray) -> FloatArray:
        """Sum of what all elements give for this sample's reading (m), N, shape (batch,)."""
        return self._elements.force(reading, *self._estimates.update(reading))


class ElementsAtWork:
    """Elements together; arrays of shape (elements, batch). What no element has is not computed."""

    __slots__ = (
        "_cut",
        "_damping",
        "_high",
        "_low",
        "_mass",
        "_moving",
        "_rest",
        "_stiffness",
        "_transitions",
    )

    def __init__(
        self, elements: Sequence[Element], calls: Calls | None, sample_time: FloatArray
    ) -> None:
        """Sample time in s, shape (batch,)."""

        def rows(name: str) -> FloatArray:
            return np.stack([per_member(getattr(e, name), sample_time.size) for e in elements])

        stiffness, self._damping, mass = rows("stiffness"), rows("damping"), rows("mass")
        self._stiffness = stiffness if stiffness.any() else None
        self._mass = mass if mass.any() else None
        self._rest, side = rows("place"), rows("side")
        most = np.where((stiffness > 0) | (side != 0), rows("level"), np.inf)
        # A wall that pushes to lower readings lets pass what is positive, and the other way round.
        self._low = np.where(side < 0, 0.0, -most)
        self._high = np.where(side > 0, 0.0, most)
        self._cut = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self._transitions = None
        #: The first member of those whose elements come and go.
        self._moving = sample_time.size
        if calls is not None:
            self._moving = first = calls.first(sample_time.size)
            some = slice(first, None)
            self._transitions = Transitions(
                calls.members(np.arange(first, sample_time.size)),
                stiffness=stiffness[:, some],
                damping=self._damping[:, some],
                mass=mass[:, some],
                side=side[:, some],
                rest=self._rest[:, some],
                bounds=(self._low[:, some], self._high[:, some]),
                fade=sample_time[some] / rows("fade_time")[:, some].clip(sample_time[some]),
            )

    def force(
        self, reading: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> FloatArray:
        """Sum of the forces (N) of this sample, shape (batch,).

        Args:
            reading: of the position, m.
            velocity: estimated, m/s.
            acceleration: estimated, m/s².
        """
        moving = self._damping * velocity
        if self._mass is not None:
            moving += self._mass * acceleration
        law = moving
        if self._stiffness is not None:
            law = self._stiffness * (reading - self._rest) + moving
        if self._cut:
            law = np.minimum(np.maximum(law, self._low), self._high)
        if self._transitions is not None:
            some = slice(self._moving, None)
            law[:, some] = self._transitions.played(reading[some], moving[:, some], law[:, some])
        return -np.add.reduce(law)


def _estimates(controller: Controller, sample_time: FloatArray) -> Estimates:
    """The filters; the usual ones as plain cascades of first order."""
    velocity, acceleration = controller.velocity_filter_hz, controller.acceleration_filter_hz
    pairs_equal = np.equal(controller.acceleration_filter_order, 2) & np.equal(
        controller.filter_damping_ratio, 1
    )
    if np.all(
        np.equal(controller.velocity_filter_order, 1)
        & np.equal(controller.velocity_window_samples, 1)
        & (pairs_equal | np.isinf(acceleration))
    ):
        return FirstOrderEstimates(
            first_order_pole(velocity, sample_time),
            first_order_pole(acceleration, sample_time) if controller.has_mass else None,
            sample_time,
        )
    ratio = controller.filter_damping_ratio
    window = per_member(controller.velocity_window_samples, sample_time.size).astype(np.int64)
    return SectionEstimates(
        section(velocity, controller.velocity_filter_order, ratio, sample_time),
        section(acceleration, controller.acceleration_filter_order, ratio, sample_time),
        window,
        sample_time,
    )
