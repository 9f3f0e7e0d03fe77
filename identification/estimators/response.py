"""Zero-order-hold response of a mass with damping, exact for any rate p = b/m, and its drive.

Every response comes with its exact derivative by p, from the φ-functions one order higher.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.filters import recursive
from identification.estimators.least_squares import MOST_SAMPLES, Regression
from identification.estimators.motion import terms
from identification.estimators.signals import Commands, HeldColumn, Signals, mean_step

FloatArray = NDArray[np.float64]

#: Below this |δ| the φ-functions are summed as series, above it taken from expm1.
_SERIES_BELOW = 0.5
#: Terms of the series: 0.5^16/18! is below the last bit.
_TERMS = 18
#: Fastest |p| searched, per sample: there nothing of a motion is left after one, and no log tells a
#: faster one. A bound that a device may reach would be taken for its rate.
_FASTEST = 50.0
#: Fastest growth searched, per log: e^50 exceeds any travel.
_GROWTH = 50.0


def phi(delta: float | FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """φ1 = (1 - e^(-δ))/δ, φ2 = (1 - φ1)/δ, φ3 = (1/2 - φ2)/δ, finite at δ = 0; any shape."""
    delta = np.asarray(delta, dtype=np.float64)
    if not np.any(np.abs(delta) >= _SERIES_BELOW):
        return _series(delta)
    near = np.abs(delta) < _SERIES_BELOW
    large = np.where(near, 1.0, delta)
    first = -np.expm1(-large) / large
    second = (1 - first) / large
    far = (first, second, (0.5 - second) / large)
    return tuple(  # type: ignore[return-value]
        np.where(near, small, beyond)
        for small, beyond in zip(_series(np.where(near, delta, 0.0)), far, strict=True)
    )


def _series(delta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    # φ3 = Σ (-δ)^k/(k+3)!, by Horner with the common factor 1/6 last.
    third = np.ones_like(delta)
    for k in range(_TERMS, 3, -1):
        third = 1 - delta * third / k
    third = third / 6
    second = 0.5 - delta * third
    return 1 - delta * second, second, third


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResponse:
    """Step response to a unit force per mass, from rest; each of the shape of the times."""

    #: velocity gained, m/s for each m/s²; also the distance coasted for each m/s; s
    speed: FloatArray
    place: FloatArray  # distance gained, s²
    decay: FloatArray  # part left of a velocity
    speed_slope: FloatArray  # derivative of ``speed`` by p, s²
    place_slope: FloatArray  # derivative of ``place`` by p, s³
    decay_slope: FloatArray  # derivative of ``decay`` by p, s

    @classmethod
    def during(cls, span: float | FloatArray, rate: float) -> StepResponse:
        """For times in s, of any shape, and p in 1/s."""
        span = np.asarray(span, dtype=np.float64)
        first, second, third = phi(rate * span)
        square = span * span
        decay = 1 - rate * span * first
        return cls(
            speed=span * first,
            place=square * second,
            decay=decay,
            speed_slope=square * (second - first),
            place_slope=square * span * (2 * third - second),
            decay_slope=-span * decay,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """Velocity and distance that each interval adds by itself, shape (n - 1,) each."""

    velocity: FloatArray
    distance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldResponse:
    """A device of rate p on the grid of one log, moved by held columns."""

    rate: float  # p, 1/s
    whole: StepResponse  # of one full interval; numbers, or arrays of shape (n - 1,)
    steps: float | FloatArray  # length of the intervals, s: one number, or shape (n - 1,)

    @classmethod
    def at(cls, rate: float, steps: float | FloatArray) -> HeldResponse:
        """For p in 1/s and the steps of a log in s: one number, or shape (n - 1,)."""
        return cls(rate=rate, whole=StepResponse.during(steps, rate), steps=steps)

    def gain(self, column: HeldColumn) -> Gain:
        """What a column, force per mass, adds in each interval."""
        return self._moved(column, lambda response: (response.speed, response.place))

    def slope_by_rate(self, column: HeldColumn) -> Gain:
        """Derivative of ``gain`` by p."""
        return self._moved(column, lambda response: (response.speed_slope, response.place_slope))

    def _moved(
        self, column: HeldColumn, of: Callable[[StepResponse], tuple[FloatArray, FloatArray]]
    ) -> Gain:
        """What a column adds of two parts of the response, with its jumps inside the intervals."""
        velocity, distance = (column.level * part for part in of(self.whole))
        if column.change.size:
            jump = of(StepResponse.during(column.left, self.rate))
            velocity = velocity + column.added(jump[0])
            distance = distance + column.added(jump[1])
        return Gain(velocity=velocity, distance=distance)

    def slope_by_delay(self, column: HeldColumn, first: float) -> Gain:
        """Derivative of ``gain`` by a delay of all jumps; ``first`` is the value before the log."""
        level = column.level
        before = np.concatenate(([first], level[:-1]))
        if column.change.size:
            inside = column.added(1.0)
            before[1:] += inside[:-1]
        border = level - before
        velocity = -border * self.whole.decay
        distance = -border * self.whole.speed
        if column.change.size:
            jump = StepResponse.during(column.left, self.rate)
            velocity = velocity - column.added(jump.decay)
            distance = distance - column.added(jump.speed)
        return Gain(velocity=velocity, distance=distance)

    def speed(self, added: FloatArray, start: float = 0.0) -> FloatArray:
        """Velocity at each sample, shape (n,), from what intervals add to it, shape (n - 1,)."""
        if self.whole.decay.ndim == 0:
            return recursive(np.concatenate(([start], added)), -float(self.whole.decay))
        return accumulate_decay(self.whole.decay, [added], [start])[0]

    def position(self, gain: Gain, start: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Position and velocity, shape (n,) each, from rest at zero or from a start velocity."""
        speed = self.speed(gain.velocity, start)
        moved = self.whole.speed * speed[:-1] + gain.distance
        return np.concatenate(([0.0], np.cumsum(moved))), speed

    def coasting(self, intervals: int) -> FloatArray:
        """Position, shape (n,), from a start velocity of 1 under no force."""
        nothing = np.zeros(intervals)
        return self.position(Gain(velocity=nothing, distance=nothing), start=1.0)[0]

    def position_slope(self, speed: FloatArray, slope: Gain) -> FloatArray:
        """Derivative of a position by p, from its velocity and the slope of what is added."""
        added = self.whole.decay_slope * speed[:-1] + slope.velocity
        moved = self.whole.speed_slope * speed[:-1] + slope.distance
        return self.position(Gain(velocity=added, distance=moved))[0]


def accumulate_decay(
    decay: FloatArray, added: Sequence[FloatArray], start: Sequence[float]
) -> FloatArray:
    """Velocities, shape (columns, n), where each interval leaves its own part of the one before."""
    rows = np.empty((len(start), decay.size + 1))
    rows[:, 0] = start
    for index, column in enumerate(added):
        rows[index, 1:] = column
    return recursive(rows, -np.concatenate(([0.0], decay)))


@dataclass(frozen=True, slots=True)
class Drive:
    """Inputs of one log; the delay is given, or one more nonlinear parameter."""

    commands: Commands  # forces as logged
    terms: tuple[HeldColumn, ...]  # columns of the terms beside mass and damping
    moving: FloatArray  # 1, or 0 where the device stands, shape (n - 1,)
    steps: float | FloatArray  # of the log, s: one number, or shape (n - 1,)
    delay: float | None  # s, or None if it is fitted

    @classmethod
    def of(cls, table: Regression, delay: float | None) -> Drive:
        """Inputs as a prepared regression knows them."""
        signals, motion = table.signals, table.motion
        beside = terms(table.model, motion, signals.position, signals.steps).columns
        return cls(signals.commands, beside, motion.moving, signals.steps, delay)

    @classmethod
    def bare(cls, signals: Signals, delay: float | None) -> Drive:
        """The force alone, as if the device never stood."""
        return cls(signals.commands, (), np.ones(signals.speed.size), signals.steps, delay)

    def inputs(self, delay: float) -> tuple[HeldColumn, ...]:
        """Force, then the terms, where they act."""
        return (self.commands.after(delay).times(self.moving), *self.terms)

    def slope_by_delay(self, device: HeldResponse, delay: float) -> Gain:
        """What the force adds in each interval, differentiated by its delay."""
        force = self.commands.after(delay)
        later = device.slope_by_delay(force, float(self.commands.value[0]))
        return Gain(velocity=later.velocity * self.moving, distance=later.distance * self.moving)

    @property
    def rates(self) -> tuple[float, float]:
        """p searched, 1/s."""
        step = mean_step(self.steps)
        return -_GROWTH / step / self.moving.size, _FASTEST / step

    def rate_of(self, values: FloatArray) -> float:
        """b/m as far as it is searched: where the force follows the position there is no mass."""
        return float(np.clip(values[1] / values[0] if values[0] > 0 else 0.0, *self.rates))

    def bounds(self, *between: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest θ searched: p, what is between, and the delay if it is fitted."""
        ranges = [self.rates, *between, *([self.delays] if self.delay is None else [])]
        low, high = np.array(ranges).T
        return low, high

    def delay_of(self, theta: FloatArray) -> float:
        """The delay, s: as given, or the last parameter."""
        return float(theta[-1]) if self.delay is None else self.delay

    @property
    def delays(self) -> tuple[float, float]:
        """Delays searched, s."""
        return 0.0, MOST_SAMPLES * mean_step(self.steps)
