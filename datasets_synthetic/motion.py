"""Motion of a rigid device in continuous time, between samples and through reversals.

Forces by position, friction that sticks and slips, the delay that splits each sample, and the steps
of integration with their error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Resisting force k·q + gs·sin q + gc·cos q per unit mass; each array shape (batch,)."""

    stiffness: FloatArray  # k/m, 1/s²
    sine: FloatArray  # gs/m, m/s² (rad/s²)
    cosine: FloatArray  # gc/m, m/s² (rad/s²)
    curved: bool  # whether any sine or cosine is there

    def at(self, position: FloatArray) -> FloatArray:
        """Resisting force per unit mass, m/s², at these positions (m), shape (..., batch)."""
        spring = self.stiffness * position
        if not self.curved:
            return spring
        return spring + self.sine * np.sin(position) + self.cosine * np.cos(position)

    def stored(self, position: FloatArray) -> FloatArray:
        """Energy per unit mass, m²/s², at these positions (m), shape (..., batch); zero at zero."""
        spring = 0.5 * self.stiffness * position**2
        if not self.curved:
            return spring
        return spring + self.sine * (1 - np.cos(position)) + self.cosine * np.sin(position)

    def members(self, which: NDArray[np.intp]) -> Field:
        """The field of these members, shape (members,)."""
        return Field(
            stiffness=self.stiffness[which],
            sine=self.sine[which],
            cosine=self.cosine[which],
            curved=self.curved,
        )

    def fastest(self) -> FloatArray:
        """Largest natural frequency anywhere, 1/s, shape (batch,): no slope exceeds its square."""
        return np.sqrt(np.abs(self.stiffness) + np.hypot(self.sine, self.cosine))


#: Largest |h·p| of one step: relative error of the effective damping 0.02⁴/120 = 1.3e-9, a
#: thousand times below what a log of any length can tell.
LARGEST_STEP = 0.02

#: Newton steps to the instant of rest. The velocity is all but linear in time over one step
#: (curvature at most h·p), so the error after each is squared: 1e-2, 1e-4, 1e-8, 1e-16.
_NEWTON_STEPS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Drag:
    """Resistance per unit mass; each array shape (batch,)."""

    rate: FloatArray  # p = b/m of motion along +position, 1/s
    grip: FloatArray  # Fc/m, m/s² (rad/s²)
    rate_back: FloatArray  # along -position; the very same array where nothing differs
    #: where the law changes with the direction, or None when nowhere
    turning: NDArray[np.bool_] | None
    field: Field | None = None  # forces of position, or None when there are none

    def fastest(self) -> FloatArray:
        """The largest rate in the law, what a step of integration has to resolve, 1/s, (batch,)."""
        rate = np.maximum(np.abs(self.rate), np.abs(self.rate_back))
        return rate if self.field is None else np.maximum(rate, self.field.fastest())

    def members(self, which: NDArray[np.intp]) -> Drag:
        """The drag of these members, shape (members,)."""
        rate = self.rate[which]
        return Drag(
            rate=rate,
            grip=self.grip[which],
            rate_back=rate if self.rate_back is self.rate else self.rate_back[which],
            turning=None if self.turning is None else self.turning[which],
            field=None if self.field is None else self.field.members(which),
        )


def steps_needed(duration: FloatArray, rate: FloatArray, largest: float = LARGEST_STEP) -> int:
    """Equal steps over a duration, s, that keep |h·p| <= largest for every member."""
    return max(1, int(np.ceil(np.max(np.abs(duration * rate)) / largest - 1e-9)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Stride:
    """Some equal steps of a linear law as the linear map they are, less one.

    The map is what the steps make of unit vectors; it serves at every sample.
    """

    moving: FloatArray  # change of (position, velocity) for each unit of velocity, shape (2, batch)
    driven: FloatArray  # for each unit of drive, which is held, of the same shape
    #: for each unit of position, of the same shape; None where no force depends on it
    pulled: FloatArray | None

    @classmethod
    def of(cls, drag: Drag, steps: int, step: FloatArray) -> Stride | None:
        """The map of so many steps (s, shape (batch,)) without a reversal.

        None where the law between reversals is not linear, or not one and the same both ways.
        """
        if drag.rate_back is not drag.rate or (drag.field is not None and drag.field.curved):
            return None
        start = np.repeat(np.eye(3)[:, :, None], step.size, axis=2)
        change = np.zeros_like(start[:2])
        for _ in range(steps):
            now = start[:2] + change
            change = change + _runge_kutta(now[0], now[1], start[2], drag.rate, drag.field, step)
        pulled, moving, driven = np.moveaxis(change, 1, 0)
        return cls(moving=moving, driven=driven, pulled=None if drag.field is None else pulled)

    def change(self, state: FloatArray, drive: FloatArray) -> FloatArray:
        """Change of (position, velocity), shape (2, batch), over the steps under a drive, m/s²."""
        change = self.moving * state[1] + self.driven * drive
        return change if self.pulled is None else change + self.pulled * state[0]


def advance(
    state: FloatArray, pull: FloatArray, drag: Drag, step: FloatArray, stride: Stride | None = None
) -> FloatArray:
    """Position (m) and velocity (m/s) one step (s) later, shape (2, batch).

    A velocity of exactly zero means at rest. The pull is the force without friction and field, held
    over the step, per unit mass, m/s²; the stride is the step as a linear map, where it is one.
    """
    if drag.turning is None:
        if stride is not None:
            return state + stride.change(state, pull)
        return state + _runge_kutta(state[0], state[1], pull, drag.rate, drag.field, step)
    drive, rate, tends, held = _slipping(state, pull, drag)
    # What sticks stays, or it would be turned back at once, at more cost.
    if stride is None:
        moving = step * (held != tends)
        later = state + _runge_kutta(state[0], state[1], drive, rate, drag.field, moving)
    elif drag.field is None:  # nothing drives what sticks
        later = state + stride.change(state, drive)
    else:
        later = state + stride.change(state, drive) * (held != tends)
    turned = (later[1] * tends < 0) & drag.turning
    if np.count_nonzero(turned):
        turning = np.flatnonzero(turned)
        later[:, turning] = _turn(
            (state[0, turning], state[1, turning], later[1, turning]),
            (drive[turning], rate[turning], pull[turning]),
            drag.members(turning),
            step[turning],
        )
    return later


#: Whatever moves tends to go on, however slowly, and whatever pulls at it.
_GOES_ON = 1e300


def _slipping(
    state: FloatArray, pull: FloatArray, drag: Drag
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Drive (pull less Coulomb friction), rate, which way members tend, and what friction holds."""
    net = pull if drag.field is None else pull - drag.field.at(state[0])
    tends = net + state[1] * _GOES_ON
    held = np.minimum(np.maximum(tends, -drag.grip), drag.grip)
    rate = drag.rate
    if drag.rate_back is not drag.rate:
        rate = np.where(tends > 0, rate, drag.rate_back)
    return pull - held, rate, tends, held


def _runge_kutta(
    position: FloatArray,
    velocity: FloatArray,
    drive: FloatArray,
    rate: FloatArray,
    field: Field | None,
    step: FloatArray,
) -> FloatArray:
    """Travel and gain of velocity over one step of dv/dt = drive - rate·v - field(x), dx/dt = v."""
    half = 0.5 * step
    sixth = step / 6
    if field is None:
        first = drive - rate * velocity
        second = drive - rate * (velocity + half * first)
        third = drive - rate * (velocity + half * second)
        fourth = drive - rate * (velocity + step * third)
    else:
        first = drive - rate * velocity - field.at(position)
        speed = velocity + half * first
        second = drive - rate * speed - field.at(position + half * velocity)
        later = velocity + half * second
        third = drive - rate * later - field.at(position + half * speed)
        last = velocity + step * third
        fourth = drive - rate * last - field.at(position + step * later)
    middle = second + third
    travel = step * (velocity + sixth * (first + middle))
    return np.stack((travel, sixth * (first + 2 * middle + fourth)))


def _turn(
    states: tuple[FloatArray, FloatArray, FloatArray],
    pulls: tuple[FloatArray, FloatArray, FloatArray],
    drag: Drag,
    step: FloatArray,
) -> FloatArray:
    """One step of members that come to rest inside it: up to rest, then stuck or reversed.

    ``states`` is (position, velocity, velocity at the end had the law not changed), ``pulls`` is
    (drive and rate before rest, pull), as in ``advance``.
    """
    position, velocity, overshot = states
    drive, rate, pull = pulls
    instant = step * (velocity / (velocity - overshot))
    for _ in range(_NEWTON_STEPS):
        travel, gain = _runge_kutta(position, velocity, drive, rate, drag.field, instant)
        speed = velocity + gain
        slope = drive - rate * speed
        if drag.field is not None:
            slope = slope - drag.field.at(position + travel)
        instant = np.clip(instant - speed / slope, 0.0, step)
    travel, _ = _runge_kutta(position, velocity, drive, rate, drag.field, instant)
    stopped = np.stack((position + travel, np.zeros_like(velocity)))
    drive, rate, tends, held = _slipping(stopped, pull, drag)
    rest = (step - instant) * (held != tends)
    return stopped + _runge_kutta(stopped[0], stopped[1], drive, rate, drag.field, rest)


#: A delay within this fraction of a sample of a whole number of samples counts as that number:
#: 0.003/0.001 is not 3 in binary.
_WHOLE = 1e-9


class Encoder:
    """Positions rounded to whole counts, half to even; exact where the resolution is zero."""

    def __init__(self, resolution: FloatArray) -> None:
        """Resolution in m (rad), shape (batch,)."""
        exact = resolution == 0
        self._exact = exact if exact.any() else None
        self._count = np.where(exact, 1.0, resolution)

    def read(self, position: FloatArray) -> FloatArray:
        """The readings of these positions, m (rad), shape (batch,)."""
        rounded = np.rint(position / self._count) * self._count
        return rounded if self._exact is None else np.where(self._exact, position, rounded)


#: A command that arrives within this fraction of a sample of a stamp arrives at it: sums of
#: steps carry rounding.
_AT_ONCE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of one sample interval over which the acting force is constant."""

    #: where the force of each member stands in the flat list of commands (row by row, one member
    #: after the other) from the first of the timetable for this sample on, shape (batch,)
    place: NDArray[np.int64]
    steps: int  # number of integration steps
    step: FloatArray  # length of one, s, shape (batch,); zero for a member that has no such part
    #: parts of the same kind have the same steps; None where every part differs
    kind: int | None = None


class EvenTimetable:
    """Every interval alike: the older command up to the arrival of the newer one, then that."""

    def __init__(
        self, delay: FloatArray, sample_time: FloatArray, rate: FloatArray, largest_step: float
    ) -> None:
        """Delay and sample time in s, rate in 1/s, each shape (batch,)."""
        self._batch = delay.size
        whole = np.floor(delay / sample_time + _WHOLE).astype(np.int64)
        arrival = delay - whole * sample_time
        arrival = np.where(arrival <= _WHOLE * sample_time, 0.0, arrival)
        late = bool(np.any(arrival > 0))
        self.lead = int(whole.max()) + late
        newest = np.arange(self._batch) + self.lead * self._batch
        self._parts: list[Part] = []
        for lag, duration in ((whole + 1, arrival), (whole, sample_time - arrival)):
            if np.any(duration > 0):
                steps = steps_needed(duration, rate, largest_step)
                place = newest - lag * self._batch
                kind = len(self._parts)
                self._parts.append(Part(place=place, steps=steps, step=duration / steps, kind=kind))

    def first(self, sample: int) -> int:
        """The first command that the places of a sample are counted from."""
        return sample * self._batch

    def parts(self, sample: int) -> Sequence[Part]:
        """The parts of the interval that starts at this sample."""
        del sample
        return self._parts


class UnevenTimetable:
    """Intervals that differ: the command of stamp j acts from stamp j + delay to the next one."""

    def __init__(
        self, delay: FloatArray, stamps: FloatArray, rate: FloatArray, largest_step: float
    ) -> None:
        """Delay in s and rate in 1/s, shape (batch,); stamps in s, shape (n, batch)."""
        samples, batch = stamps.shape
        self.lead = 1
        ends = np.concatenate((stamps[1:], 2 * stamps[-1:] - stamps[-2:-1]))
        found = [
            _acting(stamps[:, member], ends[:, member], float(delay[member]))
            for member in range(batch)
        ]
        most = max(command.shape[0] for command, _ in found)
        rows = np.zeros((most, samples, batch), dtype=np.int64)
        durations = np.zeros((most, samples, batch))
        for member, (command, duration) in enumerate(found):
            rows[: command.shape[0], :, member] = command + self.lead
            durations[: duration.shape[0], :, member] = duration
        self._place: NDArray[np.int64] = rows * batch + np.arange(batch, dtype=np.int64)
        self._steps = [steps_needed(part, rate, largest_step) for part in durations]
        self._step = durations / np.array(self._steps)[:, None, None]

    def first(self, sample: int) -> int:
        """The first command that the places of a sample are counted from."""
        del sample
        return 0

    def parts(self, sample: int) -> Sequence[Part]:
        """The parts of the interval that starts at this sample."""
        return [
            Part(place=place[sample], steps=steps, step=step[sample])
            for place, steps, step in zip(self._place, self._steps, self._step, strict=True)
        ]


def _acting(
    starts: FloatArray, ends: FloatArray, delay: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Command that acts (-1: none yet) and for how long (s), each shape (parts, n), one member."""
    arrivals = np.concatenate(([-np.inf], starts + delay, [np.inf]))  # of command j at place j + 1
    at_once = _AT_ONCE * (ends - starts)
    first = np.searchsorted(arrivals, starts + at_once, side="right") - 1
    last = np.searchsorted(arrivals, ends - at_once, side="left") - 1
    part = np.arange(int(np.max(last - first)) + 1)[:, None]
    acting = np.minimum(first + part, last)
    begins = np.where(part == 0, starts, np.maximum(arrivals[acting], starts))
    finishes = np.where(acting == last, ends, arrivals[acting + 1])
    there = first + part <= last
    return acting - 1, np.where(there, finishes - begins, 0.0)


class Observer:
    """A Luenberger observer of a position and its derivatives, the highest of them constant.

    States are the derivatives times T^j/j!, so that each step adds them by Pascal's triangle.
    """

    def __init__(
        self,
        states: int,
        hertz: FloatArray | float,
        ratio: FloatArray | float,
        sample_time: FloatArray,
    ) -> None:
        """So many states; sample time in s, shape (batch,)."""
        pascal = [[comb(j, i) for j in range(states)] for i in range(states)]
        self._step: FloatArray = np.array(pascal, dtype=np.float64)
        self._state: FloatArray | None = None
        shift, one = self._step - np.eye(states), np.eye(states)
        turn = 2 * np.pi * hertz * sample_time
        size = np.exp(-ratio * turn)
        t, p = 2 * size * np.cos(np.sqrt(1 - np.square(ratio)) * turn), size**2
        # Ackermann's formula, of factors z² - t·z + p and z - a in powers of the shift z - 1.
        wanted = shift @ shift + (2 - t)[:, None, None] * shift + (1 - t + p)[:, None, None] * one
        for _ in range(states - 2):
            wanted = wanted @ (shift - np.expm1(-turn)[:, None, None] * one)
        rows = [np.linalg.matrix_power(self._step, k + 1)[0] for k in range(states)]
        self._gain: FloatArray = wanted @ np.linalg.solve(np.array(rows), one[-1])

    def update(self, reading: FloatArray) -> FloatArray:
        """The states after this reading, shape (batch, states)."""
        if self._state is None:
            self._state = np.zeros_like(self._gain)
            self._state[:, 0] = reading
        expected: FloatArray = self._state @ self._step.T
        state: FloatArray = expected + self._gain * (reading - expected[:, 0])[:, None]
        self._state = state
        return state
