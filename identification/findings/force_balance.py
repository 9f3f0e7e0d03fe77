"""Force balance in short windows: what the findings look at after an estimate is made.

Each row weighs the log with one smooth window w of unit area: mean held force, mean acceleration
-∫ w'·q̇, mean velocity, direction of motion, position. No derivative of the position is taken
but its own difference quotient between two stamps, and the stamps are those of the log, so uneven
steps need no resampling (weak form: Shinbrot, Transactions of the ASME 79, 1957, p. 745).
It is coarser than an estimator on purpose, and shares nothing with them: it is there to doubt them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.estimators.estimate import Estimate, Gravity, solve
from identification.trajectory import BoolArray, FloatArray, IndexArray, Trajectory, position_noise

MOST_ROWS = 4096  # rows at most: enough for any finding, and a million samples stay quick
_FEW_ROWS = 256  # rows used to choose the width
_FEWEST = 64  # rows at least
#: Numbers held at once while rows are made: columns of so many stay in the processor's cache, ...
_CHUNK = 1 << 15
#: ... and weighed in all: wide windows of a long log are spread out instead.
_MOST_WEIGHED = 1 << 22
_NARROWEST = 3.0  # half-widths looked at, samples: from windows that barely smooth ...
_WIDEST = 0.05  # ... to this part of the log or this many samples, in _WIDTHS steps of equal ratio.
_WIDEST_SAMPLES = 1000.0
_WIDTHS = 12
#: Noise of position may make up this share of the mean square of the acceleration.
_NOISE_SHARE = 1e-3
#: Of the acceleration's mean square left by the narrowest quiet window, a wider one may lose this
#: part: what little moves faster is left to the noise.
_LOST = 0.02
_MOVING = 0.5  # part of a window that goes one way more than the other; less is a stop or a turn
#: Rows that go the other way, as part of those that go either way, below which the motion is one
#: way.
ONE_WAY = 0.01
#: A window with an interval longer than this part of its half-width does not know its motion.
_LONGEST_INTERVAL = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceBalance:
    """Rows of one log, each array of shape (rows,), SI."""

    time: FloatArray  # middle of the window, s
    force: FloatArray  # N, delayed
    acceleration: FloatArray  # m/s²
    velocity: FloatArray  # m/s
    direction: FloatArray  # mean of the sign of the velocity, -1 to 1
    position: FloatArray  # m
    noise_share: float  # part of the mean square of the acceleration that is noise of position
    gravity: Gravity = "none"  # the term of position that the estimate carries, as in Model

    @property
    def plant(self) -> FloatArray:
        """Columns of mass, damping, Coulomb friction, offset, damping by direction, (rows, 5)."""
        columns = (
            self.acceleration,
            self.velocity,
            self.direction,
            np.ones_like(self.time),
            self.velocity * self.direction,
        )
        return np.stack(columns, axis=1)

    @property
    def moving(self) -> BoolArray:
        """Rows in motion, shape (rows,): at rest friction is whatever the force is."""
        return np.abs(self.direction) > _MOVING

    @property
    def one_way(self) -> bool:
        """Whether the motion never turns: friction, offset and a steady load are then one force."""
        forth, back = (np.count_nonzero(sense * self.direction > _MOVING) for sense in (1, -1))
        return bool(min(forth, back) < ONE_WAY * (forth + back))

    @property
    def carried(self) -> FloatArray:
        """Columns of the force of position that the estimate carries, shape (rows, 0 to 2)."""
        columns = {
            "none": (),
            "proportional": (self.position,),
            "pendulum": (np.sin(self.position), np.cos(self.position)),
        }[self.gravity]
        return np.stack(columns, axis=1) if columns else np.empty((len(self), 0))

    def unexplained(self, *more: FloatArray) -> FloatArray:
        """Force that ``plant`` and more columns, each (rows,), leave over, N, shape (rows,)."""
        return least_squares_residual(np.column_stack((self.plant, *more)), self.force)

    def unlogged(self, standing: BoolArray, *more: FloatArray) -> FloatArray:
        """What ``plant`` and more columns leave over in motion, and at rest beyond friction, N.

        Where the device stands, friction is whatever the force is, up to Coulomb's; shape (rows,).
        """
        columns = np.column_stack((self.plant, *more))
        told = self.moving | (np.count_nonzero(self.moving) < _FEWEST)
        weights = solve(columns[told], self.force[told])
        left: FloatArray = self.force - columns @ weights
        held = max(float(weights[2]), 0.0) * (1 - np.abs(self.direction)) * standing
        return np.sign(left) * np.maximum(np.abs(left) - held, 0.0)

    def __len__(self) -> int:
        return self.time.size


def least_squares_residual(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Residual of a least-squares fit, shape (rows,)."""
    return right - columns @ solve(columns, right)


def balance_of(trajectory: Trajectory, chosen: Estimate | None = None) -> ForceBalance:
    """Rows with the narrowest window that noise of position does not spoil."""
    delay = 0.0 if chosen is None else chosen.delay
    gravity: Gravity = "none" if chosen is None else chosen.model.gravity
    noise = position_noise(trajectory.position, trajectory.force)
    step = trajectory.sample_time
    span = float(trajectory.time[-1] - trajectory.time[0])
    widest = max(min(_WIDEST * span, _WIDEST_SAMPLES * step), 2 * _NARROWEST * step)
    widths = np.geomspace(_NARROWEST * step, widest, _WIDTHS)
    shares, powers = np.ones(_WIDTHS), np.zeros(_WIDTHS)
    for index, width in enumerate(widths):
        rows = _rows(trajectory, float(width), delay, noise, _FEW_ROWS)
        shares[index] = rows.noise_share
        powers[index] = float(np.mean(rows.acceleration**2)) * (1 - rows.noise_share)
        begun = int(np.argmax(shares <= _NOISE_SHARE))
        if shares[index] <= _NOISE_SHARE and powers[index] < (1 - _LOST) * powers[begun]:
            break  # wider windows lose more
    quiet = np.flatnonzero(shares <= _NOISE_SHARE)
    first = int(quiet[0]) if quiet.size else int(np.argmin(shares))
    kept = np.flatnonzero(powers[first:] >= (1 - _LOST) * powers[first])
    # Wider windows are taken as long as each one before kept its power.
    last = first + int(np.count_nonzero(np.cumsum(np.diff(kept, prepend=-1) != 1) == 0)) - 1
    rows = _rows(trajectory, float(widths[last]), delay, noise, MOST_ROWS)
    return replace(rows, gravity=gravity)


def balance_at(trajectory: Trajectory, half_width: float, delay: float) -> ForceBalance:
    """Rows of windows of a half-width, s, half of it apart, of a long log in its middle."""
    noise = position_noise(trajectory.position, trajectory.force)
    span = MOST_ROWS * half_width / 2
    return _rows(trajectory, half_width, delay, noise, MOST_ROWS, span=span)


def _rows(
    trajectory: Trajectory,
    half_width: float,
    delay: float,
    noise: float,
    most: int,
    *,
    span: float = np.inf,
) -> ForceBalance:
    """Rows of a log."""
    time = trajectory.time
    first, last = time[0] + max(half_width, delay) + half_width, time[-1] - half_width
    excess = max(0.0, last - first - span)
    first, last = first + excess / 2, last - excess / 2
    most = min(most, int(_MOST_WEIGHED * trajectory.sample_time / (2 * half_width + delay)))
    count = int(np.clip((last - first) / half_width * 2, _FEWEST, max(most, _FEWEST)))
    middle: FloatArray = np.linspace(min(first, last), last, count, dtype=np.float64)
    start: IndexArray = np.maximum(np.searchsorted(time, middle - half_width - delay) - 1, 0)
    stop: IndexArray = np.searchsorted(time, middle + half_width)
    longest = min(int(np.max(stop - start)) + 1, time.size - 1)
    start = np.minimum(start, time.size - 1 - longest)
    chunks = np.array_split(np.arange(count), 1 + count * longest // _CHUNK)
    parts: list[FloatArray] = []
    for chunk in chunks:
        index = start[chunk, None] + np.arange(longest + 1)
        parts.append(_weighed(trajectory, index, middle[chunk, None], half_width, delay))
    table = np.concatenate(parts)
    gain = float(np.median(table[:, 6]))
    # A window over a gap, or one that holds hardly a sample, says nothing.
    good = table[:, 5] <= _LONGEST_INTERVAL * half_width
    if np.count_nonzero(good) < _FEWEST:
        good = np.ones(count, dtype=bool)
    table = table[good]
    power = float(np.mean(table[:, 1] ** 2))
    parasitic = noise**2 * gain
    return ForceBalance(
        time=middle[good],
        force=table[:, 0],
        acceleration=table[:, 1],
        velocity=table[:, 2],
        direction=table[:, 3],
        position=table[:, 4],
        noise_share=min(1.0, parasitic / power) if power > 0 else 1.0,
    )


def _weighed(
    trajectory: Trajectory, index: IndexArray, middle: FloatArray, half_width: float, delay: float
) -> FloatArray:
    """Rows (force, acceleration, velocity, direction, position, longest interval, noise gain).

    The gain is the mean square of the acceleration per mean square of white noise of position.
    """
    stamps, place = trajectory.time[index], trajectory.position[index]
    steps = np.diff(stamps, axis=1)
    slope = np.diff(place, axis=1) / steps
    shifted = (stamps - middle) / half_width
    cosine = np.cos(np.pi * shifted)
    bump = _window(shifted, cosine) / half_width
    bend = bump[:, :-1] - bump[:, 1:]
    weight = bend / steps
    inner = np.diff(weight, axis=1)
    # Noise of the first and the last reading enters once.
    gain = np.einsum("ij,ij->i", inner, inner) + weight[:, 0] ** 2 + weight[:, -1] ** 2
    longest = np.max(steps, axis=1)
    if np.any(longest > _LONGEST_INTERVAL * half_width):
        touched = (shifted[:, 1:] > -1) & (shifted[:, :-1] < 1)
        longest = np.max(steps * touched, axis=1)
    acceleration = np.einsum("ij,ij->i", bend, slope)
    sine, late = np.sin(np.pi * shifted), delay / half_width
    turn = np.exp(1j * np.pi * late)
    later = sine * turn.real + cosine * turn.imag, cosine * turn.real - sine * turn.imag
    area = np.diff(_area(shifted, sine, cosine), axis=1)
    delayed = np.diff(_area(shifted + late, *later), axis=1)
    force = np.einsum("ij,ij->i", delayed, trajectory.force[index[:, :-1]])
    velocity = np.einsum("ij,ij->i", area, slope)
    direction = np.einsum("ij,ij->i", area, np.sign(slope))
    position = np.einsum("ij,ij->i", area, place[:, :-1] + place[:, 1:]) / 2
    rows = (force, acceleration, velocity, direction, position, longest, gain)
    return np.stack(rows, axis=1)


def _window(u: FloatArray, cosine: FloatArray) -> FloatArray:
    """(1 + cos πu)²/3 on [-1, 1]: unit area, three continuous derivatives at the ends."""
    raised = np.where(np.abs(u) < 1, 1 + cosine, 0.0)
    return raised * raised / 3


def _area(u: FloatArray, sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """Integral of the window from -1, given sine and cosine of πu."""
    # sin 2πu/4 is sin πu·cos πu/2.
    inside = ((1 + u) * 1.5 + sine * (2 + cosine / 2) / np.pi) / 3
    return np.where(np.abs(u) < 1, inside, u > 0)
