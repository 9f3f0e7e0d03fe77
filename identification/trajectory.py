"""Logged motions of one axis, or of several at once, checked when made, and noise of readings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar, cast, get_args
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding, InvalidInputError, LogRefusedError, UsageError, refusal

_Answer = TypeVar("_Answer")
Motion = Literal["linear", "rotary"]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
ComplexArray = NDArray[np.complex128]

#: Axes of one device at most: every pair has its entries in two matrices.
MOST_AXES = 6
#: Fewer samples than this cannot carry two parameters, friction and an interval.
SHORTEST = 200
#: A step longer than this many median steps has lost a sample.
LOST = 1.5
#: Half-width of the 95 % interval of a normal variable, in standard deviations.
NORMAL_95 = 1.959963984540054
#: Stamps this part of a step from an even grid are even: 1 us at 1 kHz, a clock's own reading.
EVEN = 1e-3
#: Rounding moves a stamp by half of its last digit, and a little more by the grid's own fit.
_ROUNDING = 0.6
#: Digits after the point that stamps are looked at for, ...
_FEWEST_DIGITS, _MOST_DIGITS = 0, 7
#: ... and how far, in digits, double precision may put them off.
_OFF_DIGIT = 1e-4
#: Size of any column, and least change of force and position, in SI units: beyond, squares would
#: not be numbers any more. Micro-manipulators and presses lie many orders inside.
_LARGEST = 1e12
_SMALLEST = 1e-12
#: Samples an estimate is made of at most: eight minutes at 1 kHz, where noise has long ceased to
#: limit the intervals. Estimators hold up to a hundred numbers a sample.
MOST_FITTED = 500_000
#: Steps this many counts or fewer decide whether there is a grid; larger ones only add rounding.
_SMALL_STEPS = 50.0
#: Fewer small steps than this may lie on a grid by chance, unless there are no other steps.
_FEWEST_STEPS = 20
#: A step may miss a whole number of counts by this part of a count (printed digits).
_OFF_GRID = 0.05
#: The noise is read in the band from this part of the sampling rate to its half, ...
_BAND = 0.3
#: ... of second differences, cut to this many samples at most: more add time, not truth.
_LONGEST = 1 << 17
#: Answers by log, for as long as its columns live: everything that looks at a log asks for them.
_answers: dict[tuple[object, ...], object] = {}
#: Noise this many times the rounding of a count hides the count.
_HIDDEN = 2.0
#: The middle of a log is as excited as the most excited part down to this part of it.
_AS_EXCITED = 0.1
#: Stretches of a log that a finding names at most.
_MOST_SPANS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectory:
    """Time, force and position of one axis, SI units, arrays of one length n, read-only.

    Args:
        time: s, shape (n,), strictly increasing.
        force: N (N·m if rotary), shape (n,): what the actuator applies to the device, positive
            along +position; ``force[k]`` is held from ``time[k]`` to ``time[k+1]``.
        position: m (rad if rotary), shape (n,).
        reference: logged set-point in the unit of position, shape (n,), or None.
        axis: name of the axis the log belongs to.
        motion: "linear" or "rotary"; None where nobody said it.
        stated_units: of "force" and "position", those whose unit a person stated, so that their
            size alone is no reason to ask.
        source: where the samples come from, for messages and for the device file.
        digest: "sha256:…" of the file the samples come from, or "".
        read_as: how a file that is no plain table in SI units was understood, or "".
        may_stand: whether force and position may be constant, beside other axes that are driven.

    Raises:
        LogRefusedError: too-short, non-finite, clock-backward or constant-column.
        UsageError: another kind of motion, or columns that are not real, not one-dimensional or not
            of one length.
    """

    time: FloatArray
    force: FloatArray
    position: FloatArray
    reference: FloatArray | None = None
    axis: str = "x"
    motion: Motion | None = None
    stated_units: frozenset[str] = frozenset()
    source: str = "trajectory"
    digest: str = ""
    read_as: str = ""
    may_stand: bool = False
    #: Median step between samples, s.
    sample_time: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.motion not in (None, *get_args(Motion)):
            problem = f"is {self.motion!r}"
            raise UsageError("motion", problem, "Give 'linear', 'rotary' or None: nobody said it")
        for name in ("time", "force", "position", "reference"):
            column = getattr(self, name)
            if np.iscomplexobj(column):
                raise UsageError(name, "is complex", "Give real numbers")
            if name != "reference" or column is not None:
                object.__setattr__(self, name, _frozen(column))
        if any(column.shape != (self.time.size,) for _, column in self.columns()):
            shapes = {name: column.shape for name, column in self.columns()}
            raise UsageError("columns", f"have shapes {shapes}", "Give one dimension, one length")
        findings = tuple(each.of(self.source) for each in _defects(self))
        if findings:
            raise LogRefusedError(findings)
        object.__setattr__(self, "sample_time", float(np.median(np.diff(self.time))))

    def __repr__(self) -> str:
        length = float(self.time[-1] - self.time[0])
        return (
            f"Trajectory({self.source}, axis {self.axis}, {self.motion or 'motion not stated'}: "
            f"{self.time.size} samples, "
            f"{length:.4g} s, {'with' if self.reference is not None else 'without'} a reference)"
        )

    def columns(self) -> tuple[tuple[str, FloatArray], ...]:
        """The columns present, by name; each of shape (n,)."""
        named = (("time", self.time), ("force", self.force), ("position", self.position))
        return named if self.reference is None else (*named, ("reference", self.reference))

    @property
    def steps(self) -> float | FloatArray:
        """Length of the intervals, s: one number if the stamps are even, else shape (n - 1,).

        Stamps count as even if no one lies further from an even grid than EVEN of a step, or than
        rounding to the digits they were printed with explains.
        """
        count = self.time.size - 1
        step = float(self.time[-1] - self.time[0]) / count
        off = self.time - (self.time[0] + step * np.arange(count + 1))
        middle = (float(off.max()) + float(off.min())) / 2
        furthest = float(off.max()) - middle
        if furthest <= EVEN * step or furthest <= _ROUNDING * _printed_digit(self.time, step):
            return step
        return np.diff(self.time)

    def part(self, rows: slice) -> Trajectory:
        """Consecutive rows as a log of their own."""
        columns = {name: column[rows] for name, column in self.columns()}
        return replace(self, **columns)

    def spans(self, chosen: BoolArray) -> tuple[tuple[float, float], ...]:
        """First and last time, s, of each run of chosen rows, shape (n,); a hundred at most."""
        edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False)).reshape(-1, 2)
        ends = self.time[edges[:_MOST_SPANS] - (0, 1)]
        return tuple((float(first), float(last)) for first, last in ends)

    def __len__(self) -> int:
        return self.time.size


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectories:
    """Forces and positions of several axes over one time.

    Args:
        axes: the log of each axis, of one time, one kind of motion and names of their own.

    Raises:
        UsageError: fewer than two or more than six axes, axes of other kinds, names or times.
    """

    axes: tuple[Trajectory, ...]

    def __post_init__(self) -> None:
        if not 1 < len(self.axes) <= MOST_AXES:
            problem = f"{len(self.axes)} given"
            raise UsageError("axes", problem, f"Give two to {MOST_AXES} axes of one device")
        if len(set(self.names)) < len(self.axes):
            listed = ", ".join(self.names)
            raise UsageError("--axis", f"is {listed}", "Give each axis a name of its own")
        kinds = list(dict.fromkeys(each.motion or "not stated" for each in self.axes))
        if len(kinds) > 1:
            problem = f"the axes are {' and '.join(kinds)}"
            raise UsageError("--motion", problem, "Give linear axes together, or rotary ones")
        first = self.axes[0].time
        if any(not np.array_equal(each.time, first) for each in self.axes):
            raise UsageError("axes", "differ in their times", "Log all axes in one file")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(each.axis for each in self.axes)

    @property
    def axis(self) -> str:
        """Names of all axes, as one."""
        return ",".join(self.names)

    @property
    def motion(self) -> Motion | None:
        """Linear or rotary; None where nobody said it."""
        return self.axes[0].motion

    @property
    def digest(self) -> str:
        """Digest of the file the log comes from, or ""."""
        return self.axes[0].digest

    @property
    def read_as(self) -> str:
        """How a file that is no plain table in SI units was understood, or ""."""
        return self.axes[0].read_as

    @property
    def source(self) -> str:
        """Where the log comes from, for messages."""
        return self.axes[0].source

    def __len__(self) -> int:
        return len(self.axes[0])


def _frozen(column: FloatArray) -> FloatArray:
    """A read-only array that nobody else can write to; one that is so already is not copied."""
    array = np.asarray(column, dtype=np.float64)
    if array is column and array.base is None and not array.flags.writeable:
        return array
    array = np.array(array)
    array.setflags(write=False)
    return array


def _printed_digit(time: FloatArray, step: float) -> float:
    """The decimal digit all stamps are multiples of, at most a step, s; 0 if there is none."""
    for power in range(_FEWEST_DIGITS, _MOST_DIGITS):
        digit = 10.0**-power
        if digit <= step:
            scaled = time / digit
            if np.all(np.abs(scaled - np.rint(scaled)) < _OFF_DIGIT):
                return digit
    return 0.0


def _defects(trajectory: Trajectory) -> Iterator[Finding]:
    """Everything that makes the numbers unusable whatever the estimator."""
    count, source = len(trajectory), trajectory.source
    if count < SHORTEST:
        seen, needed = f"{source} has {count} samples", f"at least {SHORTEST}"
        yield refusal("too-short", seen=seen, needed=needed, remedy="Log for longer.")
        return
    bad = {name: np.flatnonzero(~np.isfinite(column)) for name, column in trajectory.columns()}
    bad = {name: rows for name, rows in bad.items() if rows.size}
    for name, rows in bad.items():
        yield refusal(
            "non-finite",
            seen=f"{rows.size} of {count} values of {name} in {source} are "
            f"missing or infinite, the first in sample {rows[0]}",
            needed="a finite number in every row",
            remedy="Export the log again, or cut it to the part that is whole.",
        )
    if bad:
        return
    time = trajectory.time
    backward = np.flatnonzero(np.diff(time) <= 0)
    if backward.size:
        first = int(backward[0])
        yield refusal(
            "clock-backward",
            seen=f"time does not increase at {backward.size} of {count - 1} steps of {source}, "
            f"first from {time[first]:g} s to {time[first + 1]:g} s",
            needed="strictly increasing time in seconds",
            remedy="Log a monotonic clock, or export with more digits of time; where another "
            "trial begins, cut there and give each as a log of its own.",
        )
    for name in () if trajectory.may_stand else ("force", "position"):
        column = getattr(trajectory, name)
        if np.ptp(column) == 0:
            yield refusal(
                "constant-column",
                seen=f"{name} in {source} is {column[0] + 0.0:g} in every row",
                needed="a column that varies",
                remedy=f"Name the right column with --{name}, or drive the device while logging.",
            )


def refuse_sizes(trajectory: Trajectory) -> None:
    """Raises InvalidInputError for a column beyond any device, or one that hardly changes."""
    for name, column in trajectory.columns():
        low, high = float(np.min(column)), float(np.max(column))
        largest, change = max(abs(low), abs(high)), high - low
        moved = name in {"force", "position"} and not (trajectory.may_stand and change == 0)
        if largest > _LARGEST or (moved and change < _SMALLEST):
            raise InvalidInputError(
                trajectory.source,
                f"{name} reaches {largest:.3g} and changes by {change:.3g}, outside of "
                f"{_SMALLEST:g} to {_LARGEST:g}",
                f"Name the right column with --{name}, and give gains that make it SI",
            )


def encoder_count(position: FloatArray) -> float | None:
    """The step all changes of position are multiples of, m; None if there is no such step."""
    return _remembered(_count_of, position)


def _remembered(make: Callable[..., _Answer], *columns: FloatArray) -> _Answer:
    """What is made of columns, once where nobody can write to them, as to none of a Trajectory."""
    if any(each.base is not None or each.flags.writeable for each in columns):
        return make(*columns)
    key = (make, *map(id, columns))
    if key not in _answers:
        _answers[key] = make(*columns)
        for column in columns:
            finalize(column, _answers.pop, key, None)
    return cast("_Answer", _answers[key])


def _count_of(position: FloatArray) -> float | None:
    # Below rounding of the values themselves a difference says nothing.
    floor = 16 * float(np.spacing(max(abs(position.max()), abs(position.min()))))
    steps = np.abs(np.diff(position))
    steps = steps[steps > floor]
    if not steps.size:
        return None
    smallest = float(steps.min())
    small = steps[steps <= _SMALL_STEPS * smallest]
    if small.size < min(_FEWEST_STEPS, steps.size):
        return None
    whole = np.rint(small / smallest)
    count = float(np.sum(small * whole)) / float(np.sum(whole * whole))
    counts = small / count
    return count if np.max(np.abs(counts - np.rint(counts))) < _OFF_GRID else None


def position_noise(
    position: FloatArray, force: FloatArray, steps: float | FloatArray = 1.0
) -> float:
    """Standard deviation of one position reading, m, taken as white, rounding included.

    Read from the highest frequencies of the second difference, where a held force moves a device
    least; what follows the force even there is taken out first. Never below Δ/√12 of the encoder's
    count Δ (Widrow: rounding noise of a signal that crosses counts).
    """
    if isinstance(steps, np.ndarray):
        return _noise_of(position, force, steps)
    return _remembered(_noise_of, position, force)


def _noise_of(position: FloatArray, force: FloatArray, steps: float | FloatArray = 1.0) -> float:
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
    """Resolution of a log that states none, m: its count, or one that rounds as much as noise."""
    count = encoder_count(position)
    equivalent = float(np.sqrt(12.0)) * position_noise(position, force)
    if count is not None and equivalent < _HIDDEN * count:
        return count
    return equivalent


def most_excited(trajectory: Trajectory) -> Trajectory:
    """The consecutive MOST_FITTED samples with the largest mean square velocity, or fewer: all."""
    spare = len(trajectory) - MOST_FITTED
    if spare <= 0:
        return trajectory
    # Neighbours overlap by half.
    starts = np.linspace(0, spare, 1 + int(np.ceil(2 * spare / MOST_FITTED))).astype(np.intp)
    parts = [slice(int(start), int(start) + MOST_FITTED) for start in starts]

    def mean_square_velocity(rows: slice) -> float:
        velocity = np.diff(trajectory.position[rows]) / np.diff(trajectory.time[rows])
        return float(np.mean(velocity**2))

    return trajectory.part(max(parts, key=mean_square_velocity))


def excited_part(trajectory: Trajectory, samples: int) -> Trajectory:
    """So many consecutive samples: those in the middle, or others that are excited far more.

    What excites is the product of the mean squares of velocity and of changes of the force: a
    sweep has as much of it when it is slow as when it is fast. The whole log, if no part has both.
    """
    spare = len(trajectory) - samples
    if spare <= 0:
        return trajectory
    velocity = np.diff(trajectory.position) / np.diff(trajectory.time)
    powers = np.stack((velocity**2, np.diff(trajectory.force) ** 2))
    sums = np.pad(np.cumsum(powers, axis=1), ((0, 0), (1, 0)))
    # Neighbours overlap by half.
    starts = np.linspace(0, spare, 1 + int(np.ceil(2 * spare / samples))).astype(np.intp)
    starts = np.append(spare // 2, starts)
    excited = np.prod(sums[:, starts + samples - 1] - sums[:, starts], axis=0)
    best = int(np.argmax(excited))
    if excited[best] <= 0:
        return trajectory
    first = int(starts[best if excited[0] < _AS_EXCITED * excited[best] else 0])
    return trajectory.part(slice(first, first + samples))
