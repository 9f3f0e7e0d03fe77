"""Direction of motion in each interval, where the device stood still, and the terms of both.

Coulomb friction turns over exactly where the velocity does, and bends the velocity there. Smoothing
the position enough to beat encoder noise moves those turning points by a fraction of a millisecond,
always to the same side, which shifts damping by per cents. So the smoothed velocity is only the
start; ``refine_motion`` adds the fast part of the velocity from the model itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from identification.estimators.estimate import Model
from identification.estimators.filters import REACH, LowPass, gaussian
from identification.estimators.signals import HeldColumn
from identification.trajectory import BoolArray, FloatArray, Trajectory, position_noise

#: The first look at the velocity is smoothed until noise moves its zero crossings by this many
#: samples at the typical acceleration.
_CROSSING_ERROR = 1.0
#: Widest smoothing of that first look, samples (standard deviation of the kernel).
_WIDEST = 40.0
#: Half-width, in standard deviations, of the noise of a standing device.
_NOISE_BAND = 3.0
#: A position that stays within its noise this many times longer than at a typical reversal stands.
_LONG_DWELL = 4
#: The velocity after a rest is counted from the rest for at least this many samples.
_SHORTEST_START = 3
#: Coulomb friction can be told from an offset if at least this part of the motion goes either way.
_LEAST_RETURN = 0.01
#: A step is motion if it exceeds this many standard deviations of the noise of one reading, ...
_CLEAR = 5.0
#: ... over as many samples, doubled up to this part of the log, as make this part of steps motion.
_LONGEST_SPAN = 0.01
_ENOUGH = 0.5


def running_maximum(column: FloatArray, width: int) -> FloatArray:
    """Largest of the ``width`` samples about each one, fewer at the ends; an odd number of them."""
    outside = np.full(width // 2, -np.inf)
    largest, span = np.concatenate((outside, column, outside)), 1
    while 2 * span <= width:
        largest = np.maximum(largest[:-span], largest[span:])
        span *= 2
    last = width - span
    return np.maximum(largest[: column.size], largest[last : last + column.size])


def running_range(column: FloatArray, width: int) -> FloatArray:
    """Largest less smallest of the ``width`` samples about each one, shape (n,)."""
    return running_maximum(column, width) + running_maximum(-column, width)


def distinguishable_terms(trajectory: Trajectory) -> Model:
    """Friction and offset, if the log can tell them apart: motion one way only cannot."""
    place = trajectory.position
    clear = _CLEAR * position_noise(place, trajectory.force)
    span, steps = 1, np.diff(place)
    while np.mean(np.abs(steps) > clear) < _ENOUGH and 2 * span <= _LONGEST_SPAN * place.size:
        span *= 2
        steps = place[span:] - place[:-span]
    forth, back = np.sum(steps > clear), np.sum(steps < -clear)
    return Model(coulomb=bool(min(forth, back) >= _LEAST_RETURN * (forth + back)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """How the device moved in each interval."""

    #: sign(q̇), by the time spent on either side where it turns; n - 1 intervals
    direction: HeldColumn
    #: 1, or 0 where the device stood still, shape (n - 1,). Standing, static friction balances the
    #: force: q̈, q̇ and the sum of all forces are zero, whatever the force is.
    moving: FloatArray

    @classmethod
    def always(cls, intervals: int, steps: float | FloatArray) -> Motion:
        """A device without friction, shape (intervals,): it never stands still."""
        ones = np.ones(intervals)
        return cls(direction=HeldColumn.constant(ones, steps), moving=ones)

    def released(self) -> Motion:
        """This motion with nothing that stops the device; itself if nothing does."""
        if np.all(self.moving == 1):
            return self
        return replace(self, moving=np.ones_like(self.moving))

    def held(self) -> Motion:
        """This motion with something that holds the device all the time."""
        nothing = np.zeros_like(self.moving)
        return Motion(direction=self.direction.times(nothing), moving=nothing)


def measured_motion(
    position: FloatArray, steps: float | FloatArray, *, noise: float, bend: float
) -> Motion:
    """Direction and standstill from the position alone, given its bend in m per sample²."""
    width = _WIDEST
    if bend > 0:
        # Variance of the derivative of a Gaussian kernel of width s: σ²/(4·√π·s³).
        ratio = noise / (_CROSSING_ERROR * bend)
        width = min((ratio**2 / (4 * np.sqrt(np.pi))) ** (1 / 3), _WIDEST)
    velocity = LowPass(kernel=gaussian(width, 1.0)).continued(np.diff(position) / steps)
    moving = 1.0 - _dwelling(position, noise, bend)
    return Motion(direction=sense_of(velocity, steps).times(moving), moving=moving)


def sense_of(velocity: FloatArray, steps: float | FloatArray) -> HeldColumn:
    """Sign of a velocity that is known as its mean over each interval, m/s, shape (n - 1,)."""
    ends = np.concatenate((velocity[:1], (velocity[1:] + velocity[:-1]) / 2, velocity[-1:]))
    even = np.ones(velocity.size)
    return HeldColumn.turning(*_turning(ends[:-1], ends[1:], even, even), steps)


def refine_motion(
    motion: Motion,
    smoothed: FloatArray,
    pull: FloatArray,
    *,
    steps: float | FloatArray,
    low_pass: LowPass,
    mass: float,
    damping: float,
    friction: float,
) -> Motion:
    """Direction and standstill with the model's help.

    The velocity is the model's, integrated from the force, plus the smoothed difference between the
    measured and the model's velocity: slow parts come from the measurement, the bend at a reversal
    from the model. Both pass through the same filter, so nothing is shifted. A device that comes to
    rest while the force cannot overcome friction stands until it can. The pull is the mean force
    over each interval less all terms but damping and Coulomb friction.
    """
    net = motion.moving * (pull - friction * motion.direction.mean() - damping * smoothed)
    mobility = steps / mass
    model = _integral(net * mobility)
    correction = smoothed - low_pass.continued((model[:-1] + model[1:]) / 2)
    velocity = model + np.concatenate(
        (correction[:1], (correction[1:] + correction[:-1]) / 2, correction[-1:])
    )
    reach = max(_SHORTEST_START, low_pass.kernel.size // (2 * int(REACH)))
    rest = _rest(velocity[:-1], pull, friction, mobility)
    start, end = _released(velocity, rest, pull, friction, mobility, reach)
    before = np.abs(pull - friction * np.sign(start))
    after = np.abs(pull - friction * np.sign(end))
    early, late, fraction = _turning(start, end, before, after)
    # Standing still, friction equals the pull; inside the interval in which it comes to rest, that
    # is the second part of the direction.
    stops = np.flatnonzero((rest > 0) & (rest < 1))
    late[stops] = pull[stops] / friction
    fraction[stops] = 1 - rest[stops]
    moving = np.where(rest == 1, 0.0, 1.0)
    turn = HeldColumn.turning(early, late, fraction, steps)
    return Motion(direction=turn.times(moving), moving=moving)


def _rest(
    velocity: FloatArray, pull: FloatArray, friction: float, mobility: float | FloatArray
) -> FloatArray:
    """Part of each interval, at its end, in which static friction holds the device; shape (n - 1,).

    Rest begins when the speed is used up, and lasts until the pull exceeds friction. Mobility is
    the length of an interval over mass, s/kg.
    """
    stuck = np.abs(pull) < friction
    first = stuck & ~np.concatenate(([False], stuck[:-1]))
    if not first.any():
        return np.zeros_like(velocity)
    begin = np.maximum.accumulate(np.where(first, np.arange(velocity.size), 0))
    sense = np.sign(velocity[begin])
    speed = np.maximum(sense * velocity, 0.0)
    # What friction takes from the speed in one interval.
    loss = (friction - sense * pull) * mobility
    used_up = stuck & (speed <= loss)
    if not used_up.any():
        return np.zeros_like(velocity)
    part = 1 - speed / np.where(used_up & (loss > 0), loss, np.inf)
    count = np.concatenate(([0], np.cumsum(used_up)))
    earlier = count[:-1] > count[begin]
    return np.where(stuck & earlier, 1.0, np.where(used_up, part, 0.0))


def _released(
    velocity: FloatArray,
    rest: FloatArray,
    pull: FloatArray,
    friction: float,
    mobility: float | FloatArray,
    reach: int,
) -> tuple[FloatArray, FloatArray]:
    """Velocity at start and end of each interval, counted from zero just after a rest.

    A device starts from rest in the sense of the pull and slowly; noise would guess the sense.
    """
    resting = rest > 0
    if not resting.any():
        return velocity[:-1], velocity[1:]
    index = np.arange(rest.size)
    last = np.maximum.accumulate(np.where(resting, index, -1))
    release = np.minimum(last + 1, rest.size - 1)
    sense = np.sign(pull[release])
    gained = _integral(pull * mobility)
    taken = _integral(np.broadcast_to(friction * mobility, pull.shape))
    begun = np.flatnonzero((last >= 0) & ~resting & (index - last <= reach))
    from_rest, sense = release[begun], sense[begun]
    speeds = (velocity[:-1].copy(), velocity[1:].copy())
    for shift, speed in enumerate(speeds):
        lost = sense * (taken[begun + shift] - taken[from_rest])
        since = gained[begun + shift] - gained[from_rest] - lost
        usable = sense * since >= 0
        speed[begun[usable]] = since[usable]
    return speeds


def _integral(change: FloatArray) -> FloatArray:
    """Running sum from 0, one longer than its argument."""
    return np.concatenate(([0.0], np.cumsum(change)))


def _turning(
    start: FloatArray, end: FloatArray, before: FloatArray, after: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """sign of a velocity that a force ``before`` takes from start to zero, and ``after`` to end.

    The velocity reaches zero after |start|/before, and end |end|/after later. As
    ``HeldColumn.turning`` takes it: early, late and the fraction of each interval before the turn.
    """
    sign = np.sign(start)
    sign[start == 0] = np.sign(end[start == 0])
    late, fraction = sign.copy(), np.ones_like(sign)
    turns = np.flatnonzero(start * end < 0)
    late[turns] = np.sign(end[turns])
    falling = np.abs(start[turns]) * after[turns]
    rising = np.abs(end[turns]) * before[turns]
    total = falling + rising
    fraction[turns] = np.where(total > 0, falling / np.where(total > 0, total, 1.0), 1.0)
    return sign, late, fraction


def _dwelling(position: FloatArray, noise: float, bend: float) -> FloatArray:
    """1 for intervals in which the position stays within its noise for long, 0 for the others."""
    band = 2 * _NOISE_BAND * noise
    if bend == 0 or band == 0:
        return np.where(np.diff(position) == 0, 1.0, 0.0)
    # A reversal at the typical acceleration leaves the band within the window of one dwell.
    window = 2 * _LONG_DWELL * int(np.ceil(np.sqrt(2 * band / bend))) + 1
    if window >= position.size:
        return np.zeros(position.size - 1)
    reach = running_range(position, window)
    still = running_maximum((reach <= band).astype(np.float64), window)
    return still[:-1] * still[1:]


def terms(
    model: Model, motion: Motion, position: FloatArray, steps: float | FloatArray
) -> tuple[tuple[HeldColumn, ...], float]:
    """Columns of ``model.parameters[2:]`` on one log, zero where it stands, and s of the model.

    Terms that depend on speed or position are taken as their mean over each interval: what they
    change inside of it moves the device by a part (ωT)²/12 of their own effect.
    """
    moving = motion.moving
    columns = [motion.direction] if model.coulomb else []
    columns += [HeldColumn.constant(moving, steps)] if model.offset else []
    mean_speed = 0.0
    if model.directional:
        speed = motion.direction.mean() * np.diff(position) / steps
        mean_speed = float(np.sum(speed) / max(np.sum(moving), 1.0))
        columns.append(HeldColumn.constant((speed - mean_speed) * moving, steps))
    if model.gravity == "proportional":
        columns.append(HeldColumn.constant(_middle(position) * moving, steps))
    if model.gravity == "pendulum":
        columns.append(HeldColumn.constant(_middle(np.sin(position)) * moving, steps))
        columns.append(HeldColumn.constant(_middle(np.cos(position)) * moving, steps))
    return tuple(columns), mean_speed


def others(
    model: Model,
    motion: Motion,
    position: FloatArray,
    steps: float | FloatArray,
    values: Mapping[str, float],
) -> FloatArray:
    """Mean over each interval of all terms but Coulomb friction, as if nothing stood, N."""
    columns, _ = terms(model, motion.released(), position, steps)
    total = np.zeros(motion.moving.size)
    for name, held in zip(model.parameters[2:], columns, strict=True):
        if name != "coulomb_friction" and values[name] != 0:
            total += values[name] * held.mean()
    return total


def _middle(column: FloatArray) -> FloatArray:
    """Mean over each interval."""
    return (column[1:] + column[:-1]) / 2


#: Intervals looked through for the next turn at first; four times as many each time there is none.
_LOOK = 128


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """A simulated motion."""

    motion: Motion  # direction and standstill
    forward: BoolArray  # whether each interval begins forward, shape (n - 1,)
    speed: FloatArray  # velocity at each sample, m/s, shape (n,)
    #: factor on what a device keeps of a small change of velocity in each interval: 1, ρ where it
    #: turns, 0 where it stands or comes to rest, shape (n - 1,)
    kept: FloatArray


class Direction(NamedTuple):
    """One direction of motion."""

    rate: float  # p = b/m in this direction, 1/s
    #: velocity if all forces but Coulomb friction acted with this p, from rest, shape (n,)
    free: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pull:
    """All forces but damping and friction, which change at most once in each interval."""

    before: FloatArray  # N, shape (n - 1,)
    after: FloatArray
    jump: FloatArray  # s from the start of each interval
    steps: FloatArray  # s
    mass: float
    friction: float

    @classmethod
    def of(cls, held: HeldColumn, mass: float, friction: float) -> _Pull:
        """Columns that change more often count with their means."""
        steps = np.broadcast_to(np.asarray(held.steps, dtype=np.float64), held.level.shape)
        jump, before = steps, held.mean()
        after = before
        if held.interval is None:
            jump, before, after = steps - held.left, held.level, held.level + held.change
        return cls(before=before, after=after, jump=jump, steps=steps, mass=mass, friction=friction)

    def stop(self, row: int, speed: float, sign: float, rate: float) -> tuple[float, float]:
        """When a device that slides one way comes to rest in an interval, s, and the pull then."""
        change, pull = float(self.jump[row]), float(self.before[row])
        slowing = (pull - sign * self.friction) / self.mass
        used = _time_to_stop(speed, slowing, rate, change)
        if used < change:
            return used, pull
        slowed = speed * math.exp(-rate * change) + slowing * _braked(change, rate)
        pull, rest = float(self.after[row]), float(self.steps[row]) - change
        slowing = (pull - sign * self.friction) / self.mass
        return used + _time_to_stop(slowed, slowing, rate, rest), pull

    def gained(self, row: int, since: float, sign: float, rate: float) -> float:
        """Speed at the end of an interval of a device that slides one way from a rest in it."""
        change, step = float(self.jump[row]), float(self.steps[row])
        speed, begun = 0.0, max(since, change)
        if since < change:
            pushed = (float(self.before[row]) - sign * self.friction) / self.mass
            speed = pushed * _braked(change - since, rate) * math.exp(-rate * (step - change))
        pushed = (float(self.after[row]) - sign * self.friction) / self.mass
        return speed + pushed * _braked(step - begun, rate)

    def rested(self, rows: slice, speed: FloatArray, sign: float, rate: float) -> int:
        """First row in which it rests before the change, though not at its end; or their stop."""
        left, lost = _decay(rate, self.jump[rows])
        there = speed[rows] * left + (self.before[rows] - sign * self.friction) / self.mass * lost
        crossed = np.flatnonzero(there * sign < 0)
        return rows.start + int(crossed[0]) if crossed.size else rows.stop


def path(
    forward: Direction,
    backward: Direction,
    held: HeldColumn,
    *,
    mass: float,
    friction: float,
    start: float,
) -> Path:
    """Simulate a log under all forces but damping and friction."""
    pull, count = _Pull.of(held, mass, friction), held.level.size
    age = np.concatenate(([0.0], np.cumsum(pull.steps)))
    speed = np.zeros(count + 1)
    speed[0] = start
    (kept, fraction), (early, late, moving) = np.ones((2, count)), np.zeros((3, count))
    loose = np.flatnonzero(np.maximum(np.abs(pull.before), np.abs(pull.after)) > friction)
    at, sign = 0, float(np.sign(start))

    def stand(row: int, since: float, acting: float) -> float:
        """Static friction balances the pull until it changes; then the way it goes, or 0."""
        change, step = float(pull.jump[row]), float(pull.steps[row])
        kept[row] = speed[row + 1] = 0.0
        late[row] = acting / friction
        if since >= change or abs(pull.after[row]) <= friction:
            return 0.0
        way = float(np.sign(pull.after[row]))
        speed[row + 1] = pull.gained(row, change, way, rates[way])
        late[row] = (late[row] * (change - since) + way * (step - change)) / (step - since)
        return way

    rates = {1.0: forward.rate, -1.0: backward.rate}
    while at < count:
        if sign == 0:  # at rest, until the pull exceeds friction
            following = int(np.searchsorted(loose, at))
            go = int(loose[following]) if following < loose.size else count
            kept[at:go] = 0.0
            if go == count:
                break
            at, sign = go, float(np.sign(pull.before[go]))
            if abs(pull.before[go]) <= friction:
                moving[go], fraction[go] = 1.0, 0.0
                at, sign = go + 1, stand(go, 0.0, float(pull.before[go]))
                continue
        way = forward if sign > 0 else backward
        seen = _next_turn(way, speed, age, at, sign * friction / mass)
        turn = pull.rested(slice(at, seen), speed, sign, rates[sign])
        early[at : turn + 1] = late[at : turn + 1] = sign
        moving[at : turn + 1] = 1.0
        if turn == count:
            break
        used, acting = pull.stop(turn, float(speed[turn]), sign, rates[sign])
        fraction[turn] = used / pull.steps[turn]
        if abs(acting) > friction:
            kept[turn] = (acting + sign * friction) / (acting - sign * friction)
            sign = late[turn] = -sign
            speed[turn + 1] = pull.gained(turn, used, sign, rates[sign])
            if speed[turn + 1] * sign <= 0:  # it turned once more
                kept[turn] = speed[turn + 1] = sign = 0.0
        else:
            sign = stand(turn, used, acting)
        at = turn + 1
    direction = HeldColumn.turning(early, late, fraction, held.steps)
    motion = Motion(direction=direction.times(moving), moving=moving)
    return Path(motion=motion, forward=early > 0, speed=speed, kept=kept)


def _time_to_stop(speed: float, acceleration: float, rate: float, longest: float) -> float:
    """When damping and a force against the motion have used up a speed, s, or ``longest``."""
    if speed == 0:
        return 0.0
    undamped = -speed / acceleration if speed * acceleration < 0 else math.inf
    if math.isinf(undamped) or rate * undamped <= -1:
        return longest
    return min(math.log1p(rate * undamped) / rate if rate != 0 else undamped, longest)


def _braked(time: float, rate: float) -> float:
    """Velocity over acceleration that a force gives from rest in a time, s."""
    return -math.expm1(-rate * time) / rate if rate != 0 else time


def _decay(rate: float, since: FloatArray) -> tuple[FloatArray, FloatArray]:
    left = np.exp(-rate * since)
    return left, since if rate == 0 else (1 - left) / rate


def _next_turn(way: Direction, speed: FloatArray, age: FloatArray, at: int, resisted: float) -> int:
    """Fill in the speed up to the end of the interval in which it changes sign, and return that."""
    count = speed.size - 1
    excess = speed[at] - way.free[at]
    begin, length = at + 1, _LOOK
    while begin <= count:
        end = min(begin + length, count + 1)
        left, lost = _decay(way.rate, age[begin:end] - age[at])
        trial = way.free[begin:end] + left * excess - resisted * lost
        turned = trial * resisted < 0
        first = int(turned.argmax())
        if turned[first]:
            speed[begin : begin + first + 1] = trial[: first + 1]
            return begin + first - 1
        speed[begin:end] = trial
        begin, length = end, 4 * length
    return count
