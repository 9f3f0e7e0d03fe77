"""Signals of one log under a zero-order hold, and the response of a mass with damping to them.

Interval k is [t[k], t[k+1]); a log of n samples has n - 1 of them, of any lengths. Everything that
acts on the device is constant over an interval but for jumps inside it, so the equation of motion
is averaged and integrated exactly, for any p = b/m. Rows: docs/theory.md, 7.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.estimators.filters import recursive
from identification.trajectory import LOST, FloatArray, IndexArray, Trajectory, position_noise

#: A delay this part of a sample beyond whole ones is whole: the rest is rounding of the stamps.
_HARDLY = 1e-6
#: The first row belongs to this sample, ...
FIRST = 2
#: ... and as many samples at the end have none: means of position need both neighbours' bend.
LAST = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldColumn:
    """A column that is constant over each interval but for jumps."""

    steps: float | FloatArray  # length of the intervals, s: one number, or shape (n - 1,)
    level: FloatArray  # value at the start of each interval, shape (n - 1,)
    change: FloatArray  # size of each jump, shape (j,); none if empty
    #: time from each jump to the end of its interval, s: one number, or shape (j,)
    left: float | FloatArray
    #: interval of each jump, shape (j,); None means one jump in every interval
    interval: IndexArray | None

    @classmethod
    def constant(cls, level: FloatArray, steps: float | FloatArray) -> HeldColumn:
        """One value for each interval, shape (n - 1,), without jumps."""
        never = np.zeros(0, dtype=np.intp)
        return cls(steps=steps, level=level, change=np.zeros(0), left=np.zeros(0), interval=never)

    @classmethod
    def turning(
        cls, early: FloatArray, late: FloatArray, fraction: FloatArray, steps: float | FloatArray
    ) -> HeldColumn:
        """``early`` for a fraction of each interval, then ``late``; all of shape (n - 1,)."""
        jumps = np.flatnonzero((early != late) & (fraction > 0) & (fraction < 1))
        lengths = np.broadcast_to(np.asarray(steps), early.shape)[jumps]
        return cls(
            steps=steps,
            level=np.where(fraction > 0, early, late),
            change=(late - early)[jumps],
            left=(1 - fraction[jumps]) * lengths,
            interval=jumps,
        )

    def added(self, weight: FloatArray | float) -> FloatArray:
        """Sum over the jumps of each interval of change times weight, shape (n - 1,)."""
        total = self.change * weight
        if self.interval is None:
            return total
        sums = np.bincount(self.interval, total, minlength=self.level.size)
        return sums.astype(np.float64, copy=False)

    def mean(self) -> FloatArray:
        """Mean over each interval, shape (n - 1,)."""
        return self.level + self.added(self.left) / self.steps if self.change.size else self.level

    def triangle(self) -> FloatArray:
        """Integral over a triangle, 1 at an inner sample, 0 beside, by the mean step, (n - 2,)."""
        half = self.level * self.steps / 2
        if not self.change.size:
            falling = rising = half
        else:
            square = self.left * self.left / 2
            after = self.added(square) / self.steps
            falling = half + after
            rising = half + self.added(self.left) - after
        return (falling[1:] + rising[:-1]) / mean_step(self.steps)

    def times(self, factor: FloatArray) -> HeldColumn:
        """The column times a factor for each interval, shape (n - 1,)."""
        of_jump = factor if self.interval is None else factor[self.interval]
        return replace(self, level=self.level * factor, change=self.change * of_jump)


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """The forces a controller sent during one log."""

    #: length of the intervals of the log, s: one number, or shape (n - 1,)
    steps: float | FloatArray
    value: FloatArray  # N, shape (c,); with even steps one for each of the n samples
    #: when each was sent, s after the first sample, shape (c,); None with even steps
    sent: FloatArray | None

    @classmethod
    def of(cls, force: FloatArray, steps: float | FloatArray) -> Commands:
        """Commands of a log: row k was sent at t[k] and is held until the next is sent.

        A step LOST times the median or more has lost rows. The controller sent forces there that
        nobody wrote down; they are taken to lie on the straight line between their neighbours.
        """
        if not isinstance(steps, np.ndarray):
            return cls(steps=steps, value=force, sent=None)
        sent = np.concatenate(([0.0], np.cumsum(steps)))
        usual = float(np.median(steps))
        # Rows that were late lost none: those that were missed follow at once.
        lost = (steps > LOST * usual) & (np.append(steps[1:], usual) > (2 - LOST) * usual)
        pieces = np.where(lost, np.rint(steps / usual), 1.0).astype(np.intp)
        if np.all(pieces == 1):
            return cls(steps=steps, value=force, sent=sent)
        row = np.repeat(np.arange(steps.size), pieces)
        first = np.repeat(np.cumsum(pieces) - pieces, pieces)
        part = (np.arange(row.size) - first) / pieces[row]
        return cls(
            steps=steps,
            value=np.append(force[row] + part * (force[row + 1] - force[row]), force[-1]),
            sent=np.append(sent[row] + part * steps[row], sent[-1]),
        )

    def after(self, delay: float) -> HeldColumn:
        """The forces where they act, a delay in s later, not negative, need not be whole steps.

        The first ``unknown_intervals`` feel forces from before the log; they repeat its first.
        """
        if not isinstance(self.steps, np.ndarray) or self.sent is None:
            steps = mean_step(self.steps)
            full, fraction = _split(delay, steps)
            before = np.full(full + 1, self.value[0])
            padded = np.concatenate((before, self.value))[: self.value.size]
            late, early = padded[1:], padded[:-1]
            if fraction == 0:
                return HeldColumn.constant(late, steps)
            return HeldColumn(
                steps=steps, level=early, change=late - early, left=steps - fraction, interval=None
            )
        time = np.concatenate(([0.0], np.cumsum(self.steps)))
        arrival = self.sent + delay
        # Those that act from before an interval, or from its very start, make its level.
        acting = np.searchsorted(arrival, time[:-1], side="right") - 1
        interval = np.searchsorted(time, arrival, side="right") - 1
        inside = interval < self.steps.size
        inside[inside] = arrival[inside] > time[interval[inside]]
        inside[0] = False
        interval = interval[inside]
        return HeldColumn(
            steps=self.steps,
            level=self.value[np.maximum(acting, 0)],
            change=np.diff(self.value, prepend=self.value[0])[inside],
            left=time[interval + 1] - arrival[inside],
            interval=interval.astype(np.intp),
        )


def even_taps(delay: float, step: float) -> tuple[int, tuple[float, float, float]]:
    """How a triangle sees a force that is held evenly and delayed (HeldColumn.triangle).

    Whole samples of the delay, and the weights of the force sent so long before the sample, one
    sample earlier and two earlier.
    """
    full, fraction = _split(delay, step)
    left = 1 - fraction / step
    return full, (left * left / 2, 0.5 + left - left * left, (1 - left) ** 2 / 2)


def mean_step(steps: float | FloatArray) -> float:
    """Mean length of the intervals of a log, s."""
    return float(np.mean(steps)) if isinstance(steps, np.ndarray) else steps


def _split(delay: float, step: float) -> tuple[int, float]:
    """Whole samples of a delay, and what is left of it, s."""
    full = int(np.floor(delay / step))
    return full, delay - full * step


def unknown_intervals(steps: float | FloatArray, delay: float) -> int:
    """How many intervals at the start of a log feel forces from before it."""
    if not isinstance(steps, np.ndarray):
        return int(np.ceil(delay / steps - _HARDLY))
    return int(np.searchsorted(np.cumsum(steps), delay)) + 1 if delay > 0 else 0


def kinematics_of(position: FloatArray, steps: float | FloatArray) -> FloatArray:
    """Unfiltered rows of acceleration (m/s²) and velocity (m/s), shape (2, n - 4)."""
    bend = np.diff(np.diff(position) / steps)
    # Mean position of an interval: the chord less what the motion bends away from it.
    between = (steps[1:] + steps[:-1]) / 2 if isinstance(steps, np.ndarray) else steps
    curved = bend / between
    bends = (curved[1:] + curved[:-1]) / 2
    inner = steps[1:-1] if isinstance(steps, np.ndarray) else steps
    mean = (position[1:-2] + position[2:-1]) / 2 - inner * inner / 12 * bends
    return np.stack((bend[1:-1], np.diff(mean))) / mean_step(steps)


def of_rows(triangles: FloatArray) -> FloatArray:
    """Those of n - 2 triangles that have a row of kinematics, shape (n - 4,)."""
    return triangles[FIRST - 1 : triangles.size - LAST + 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Signals:
    """What every estimator reads of one log."""

    #: length of the intervals, s: one number if the log is even, else shape (n - 1,)
    steps: float | FloatArray
    step: float  # their mean, s
    position: FloatArray  # m, shape (n,)
    commands: Commands  # forces as logged
    speed: FloatArray  # mean velocity of each interval, m/s, shape (n - 1,)
    kinematics: FloatArray  # rows of acceleration and velocity, shape (2, n - 4)
    noise: float  # standard deviation of one position reading, m
    #: logged set-point, m, shape (n,); None if there is none, or it never moves
    reference: FloatArray | None

    @classmethod
    def of(cls, trajectory: Trajectory) -> Signals:
        """Signals of a log, time stamps as they are."""
        steps, position, reference = trajectory.steps, trajectory.position, trajectory.reference
        return cls(
            steps=steps,
            step=mean_step(steps),
            position=position,
            commands=Commands.of(trajectory.force, steps),
            speed=np.diff(position) / steps,
            kinematics=kinematics_of(position - np.mean(position), steps),
            noise=position_noise(position, trajectory.force, steps),
            reference=None if reference is None or np.ptp(reference) == 0 else reference,
        )


#: Below this |δ| the φ-functions are summed as series, above it taken from expm1.
_SERIES_BELOW = 0.5
#: Terms of the series: 0.5^16/18! is below the last bit.
_TERMS = 18


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
    def during(cls, span: float | FloatArray, rate: float | FloatArray) -> StepResponse:
        """For times in s and p in 1/s, of shapes that broadcast."""
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
class HeldResponse:
    """A device of rate p on the grid of one log, moved by held columns.

    A gain is velocity and distance that each interval adds by itself, shape (2, n - 1).
    """

    rate: float  # p, 1/s
    full: StepResponse  # of one full interval; numbers, or arrays of shape (n - 1,)
    steps: float | FloatArray  # length of the intervals, s: one number, or shape (n - 1,)

    @classmethod
    def at(cls, rate: float, steps: float | FloatArray) -> HeldResponse:
        """For p in 1/s and the steps of a log in s: one number, or shape (n - 1,)."""
        return cls(rate=rate, full=StepResponse.during(steps, rate), steps=steps)

    def gain(self, column: HeldColumn) -> FloatArray:
        """What a column, force per mass, adds in each interval."""
        return self._moved(column, lambda response: (response.speed, response.place))

    def slope_by_rate(self, column: HeldColumn) -> FloatArray:
        """Derivative of ``gain`` by p."""
        return self._moved(column, lambda response: (response.speed_slope, response.place_slope))

    def _moved(
        self, column: HeldColumn, of: Callable[[StepResponse], tuple[FloatArray, FloatArray]]
    ) -> FloatArray:
        """What a column adds of two parts of the response, with its jumps inside the intervals."""
        gain = np.stack([column.level * part for part in of(self.full)])
        if column.change.size:
            jump = of(StepResponse.during(column.left, self.rate))
            gain += [column.added(part) for part in jump]
        return gain

    def slope_by_delay(self, column: HeldColumn, first: float) -> FloatArray:
        """Derivative of ``gain`` by a delay of all jumps; ``first`` is the value before the log."""
        level = column.level
        before = np.concatenate(([first], level[:-1]))
        if column.change.size:
            inside = column.added(1.0)
            before[1:] += inside[:-1]
        border = level - before
        slope = np.stack((-border * self.full.decay, -border * self.full.speed))
        if column.change.size:
            jump = StepResponse.during(column.left, self.rate)
            slope -= [column.added(jump.decay), column.added(jump.speed)]
        return slope

    def speed(self, added: FloatArray, start: float = 0.0) -> FloatArray:
        """Velocity at each sample, shape (n,), from what intervals add to it, shape (n - 1,)."""
        if self.full.decay.ndim == 0:
            return recursive(np.concatenate(([start], added)), -float(self.full.decay))
        return accumulate_decay(self.full.decay, [added], [start])[0]

    def position(self, gain: FloatArray, start: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Position and velocity, shape (n,) each, from rest at zero or from a start velocity."""
        speed = self.speed(gain[0], start)
        moved = self.full.speed * speed[:-1] + gain[1]
        return np.concatenate(([0.0], np.cumsum(moved))), speed

    def coasting(self, intervals: int) -> FloatArray:
        """Position, shape (n,), from a start velocity of 1 under no force."""
        return self.position(np.zeros((2, intervals)), start=1.0)[0]


def accumulate_decay(
    decay: FloatArray, added: Sequence[FloatArray], start: Sequence[float]
) -> FloatArray:
    """Velocities, shape (columns, n), where each interval leaves its own part of the one before."""
    rows = np.empty((len(start), decay.size + 1))
    rows[:, 0] = start
    for index, column in enumerate(added):
        rows[index, 1:] = column
    return recursive(rows, -np.concatenate(([0.0], decay)))
