"""Signals of one log: noise of a reading, forces under a zero-order hold, rows of the equation.

Interval k is [t[k], t[k+1]); a log of n samples has n - 1 of them, of any lengths. Everything that
acts on the device is constant over an interval but for jumps inside it, so the equation of motion
can be averaged and integrated exactly.

Row k is m·q̈ + b·q̇ + … = F multiplied by the triangle that is 1 at t[k] and 0 at both neighbours,
integrated and divided by the mean step. Integrated by parts, acceleration becomes the difference
of two slopes of position, velocity the difference of two means; a held force enters by its own
integral (HeldColumn.triangle). Any weighted sum of rows holds as well, so filters act on rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

#: Steps this many counts or fewer decide whether there is a grid; larger ones only add rounding.
_SMALL_STEPS = 50.0
#: Fewer small steps than this may lie on a grid by chance, unless there are no other steps.
_FEWEST_STEPS = 20
#: A step may miss a whole number of counts by this part of a count (printed digits).
_OFF_GRID = 0.05
#: Steps held at once.
_BLOCK = 1 << 20
#: The noise is read in the band from this part of the sampling rate to its half, ...
_BAND = 0.3
#: ... of second differences, cut to this many samples at most: more add time, not truth.
_LONGEST = 1 << 17
#: Answers by log, for as long as its columns live: everything that looks at a log asks for them.
_counts: dict[int, float | None] = {}
_noises: dict[tuple[int, int], float] = {}
#: Noise this many times the rounding of a count hides the count.
_HIDDEN = 2.0
#: A step longer than this many median steps has lost a sample.
LOST = 1.5
#: A delay this part of a sample beyond whole ones is whole: the rest is rounding of the stamps.
_HARDLY = 1e-6
#: The first row belongs to this sample, ...
FIRST = 2
#: ... and as many samples at the end have none: means of position need both neighbours' bend.
LAST = 2


def encoder_count(position: FloatArray) -> float | None:
    """The step all changes of position are multiples of, m; None if there is no such step."""
    key = id(position)
    if key in _counts:
        return _counts[key]
    count = _count_of(position)
    if _unchanging(position):
        _counts[key] = count
        finalize(position, _counts.pop, key, None)
    return count


def _unchanging(column: FloatArray) -> bool:
    """Whether nobody can write to a column, as to none of a Trajectory."""
    return column.base is None and not column.flags.writeable


def _count_of(position: FloatArray) -> float | None:
    # Below rounding of the values themselves a difference says nothing.
    floor = 16 * float(np.spacing(max(abs(position.max()), abs(position.min()))))
    blocks = [slice(i, i + _BLOCK + 1) for i in range(0, position.size - 1, _BLOCK)]
    smallest, told = np.inf, 0
    for rows in blocks:
        steps = _steps(position[rows], floor)
        told += steps.size
        smallest = min(smallest, float(steps.min(initial=np.inf)))
    if told == 0:
        return None
    small, crossed, square = 0, 0.0, 0.0
    for rows in blocks:
        steps = _steps(position[rows], floor, _SMALL_STEPS * smallest)
        whole = np.rint(steps / smallest)
        small += steps.size
        crossed += float(np.sum(steps * whole))
        square += float(np.sum(whole * whole))
    if small < min(_FEWEST_STEPS, told):
        return None
    count = crossed / square
    for rows in blocks:
        counts = _steps(position[rows], floor, _SMALL_STEPS * smallest) / count
        if np.max(np.abs(counts - np.rint(counts)), initial=0.0) >= _OFF_GRID:
            return None
    return count


def _steps(position: FloatArray, above: float, most: float = np.inf) -> FloatArray:
    """Sizes of the changes from one sample to the next that lie within some bounds, m."""
    steps = np.abs(np.diff(position))
    return steps[(steps > above) & (steps <= most)]


def position_noise(
    position: FloatArray, force: FloatArray, steps: float | FloatArray = 1.0
) -> float:
    """Standard deviation of one position reading, m, taken as white, rounding included.

    Read from the highest frequencies of the second difference, where a held force moves a device
    least; what follows the force even there is taken out first. Never below Δ/√12 of the encoder's
    count Δ (Widrow: rounding noise of a signal that crosses counts).
    """
    if isinstance(steps, np.ndarray) or not (_unchanging(position) and _unchanging(force)):
        return _noise_of(position, force, steps)
    key = id(position), id(force)
    if key not in _noises:
        _noises[key] = _noise_of(position, force, steps)
        for column in (position, force):
            finalize(column, _noises.pop, key, None)
    return _noises[key]


def _noise_of(position: FloatArray, force: FloatArray, steps: float | FloatArray) -> float:
    count = encoder_count(position)
    least = 0.0 if count is None else count / np.sqrt(12.0)
    middle = max(0, (position.size - _LONGEST) // 2)
    part = slice(middle, middle + _LONGEST)
    place, push = position[part], force[part]
    if isinstance(steps, np.ndarray):
        relative = (steps / np.mean(steps))[part][: place.size - 1]
        slope, uneven = np.diff(place) / relative, float(np.mean(relative**-2.0))
    else:
        slope, uneven = np.diff(place), 1.0
    window = np.hanning(place.size - 2)
    second = np.fft.rfft(np.diff(slope) * window)
    drive = np.fft.rfft((push[1:-1] + push[:-2]) / 2 * window)
    frequency = np.fft.rfftfreq(window.size)
    band = frequency >= _BAND
    second, drive, frequency = second[band], drive[band], frequency[band]
    power = float(np.sum(np.abs(drive) ** 2))
    if power > 0:
        second = second - drive * (np.sum(second * drive.conj()).real / power)
    gain = (2 * np.sin(np.pi * frequency)) ** 4 * np.sum(window**2) * uneven
    return max(least, float(np.sqrt(np.mean(np.abs(second) ** 2 / gain))))


def finest_reading(position: FloatArray, force: FloatArray) -> float:
    """Resolution of a log that does not state one: the encoder's count, m.

    If noise exceeds the rounding of that count, or there is no count, the count whose rounding
    would be as large as the noise.
    """
    count = encoder_count(position)
    equivalent = float(np.sqrt(12.0)) * position_noise(position, force)
    if count is not None and equivalent < _HIDDEN * count:
        return count
    return equivalent


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
        nothing = np.zeros(0)
        return cls(
            steps=steps,
            level=level,
            change=nothing,
            left=nothing,
            interval=np.zeros(0, dtype=np.intp),
        )

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
        """Integral over a triangle about each inner sample by the mean step, shape (n - 2,).

        The triangle is 1 at its sample and 0 at both neighbours. That is what the difference of
        two slopes of position makes of an acceleration, so mass times the one equals the other
        exactly for a pure mass, wherever the jumps are. Held evenly it is (x[k] + x[k-1])/2.
        """
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
        pieces = np.where(steps > LOST * usual, np.rint(steps / usual), 1.0).astype(np.intp)
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

    def part(self, samples: int) -> Commands:
        """Those of the first samples of the log."""
        if not isinstance(self.steps, np.ndarray) or self.sent is None:
            return replace(self, value=self.value[:samples])
        steps = self.steps[: samples - 1]
        count = int(np.searchsorted(self.sent, np.sum(steps), side="right"))
        return Commands(steps=steps, value=self.value[:count], sent=self.sent[:count])

    def after(self, delay: float) -> HeldColumn:
        """The forces where they act, a delay in s later, not negative, need not be whole steps.

        The first ``unknown_intervals`` feel forces from before the log; they repeat its first.
        """
        if not isinstance(self.steps, np.ndarray) or self.sent is None:
            steps = mean_step(self.steps)
            whole, fraction = _split(delay, steps)
            before = np.full(whole + 1, self.value[0])
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
    whole, fraction = _split(delay, step)
    left = 1 - fraction / step
    return whole, (left * left / 2, 0.5 + left - left * left, (1 - left) ** 2 / 2)


def mean_step(steps: float | FloatArray) -> float:
    """Mean length of the intervals of a log, s."""
    return float(np.mean(steps)) if isinstance(steps, np.ndarray) else steps


def _split(delay: float, step: float) -> tuple[int, float]:
    """Whole samples of a delay, and what is left of it, s."""
    whole = int(np.floor(delay / step))
    return whole, delay - whole * step


def unknown_intervals(steps: float | FloatArray, delay: float) -> int:
    """How many intervals at the start of a log feel forces from before it."""
    if not isinstance(steps, np.ndarray):
        return int(np.ceil(delay / steps - _HARDLY))
    return int(np.searchsorted(np.cumsum(steps), delay)) + 1 if delay > 0 else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Kinematics:
    """Unfiltered rows of acceleration (m/s²) and velocity (m/s), shape (n - 4,) each."""

    acceleration: FloatArray
    velocity: FloatArray

    @classmethod
    def of(cls, position: FloatArray, steps: float | FloatArray) -> Kinematics:
        """Rows of a position."""
        step = mean_step(steps)
        bend = np.diff(np.diff(position) / steps)
        # Mean position of an interval: the chord less what the motion bends away from it.
        between = (steps[1:] + steps[:-1]) / 2 if isinstance(steps, np.ndarray) else steps
        curved = bend / between
        bends = (curved[1:] + curved[:-1]) / 2
        inner = steps[1:-1] if isinstance(steps, np.ndarray) else steps
        mean = (position[1:-2] + position[2:-1]) / 2 - inner * inner / 12 * bends
        return cls(acceleration=bend[1:-1] / step, velocity=np.diff(mean) / step)


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
    kinematics: Kinematics  # rows of acceleration and velocity
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
            kinematics=Kinematics.of(position - np.mean(position), steps),
            noise=position_noise(position, trajectory.force, steps),
            reference=None if reference is None or np.ptp(reference) == 0 else reference,
        )

    def part(self, samples: int) -> Signals:
        """Those of the first samples alone, read with the noise of all."""
        steps = self.steps[: samples - 1] if isinstance(self.steps, np.ndarray) else self.steps
        position, reference = self.position[:samples], self.reference
        return replace(
            self,
            steps=steps,
            step=mean_step(steps),
            position=position,
            commands=self.commands.part(samples),
            speed=self.speed[: samples - 1],
            kinematics=Kinematics.of(position - np.mean(position), steps),
            reference=None if reference is None else reference[:samples],
        )
