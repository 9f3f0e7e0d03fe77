"""The balance of forces in short windows: what the findings look at after an estimate is made.

Each row weighs the log with one smooth window w of unit area: mean held force, mean acceleration
-∫ w'·q̇, mean velocity, direction of motion, position. No derivative of the position is taken
but its own difference quotient between two stamps, and the stamps are those of the log, so uneven
steps need no resampling (weak form: Shinbrot, Transactions of the ASME 79, 1957, p. 745).
It is coarser than an estimator on purpose, and shares nothing with them: it is there to doubt them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.estimators.linear import solve
from identification.estimators.model import Estimate, Gravity
from identification.estimators.noise import position_noise
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

#: Rows at most: enough for any finding, and a million samples stay quick.
MOST_ROWS = 4096
#: Rows used to choose the width.
_FEW_ROWS = 256
#: Rows at least.
_FEWEST = 64
#: Numbers held at once while rows are made, ...
_CHUNK = 1 << 20
#: ... and weighed in all: wide windows of a long log are spread out instead.
_MOST_WEIGHED = 1 << 22
#: Half-widths looked at, samples: from windows that barely smooth ...
_NARROWEST = 3.0
#: ... to this part of the log or this many samples, in _WIDTHS steps of equal ratio.
_WIDEST = 0.05
_WIDEST_SAMPLES = 1000.0
_WIDTHS = 12
#: Noise of position may make up this share of the mean square of the acceleration.
_NOISE_SHARE = 1e-3
#: Of the acceleration's mean square left by the narrowest quiet window, a wider one may lose this
#: part: what little moves faster is left to the noise.
_LOST = 0.02
#: Part of a window that goes one way more than the other; less is a stop or a turn.
_MOVING = 0.5
#: Rows that go the other way, as part of those that go either way, below which the motion is one
#: way.
ONE_WAY = 0.01
#: A window with an interval longer than this part of its half-width does not know its motion.
_LONGEST_INTERVAL = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Balance:
    """Rows of one log, each array of shape (rows,), SI.

    Attributes:
        time: middle of the window, s.
        force: N, delayed.
        acceleration: m/s².
        velocity: m/s.
        direction: mean of the sign of the velocity, -1 to 1.
        position: m.
        gravity: the term of position that the estimate carries, as in Model.
        half_width: of the window, s.
        noise_share: part of the mean square of the acceleration that is noise of position.
    """

    time: FloatArray
    force: FloatArray
    acceleration: FloatArray
    velocity: FloatArray
    direction: FloatArray
    position: FloatArray
    gravity: Gravity
    half_width: float
    noise_share: float

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
    def moving(self) -> NDArray[np.bool_]:
        """Rows in motion: at rest friction is whatever the force is, and says nothing."""
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
        """Force that the columns of ``plant`` and more columns leave over, N."""
        return left_over(np.column_stack((self.plant, *more)), self.force)

    def __len__(self) -> int:
        return self.time.size


def left_over(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Residual of a least-squares fit, shape (rows,)."""
    return right - columns @ solve(columns, right)


def balance_of(trajectory: Trajectory, chosen: Estimate | None = None) -> Balance:
    """Rows with the narrowest window that noise of position does not spoil.

    Args:
        trajectory: the log with its own stamps.
        chosen: gives the delay and the terms of gravity; None takes none of them.
    """
    delay = 0.0 if chosen is None else chosen.delay
    gravity: Gravity = "none" if chosen is None else chosen.model.gravity
    noise = position_noise(trajectory.position, trajectory.force)
    step = trajectory.sample_time
    span = float(trajectory.time[-1] - trajectory.time[0])
    widest = max(min(_WIDEST * span, _WIDEST_SAMPLES * step), 2 * _NARROWEST * step)
    widths = np.geomspace(_NARROWEST * step, widest, _WIDTHS)
    shares, powers = np.ones(_WIDTHS), np.zeros(_WIDTHS)
    for index, width in enumerate(widths):
        rows = _rows(trajectory, float(width), delay, noise, _FEW_ROWS, bend_only=True)
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


def balance_at(trajectory: Trajectory, half_width: float, delay: float) -> Balance:
    """Rows with a window of a given half-width, s, and a delay, s.

    They follow each other by half of the half-width; a log too long for that is looked at in its
    middle.
    """
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
    bend_only: bool = False,
) -> Balance:
    """Rows of a log; with ``bend_only`` of the acceleration alone, the rest being zero."""
    time = trajectory.time
    first, last = time[0] + max(half_width, delay) + half_width, time[-1] - half_width
    excess = max(0.0, last - first - span)
    first, last = first + excess / 2, last - excess / 2
    most = min(most, int(_MOST_WEIGHED * trajectory.sample_time / (2 * half_width + delay)))
    count = int(np.clip((last - first) / half_width * 2, _FEWEST, max(most, _FEWEST)))
    middle: FloatArray = np.linspace(min(first, last), last, count, dtype=np.float64)
    start: IntArray = np.maximum(np.searchsorted(time, middle - half_width - delay) - 1, 0)
    stop: IntArray = np.searchsorted(time, middle + half_width)
    longest = int(np.max(stop - start)) + 1
    parts: list[FloatArray] = []
    gain = 0.0
    for chunk in np.array_split(np.arange(count), 1 + count * longest // _CHUNK):
        index = np.minimum(start[chunk, None] + np.arange(longest + 1), time.size - 1)
        made, chunk_gain = _weighed(
            trajectory, index, middle[chunk, None], half_width, delay, bend_only=bend_only
        )
        parts.append(made)
        gain = max(gain, chunk_gain)
    table = np.concatenate(parts)
    # A window over a gap, or one that holds hardly a sample, says nothing.
    good = table[:, 5] <= _LONGEST_INTERVAL * half_width
    if np.count_nonzero(good) < _FEWEST:
        good = np.ones(count, dtype=bool)
    table = table[good]
    power = float(np.mean(table[:, 1] ** 2))
    parasitic = noise**2 * gain
    return Balance(
        time=middle[good],
        force=table[:, 0],
        acceleration=table[:, 1],
        velocity=table[:, 2],
        direction=table[:, 3],
        position=table[:, 4],
        gravity="none",
        half_width=half_width,
        noise_share=min(1.0, parasitic / power) if power > 0 else 1.0,
    )


def _weighed(
    trajectory: Trajectory,
    index: IntArray,
    middle: FloatArray,
    half_width: float,
    delay: float,
    *,
    bend_only: bool,
) -> tuple[FloatArray, float]:
    """Rows (force, acceleration, velocity, direction, position, longest interval), noise gain.

    The gain is the mean square of the acceleration per mean square of white noise of position.
    """
    stamps, place = trajectory.time[index], trajectory.position[index]
    steps = np.diff(stamps, axis=1)
    safe = np.where(steps > 0, steps, 1.0)
    slope = np.diff(place, axis=1) / safe
    shifted = (stamps - middle) / half_width
    bump = _window(shifted) / half_width
    bend = -np.diff(bump, axis=1)
    kernel = np.diff(bend / safe, axis=1, prepend=0.0, append=0.0)
    gain = float(np.median(np.sum(kernel**2, axis=1)))
    touched = (shifted[:, 1:] > -1) & (shifted[:, :-1] < 1) & (steps > 0)
    longest = np.max(np.where(touched, steps, 0.0), axis=1)
    if bend_only:
        nothing = np.zeros(len(index))
        acceleration = np.sum(bend * slope, axis=1)
        return np.stack((nothing, acceleration, *[nothing] * 3, longest), axis=1), gain
    area = np.diff(_area(shifted), axis=1)
    delayed = np.diff(_area(shifted + delay / half_width), axis=1)
    rows = (
        np.sum(delayed * trajectory.force[index[:, :-1]], axis=1),
        np.sum(bend * slope, axis=1),
        np.sum(area * slope, axis=1),
        np.sum(area * np.sign(slope), axis=1),
        np.sum(area * (place[:, :-1] + place[:, 1:]) / 2, axis=1),
        longest,
    )
    return np.stack(rows, axis=1), gain


def _window(u: FloatArray) -> FloatArray:
    """(1 + cos πu)²/3 on [-1, 1]: unit area, three continuous derivatives at the ends."""
    return (1 + np.cos(np.pi * np.clip(u, -1, 1))) ** 2 / 3


def _area(u: FloatArray) -> FloatArray:
    """Integral of the window from -1."""
    u = np.clip(u, -1, 1)
    pi_u = np.pi * u
    return ((1 + u) * 1.5 + (2 * np.sin(pi_u) + np.sin(2 * pi_u) / 4) / np.pi) / 3
