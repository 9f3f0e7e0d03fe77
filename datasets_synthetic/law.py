"""Control law of a simulated controller: elements, what is asked of them, a force a reading.

Leaving is always safe, and so is less: they take effect at once. A spring rests where it is
entered, and acts with more force only after it gave none for a while. What fades, fades, but not
while a wall pushes. A damper alone is switched at any moment.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields, replace
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import Batched, FloatArray, per_member
from datasets_synthetic.motion import Observer

IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]


#: Who calls: nobody, somebody who enters and leaves and asks for gains at random, or somebody who
#: holds the device less where that takes energy than where it gives some.
NOBODY, RANDOM, ADVERSE = 0, 1, 2
#: Chance that one element is called at random in a sample, and the gains it may be asked for.
_CHANCE, _GAINS = 0.05, (0.0, 0.0, 0.3, 1.0, 1.0)
#: Gain of a spring while it takes energy, where a caller is adverse.
_LEAST = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Calls(Batched):
    """What is asked of the elements of a controller; numbers, or arrays of shape (batch,).

    Attributes:
        entrance: m (rad); what is no wall is entered where the reading passes it and left where it
            comes back; -inf is everywhere.
        caller: NOBODY, RANDOM or ADVERSE.
        dampers: whether only elements that are nothing but a damper are called, to the end.
        until: samples after which all others are: at random what is no wall is left then, else all
            is entered.
        taps: samples without force after which a spring may act with more.
    """

    shared: ClassVar[tuple[str, ...]] = ("until", "taps")

    entrance: float | FloatArray = -np.inf
    caller: int | IntArray = NOBODY
    dampers: bool | Mask = False
    until: int = 0
    taps: int = 1

    def first(self, batch: int) -> int:
        """The first member of whose elements anything is asked; the batch where of none."""
        asked = np.isfinite(per_member(self.entrance, batch)) | (per_member(self.caller, batch) > 0)
        return int(np.argmax(asked)) if asked.any() else batch


class _Transitions:
    """Elements that come and go, each remembering its rest, its level and how long it was quiet.

    All arrays have shape (elements, batch), but for ``calls``.
    """

    def __init__(
        self,
        calls: Calls,
        *,
        stiffness: FloatArray,
        damping: FloatArray,
        mass: FloatArray,
        side: FloatArray,
        rest: FloatArray,
        level: FloatArray,
        bounds: tuple[FloatArray, FloatArray],
        fade: FloatArray,
    ) -> None:
        """K (N/m), B (N·s/m), M (kg), side (0: no wall), rest (m), bounds of each clamp (N).

        ``rest`` and ``level`` are views: what they are changed to here is played. ``fade`` is the
        change of a level in a sample, 1 where nothing fades.
        """
        batch = stiffness.shape[1]
        self._stiffness = stiffness
        self._rest, self._bounds, self._level = rest, bounds, level
        self._spring, self._walls, self._side = stiffness > 0, side != 0, side
        self._place = rest.copy()
        fades = fade < 1
        self._fade, self._fades = fade, fades
        self._taps, self._until = calls.taps, calls.until
        entrance = np.where(self._walls, -np.inf, per_member(calls.entrance, batch))
        self._entrance = entrance if np.isfinite(entrance).any() else None
        self._entered = b""  # where readings were beyond an entrance
        caller, alone = per_member(calls.caller, batch), per_member(calls.dampers, batch) > 0
        called = ~alone | ((damping > 0) & ~self._spring & (mass == 0) & ~fades)
        random = called & (caller == RANDOM)
        # A spring that fades is taken to fade all the way: at a low level it could be pumped.
        adverse = called & (caller == ADVERSE) & ~(self._spring & fades)
        self._random, self._adverse = _if_any(random), _if_any(adverse)
        self._left = alone & random, alone & adverse, random & ~alone & ~self._walls
        self._least = np.where(self._spring, _LEAST, 0.0)
        self._source = np.random.default_rng(0)  # one caller for all members, whatever the batch
        self._gain = np.ones(stiffness.shape)
        #: Gains but for those of adverse callers.
        self._always = np.ones(stiffness.shape)
        self._asked: FloatArray | None = None
        #: Walls that are not at their faces, and the last samples with a force, there or here.
        self._moved: Mask | None = None
        self._met, self._busy = np.zeros(stiffness.shape), np.zeros(stiffness.shape)
        self._last, self._sample = np.zeros(batch), 0
        #: Sample from which on a spring whose level waits to rise may have been quiet.
        self._due = 0
        self._fading = False  # whether anything has still to fade
        #: What acted since anybody asked whether it was quiet.
        self._unseen: deque[FloatArray] = deque(maxlen=calls.taps)

    def follow(self, reading: FloatArray, moving: FloatArray, law: FloatArray) -> None:
        """Changes levels, and what is entered in the law.

        ``moving`` is B·velocity + M·acceleration, ``law`` each clamp of all of it, N, both of shape
        (elements, batch); the reading has shape (batch,).
        """
        self._sample = k = self._sample + 1
        asked, before = self._called(reading, law), self._asked
        self._asked = asked
        if before is None:  # what is there from the start is not entered
            self._level[:], before = asked, asked
        back = self._moved is not None and bool(np.count_nonzero(self._moved & (law == 0)))
        if asked is before and k < self._due and not back:
            self._unseen.append(law)
            self._fade_on(law, asked)
            return
        if self._unseen:
            samples = np.arange(k - len(self._unseen), k)[:, None, None]
            seen = np.max(samples * (np.array(self._unseen) != 0), axis=0)
            self._busy = np.maximum(self._busy, seen)
            self._unseen.clear()
        entering = None
        if asked is not before:
            entering = self._spring & (asked > 0) & (before == 0) & (self._level == 0)
            if np.count_nonzero(entering):
                self._enter(entering, reading, moving)
                np.copyto(law, self._clamped(reading, moving, self._rest), where=entering)
        np.copyto(self._busy, k, where=law != 0)
        quiet = self._busy <= k - self._taps
        if self._moved is not None and np.count_nonzero(self._moved & (law == 0)):
            self._return(quiet, reading, moving)
        rises = quiet | ~self._spring
        if entering is not None:
            rises |= entering
        level = np.where(rises, asked, np.minimum(self._level, asked))
        np.copyto(self._level, level, where=~self._fades)
        self._due = k + 1
        if asked is before:
            since = self._busy[(level != asked) & ~self._fades]
            self._due = int(since.min()) + self._taps if since.size else np.iinfo(np.int64).max
        self._look_at_fades(asked)
        self._fade_on(law, asked)

    def _fade_on(self, law: FloatArray, asked: FloatArray) -> None:
        """Levels that fade change, but where a wall pushes."""
        if not self._fading:
            return
        level, change = self._level, self._fade
        faded = np.minimum(np.maximum(asked, level - change), level + change)
        pushed = np.logical_or.reduce(self._walls & (level != 0) & (law != 0))
        np.copyto(level, faded, where=self._fades & ~pushed)
        self._look_at_fades(asked)

    def _look_at_fades(self, asked: FloatArray) -> None:
        """Whether anything has still to fade."""
        self._fading = bool(np.count_nonzero((self._level != asked) & self._fades))

    def _enter(self, entering: Mask, reading: FloatArray, moving: FloatArray) -> None:
        """Each rests where the device is; a wall at its face, if the device is not behind it."""
        stays = self._walls & ~(self._side * (self._place - reading) > 0)
        clear = self._clamped(reading, moving, self._place) == 0
        np.copyto(self._rest, np.where(stays, self._place, reading), where=entering)
        np.copyto(self._met, self._sample - clear, where=entering)
        np.copyto(self._busy, self._sample - 1, where=entering)
        self._look()

    def _return(self, quiet: Mask, reading: FloatArray, moving: FloatArray) -> None:
        """Walls that would have given no force for a while are at their faces again."""
        at_face = self._clamped(reading, moving, self._place)
        np.copyto(self._met, self._sample, where=at_face != 0)
        back = quiet & (self._met <= self._sample - self._taps)
        np.copyto(self._rest, self._place, where=back & self._walls)
        self._look()

    def _look(self) -> None:
        """Which walls are not at their faces."""
        moved = self._walls & (self._rest != self._place)
        self._moved = _if_any(moved)

    def _clamped(self, reading: FloatArray, moving: FloatArray, rest: FloatArray) -> FloatArray:
        """Each clamp as it is where it rests there."""
        law = self._stiffness * (reading - rest) + moving
        return np.minimum(np.maximum(law, self._bounds[0]), self._bounds[1])

    def _called(self, reading: FloatArray, law: FloatArray) -> FloatArray:
        """Gain that is asked for of each: the array of before where that is the same."""
        if self._until == 0:
            random, adverse, left = self._left
            self._random, self._adverse = _if_any(random), _if_any(adverse)
            self._always = np.where(random, self._gain, np.where(left, 0.0, 1.0))
            self._entered = b""
        self._until -= 1
        if self._random is None and self._adverse is None and self._entrance is None:
            return self._always
        if self._random is not None and self._source.random() < _CHANCE:
            self._gain[self._source.integers(len(self._gain))] = self._source.choice(_GAINS)
            self._always = np.where(self._random, self._gain, self._always)
        asked, before = self._always, self._asked
        if self._adverse is not None:
            # The lag of a damper makes it give some.
            takes = ~(law * (reading - self._last) < 0)
            asked = np.where(takes & self._adverse, self._least, asked)
        self._last = reading
        # What is compared as bytes is compared in a fraction of the time.
        if self._entrance is not None:
            inside = reading > self._entrance
            entered, self._entered = self._entered, inside.tobytes()
            quiet = self._random is None and self._adverse is None
            if quiet and before is not None and entered == self._entered:
                return before
            asked = asked * inside
        return before if before is not None and asked.tobytes() == before.tobytes() else asked


def _if_any(mask: Mask) -> Mask | None:
    """The mask, None where it holds nowhere."""
    return mask if mask.any() else None


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualElement(Batched):
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Controller(Batched):
    """Virtual effects on an axis; numbers, or arrays of shape (batch,).

    Attributes:
        stiffness: K, N/m (N·m/rad), any sign.
        damping: B, N·s/m (N·m·s/rad), any sign, on the estimated velocity.
        mass: M, kg (kg·m²), any sign, on the estimated acceleration.
        velocity_filter_hz: fc of the velocity filter, Hz; infinite means no filter.
        acceleration_filter_hz: fc of the acceleration filter, Hz; infinite means no filter.
        velocity_filter_order: poles of the velocity filter, 1 or 2; states if it tracks.
        acceleration_filter_order: poles of the acceleration filter, 1 or 2; states if it tracks.
        filter_damping_ratio: ζ of pairs of poles, above 0 and at most 1; at 1 they are equal.
        velocity_filter, acceleration_filter: "low-pass", or "tracking".
        velocity_window_samples: n samples over which the velocity is (q[k] - q[k-n])/(n·T) instead
            of the backward difference, without any filter; 1 is the backward difference itself.
        side: -1 or 1 of a wall, which pushes to that side only; 0 to both. See ``VirtualElement``.
        place: where the spring is relaxed, m (rad).
        beside: elements that act with these effects.
        calls: what is asked of them all while they play; None for everything, always.

    Velocity is the backward difference (z-1)/(T·z) and acceleration its square, each through its
    low-pass: (1-a)·z/(z-a) with a = exp(-2π·fc·T), or (1-t+p)·z²/(z²-t·z+p) with the poles
    exp(-2π·fc·T·(ζ ± j·√(1-ζ²))). A filter that tracks is the observer of so many states under a
    constant highest derivative, whose poles are that pair and, of more states, a; it estimates the
    motion at the reading. Both start from rest at the first reading.
    """

    _own = "velocity_filter", "acceleration_filter"
    shared: ClassVar[tuple[str, ...]] = ("beside", "calls", *_own)

    stiffness: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    mass: float | FloatArray = 0.0
    velocity_filter_hz: float | FloatArray = np.inf
    acceleration_filter_hz: float | FloatArray = np.inf
    velocity_filter_order: int | IntArray = 1
    acceleration_filter_order: int | IntArray = 2
    filter_damping_ratio: float | FloatArray = 1.0
    velocity_filter: str = "low-pass"
    acceleration_filter: str = "low-pass"
    velocity_window_samples: int | IntArray = 1
    side: int | IntArray = 0
    place: float | FloatArray = 0.0
    beside: tuple[VirtualElement, ...] = ()
    calls: Calls | None = None

    def __post_init__(self) -> None:
        for least, which in ((2, "velocity"), (3, "acceleration")):
            tracks = getattr(self, f"{which}_filter") == "tracking"
            name, orders = f"{which}_filter_order", (least, least + 1) if tracks else (1, 2)
            if not np.all(np.isin(getattr(self, name), orders)):
                seen = getattr(self, name)
                raise ValueError(f"{name} must be {orders[0]} or {orders[1]}, not {seen}")
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
        sizes = self.sizes()
        sizes += [] if self.calls is None else self.calls.sizes()
        return max(sizes + [size for each in self.beside for size in each.sizes()])

    @property
    def elements(self) -> tuple[VirtualElement, ...]:
        """The effects as one element, if there are any, and those beside them."""
        sizes = self.stiffness, self.damping, self.mass
        if self.beside and not any(np.any(each) for each in sizes):
            return self.beside
        own = VirtualElement(
            stiffness=self.stiffness,
            damping=self.damping,
            mass=self.mass,
            side=self.side,
            place=self.place,
        )
        return own, *self.beside

    def rows(self, which: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Every field of the elements of these members, each of shape (elements, members)."""
        laws = self.members(which).elements
        return {
            each.name: np.stack([per_member(getattr(e, each.name), which.size) for e in laws])
            for each in fields(VirtualElement)
        }

    def members(self, which: NDArray[np.intp]) -> Controller:
        """The effects of these members, shape (members,); what all share stays one value."""
        chosen = cast("Controller", Batched.members(self, which))
        calls = None if self.calls is None else self.calls.members(which)
        return replace(
            chosen, calls=calls, beside=tuple(each.members(which) for each in self.beside)
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


class _Estimates:
    """Second-order sections of the differences, a moving window, or observers by derivative.

    A section is x[k] = t·x[k-1] - p·x[k-2] + (1-t+p)·u[k]; p = 0 makes it one of first order.
    Members may differ in their sections.
    """

    def __init__(self, controller: Controller, sample_time: FloatArray) -> None:
        """Sample time in s, shape (batch,)."""
        ratio = controller.filter_damping_ratio
        self._observers: dict[int, Observer] = {}
        sections: list[tuple[FloatArray, FloatArray]] = []
        for power, which in ((1, "velocity"), (2, "acceleration")):
            hertz = getattr(controller, f"{which}_filter_hz")
            order = getattr(controller, f"{which}_filter_order")
            if getattr(controller, f"{which}_filter") == "tracking" and np.all(np.isfinite(hertz)):
                self._observers[power] = Observer(int(np.max(order)), hertz, ratio, sample_time)
                hertz = np.inf
            sections.append(_low_pass_poles(hertz, order, ratio, sample_time))
        self._t, self._p = (np.stack(pair) for pair in zip(*sections, strict=True))
        self._fresh = 1 - self._t + self._p
        window = per_member(controller.velocity_window_samples, sample_time.size).astype(np.int64)
        self._window = window if np.any(window > 1) else None
        self._sample_time = sample_time
        self._past = np.zeros((int(np.max(window)), sample_time.size))
        self._row = 0
        self._last: FloatArray | None = None
        self._now = self._before = np.zeros_like(self._t)
        #: Change of the reading and change of that, over the sample time, now and before.
        self._slopes, self._spare = np.zeros_like(self._t), np.zeros_like(self._t)

    def update(self, reading: FloatArray) -> FloatArray:
        """Velocity (m/s) and acceleration (m/s²) after this reading (m), shape (2, batch)."""
        if self._last is None:
            self._past[:] = reading
            self._last = reading
        before, slopes = self._slopes, self._spare
        np.subtract(reading, self._last, out=slopes[0])
        slopes[0] /= self._sample_time
        np.subtract(slopes[0], before[0], out=slopes[1])
        slopes[1] /= self._sample_time
        self._last, self._slopes, self._spare = reading, slopes, before
        if self._window is not None:
            slopes = np.stack((self._mean_slope(reading, self._window), slopes[1]))
        now = self._t * self._now - self._p * self._before + self._fresh * slopes
        self._now, self._before = now, self._now
        if not self._observers:
            return now
        found = now.copy()
        for power, observer in self._observers.items():
            state = observer.update(reading)[:, power]
            found[power - 1] = state * (power / self._sample_time**power)
        return found

    def _mean_slope(self, reading: FloatArray, window: NDArray[np.int64]) -> FloatArray:
        """(reading - reading n samples ago)/(n·T)."""
        rows = self._past.shape[0]
        before = self._past[(self._row - window) % rows, np.arange(reading.size)]
        self._past[self._row] = reading
        self._row = (self._row + 1) % rows
        return (reading - before) / (window * self._sample_time)


def _low_pass_poles(
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


class ControlLaw:
    """A Controller at work: one call a sample, remembering what its filters need.

    The estimates of velocity and acceleration follow every reading, whatever acts. Arrays of
    elements have shape (elements, batch); what no element has is not computed.
    """

    def __init__(self, controller: Controller, sample_time: FloatArray) -> None:
        """Sample time in s, shape (batch,)."""
        rows = controller.rows(np.arange(sample_time.size))
        self._stiffness, self._damping, self._mass = (
            rows[name] for name in ("stiffness", "damping", "mass")
        )
        self._springs, self._masses = bool(self._stiffness.any()), bool(self._mass.any())
        self._estimates = _Estimates(controller, sample_time)
        self._rest, side = rows["place"], rows["side"]
        most = np.where((self._stiffness > 0) | (side != 0), rows["level"], np.inf)
        # A wall that pushes to lower readings lets pass what is positive, and the other way round.
        self._low = np.where(side < 0, 0.0, -most)
        self._high = np.where(side > 0, 0.0, most)
        self._cut = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self._transitions, calls = None, controller.calls
        #: The first member of those whose elements come and go.
        self._moving = sample_time.size
        if calls is not None:
            self._moving = first = calls.first(sample_time.size)
            some = slice(first, None)
            self._level = np.ones_like(self._rest)
            self._transitions = _Transitions(
                calls.members(np.arange(first, sample_time.size)),
                stiffness=self._stiffness[:, some],
                damping=self._damping[:, some],
                mass=self._mass[:, some],
                side=side[:, some],
                rest=self._rest[:, some],
                level=self._level[:, some],
                bounds=(self._low[:, some], self._high[:, some]),
                fade=sample_time[some] / rows["fade_time"][:, some].clip(sample_time[some]),
            )

    def force(self, reading: FloatArray) -> FloatArray:
        """Sum of what all elements give for this sample's reading (m), N, shape (batch,)."""
        velocity, acceleration = self._estimates.update(reading)
        law = moving = self._damping * velocity
        if self._masses:
            moving += self._mass * acceleration
        if self._springs:
            law = self._stiffness * (reading - self._rest)
            law += moving
        if self._cut:
            law = np.minimum(np.maximum(law, self._low), self._high)
        if self._transitions is not None:
            some = slice(self._moving, None)
            self._transitions.follow(reading[some], moving[:, some], law[:, some])
            law = law * self._level
        return -np.add.reduce(law)
