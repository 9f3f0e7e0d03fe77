"""Which way the device moved in each interval, and where it stood still.

Coulomb friction turns over exactly where the velocity does, and bends the velocity there. Smoothing
the position enough to beat encoder noise moves those turning points by a fraction of a millisecond,
always to the same side, which shifts damping by per cents. So the smoothed velocity is only the
start; ``refined`` adds the fast part of the velocity from the model itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.estimators.held import Held
from identification.estimators.low_pass import REACH, gaussian

FloatArray = NDArray[np.float64]

#: The first look at the velocity is smoothed until noise moves its zero crossings by this many
#: samples at the typical acceleration.
CROSSING_ERROR = 1.0
#: Widest smoothing of that first look, samples (standard deviation of the kernel).
WIDEST = 40.0
#: Half-width, in standard deviations, of the noise of a standing device.
NOISE_BAND = 3.0
#: A position that stays within its noise this many times longer than at a typical reversal stands.
LONG_DWELL = 4
#: The velocity after a rest is counted from the rest for at least this many samples.
SHORTEST_START = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """How the device moved in each interval.

    Attributes:
        direction: sign(q̇), by the time spent on either side where it turns; n - 1 intervals.
        moving: 1, or 0 where the device stood still, shape (n - 1,). Standing, static friction
            balances the force: q̈, q̇ and the sum of all forces are zero, whatever the force is.
    """

    direction: Held
    moving: FloatArray

    def released(self) -> Motion:
        """The same direction, and nothing that holds the device still."""
        return replace(self, moving=np.ones_like(self.moving))


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanics:
    """Values of the model for the refinement, SI units."""

    mass: float
    damping: float
    coulomb_friction: float
    force_offset: float


def always_moving(intervals: int) -> Motion:
    """A device without friction never stands still; its direction does not matter."""
    ones = np.ones(intervals)
    return Motion(direction=Held(early=ones, late=ones, fraction=0.0), moving=ones)


def first_look(position: FloatArray, *, noise: float, bend: float) -> Motion:
    """Direction and standstill from the position alone.

    Args:
        position: m, shape (n,).
        noise: standard deviation of one reading, m.
        bend: typical acceleration, m per sample².
    """
    width = WIDEST
    if bend > 0:
        # Variance of the derivative of a Gaussian kernel of width s: σ²/(4·√π·s³).
        ratio = noise / (CROSSING_ERROR * bend)
        width = min((ratio**2 / (4 * np.sqrt(np.pi))) ** (1 / 3), WIDEST)
    velocity = np.diff(_smooth(position, gaussian(width, 1.0)))
    ends = np.concatenate((velocity[:1], (velocity[1:] + velocity[:-1]) / 2, velocity[-1:]))
    even = np.ones(velocity.size)
    direction = _turning(ends[:-1], ends[1:], even, even)
    moving = 1.0 - _dwelling(position, noise, bend)
    return Motion(direction=direction.times(moving), moving=moving)


def refined(
    position: FloatArray,
    force: Held,
    step: float,
    *,
    kernel: FloatArray,
    mechanics: Mechanics,
    motion: Motion,
) -> Motion:
    """Direction and standstill with the model's help.

    The velocity is the model's, integrated from the force, plus the smoothed difference between
    the measured and the model's velocity: slow parts come from the measurement, the bend at a
    reversal from the model. Both pass through the same kernel, so nothing is shifted. A device
    that comes to rest while the force cannot overcome friction stands until it can.

    Args:
        position: m, shape (n,).
        force: where it acts, N, n - 1 intervals.
        step: sample time, s.
        kernel: symmetric smoothing weights.
        mechanics: mass (positive), damping and friction as estimated so far.
        motion: direction and standstill as known so far.
    """
    friction = max(mechanics.coulomb_friction, 0.0)
    measured = np.diff(position) / step
    pull = force.mean() - mechanics.force_offset
    net = motion.moving * (pull - friction * motion.direction.mean())
    drag = mechanics.damping * _smooth(measured, kernel)
    model = _integral((net - motion.moving * drag) * step / mechanics.mass)
    correction = _smooth(measured - (model[:-1] + model[1:]) / 2, kernel)
    velocity = model + np.concatenate(
        (correction[:1], (correction[1:] + correction[:-1]) / 2, correction[-1:])
    )
    mobility = step / mechanics.mass
    rest = _rest(velocity[:-1], pull, friction, mobility)
    reach = max(SHORTEST_START, kernel.size // (2 * int(REACH)))
    start, end = _released(velocity, rest, pull, friction, mobility, reach)
    before = np.abs(pull - friction * np.sign(start))
    after = np.abs(pull - friction * np.sign(end))
    direction = _turning(start, end, before, after)
    # Standing still, friction equals the pull; inside the interval in which it comes to rest, that
    # is the second part of the direction.
    stops = (rest > 0) & (rest < 1)
    direction = Held(
        early=direction.early,
        late=np.where(stops, pull / max(friction, np.finfo(float).tiny), direction.late),
        fraction=np.where(stops, 1 - rest, direction.fraction),
    )
    moving = np.where(rest == 1, 0.0, 1.0)
    return Motion(direction=direction.times(moving), moving=moving)


def _rest(velocity: FloatArray, pull: FloatArray, friction: float, mobility: float) -> FloatArray:
    """Part of each interval, at its end, in which static friction holds the device; shape (n - 1,).

    Rest begins when the speed is used up, and lasts until the pull exceeds friction.

    Args:
        velocity: at the start of each interval, m/s.
        pull: force less offset, N.
        friction: N.
        mobility: sample time over mass, s/kg.
    """
    held = np.abs(pull) < friction
    first = held & ~np.concatenate(([False], held[:-1]))
    if not first.any():
        return np.zeros_like(velocity)
    begin = np.maximum.accumulate(np.where(first, np.arange(velocity.size), 0))
    sense = np.sign(velocity[begin])
    speed = np.maximum(sense * velocity, 0.0)
    # What friction takes from the speed in one interval.
    loss = (friction - sense * pull) * mobility
    used_up = held & (speed <= loss)
    part = 1 - speed / np.where(used_up & (loss > 0), loss, np.inf)
    count = np.concatenate(([0], np.cumsum(used_up)))
    earlier = count[:-1] > count[begin]
    return np.where(held & earlier, 1.0, np.where(used_up, part, 0.0))


def _released(
    velocity: FloatArray,
    rest: FloatArray,
    pull: FloatArray,
    friction: float,
    mobility: float,
    reach: int,
) -> tuple[FloatArray, FloatArray]:
    """Velocity at start and end of each interval, counted from zero just after a rest.

    A device starts from rest in the sense of the pull and slowly; noise would guess the sense.
    """
    resting = rest > 0
    index = np.arange(rest.size)
    last = np.maximum.accumulate(np.where(resting, index, -1))
    release = np.minimum(last + 1, rest.size - 1)
    sense = np.sign(pull[release])
    gained = _integral(pull * mobility)
    begun = (last >= 0) & ~resting & (index - last <= reach)
    speeds: list[FloatArray] = []
    for shift in (0, 1):
        lost = sense * friction * mobility * (index + shift - release)
        since = gained[index + shift] - gained[release] - lost
        usable = begun & (sense * since >= 0)
        speeds.append(np.where(usable, since, velocity[index + shift]))
    return speeds[0], speeds[1]


def _integral(change: FloatArray) -> FloatArray:
    """Running sum from 0, one longer than its argument."""
    return np.concatenate(([0.0], np.cumsum(change)))


def _turning(start: FloatArray, end: FloatArray, before: FloatArray, after: FloatArray) -> Held:
    """sign of a velocity that a force ``before`` takes from start to zero, and ``after`` to end.

    The velocity reaches zero after |start|/before, and end |end|/after later.
    """
    turns = start * end < 0
    sign = np.where(start == 0, np.sign(end), np.sign(start))
    falling, rising = np.abs(start) * after, np.abs(end) * before
    total = np.where(turns, falling + rising, 0.0)
    fraction = np.where(total > 0, falling / np.where(total > 0, total, 1.0), 1.0)
    return Held(early=sign, late=np.where(turns, np.sign(end), sign), fraction=fraction)


def _smooth(column: FloatArray, kernel: FloatArray) -> FloatArray:
    """Convolution of the same length; the ends continue by odd reflection, which keeps slopes."""
    from scipy.signal import oaconvolve

    half = kernel.size // 2
    if half == 0:
        return column
    padded = np.pad(column, half, mode="reflect", reflect_type="odd")
    return oaconvolve(padded, kernel, mode="valid")


def _dwelling(position: FloatArray, noise: float, bend: float) -> FloatArray:
    """1 for intervals in which the position stays within its noise for long, 0 for the others."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    band = 2 * NOISE_BAND * noise
    if bend == 0 or band == 0:
        return np.where(np.diff(position) == 0, 1.0, 0.0)
    # A reversal at the typical acceleration leaves the band within the window of one dwell.
    window = 2 * LONG_DWELL * int(np.ceil(np.sqrt(2 * band / bend))) + 1
    if window >= position.size:
        return np.zeros(position.size - 1)
    reach = maximum_filter1d(position, window) - minimum_filter1d(position, window)
    still = maximum_filter1d((reach <= band).astype(np.float64), window)
    return still[:-1] * still[1:]
