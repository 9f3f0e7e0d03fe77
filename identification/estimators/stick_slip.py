"""The path of a device with Coulomb friction, turn by turn, and how small changes live through it.

Between two turns the motion is that of a mass with damping under a held force, known in closed form
from one response of the whole log; so only turns cost a step of a loop. At a turn friction changes
sides: a change of velocity before it goes on as the part ρ = a⁺/a⁻ of itself, the ratio of the
accelerations after and before, and ends where the device comes to rest (the saltation of Leine and
Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, section 7.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.held_response import HeldResponse
from identification.estimators.motion import Motion
from identification.estimators.zero_order_hold import HeldColumn

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Intervals looked through for the next turn at first; four times as many each time there is none.
_LOOK = 128
#: Samples tabulated: the first two looks.
_TABLE = 5 * _LOOK


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """A simulated motion.

    Attributes:
        motion: direction and standstill.
        forward: whether each interval begins forward, shape (n - 1,).
        speed: velocity at each sample, m/s, shape (n,).
        kept: factor on what a device keeps of a small change of velocity in each interval: 1,
            ρ where it turns, 0 where it stands or comes to rest, shape (n - 1,).
    """

    motion: Motion
    forward: BoolArray
    speed: FloatArray
    kept: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Direction:
    """One direction of motion.

    Attributes:
        device: p = b/m in this direction on the grid of the log.
        free: velocity if all forces but Coulomb friction acted with this p, from rest, shape (n,).
        left: part left of a velocity after 1, 2, … even steps, shape (_TABLE,), else empty.
        lost: velocity that a unit deceleration takes in that time, s, shape (_TABLE,).
    """

    device: HeldResponse
    free: FloatArray
    left: FloatArray
    lost: FloatArray

    @classmethod
    def of(cls, device: HeldResponse, free: FloatArray) -> Direction:
        """With tables for even steps, which spare an exponential for each turn.

        The free velocity has shape (n,).
        """
        if isinstance(device.steps, np.ndarray):
            return cls(device=device, free=free, left=np.empty(0), lost=np.empty(0))
        left, lost = _decay(device.rate, device.steps * np.arange(1.0, _TABLE + 1))
        return cls(device=device, free=free, left=left, lost=lost)

    def after(
        self, age: FloatArray, at: int, begin: int, end: int
    ) -> tuple[FloatArray, FloatArray]:
        """``left`` and ``lost`` from sample ``at`` to each of ``begin`` to ``end``.

        The age of each sample, in s, has shape (n,), both answers have shape (end - begin,).
        """
        if end - at <= self.left.size:
            since = slice(begin - at - 1, end - at - 1)
            return self.left[since], self.lost[since]
        return _decay(self.device.rate, age[begin:end] - age[at])


def path(
    forward: Direction,
    backward: Direction,
    pull: FloatArray,
    *,
    mass: float,
    friction: float,
    start: float,
) -> Path:
    """Simulate a log.

    The pull has shape (n - 1,), one value an interval.

    Args:
        forward: q̇ > 0.
        backward: q̇ < 0; the same where friction does not differ by direction.
        pull: mean over each interval of all forces but damping and Coulomb friction, N.
        mass: kg, positive.
        friction: N, positive.
        start: velocity at the first sample, m/s.
    """
    count = pull.size
    steps = np.broadcast_to(np.asarray(forward.device.steps), pull.shape)
    age = np.concatenate(([0.0], np.cumsum(steps)))
    speed = np.zeros(count + 1)
    speed[0] = start
    kept, fraction = np.ones(count), np.ones(count)
    early, late, moving = np.zeros((3, count))
    loose = np.flatnonzero(np.abs(pull) > friction)
    at, sign = 0, float(np.sign(start))
    while at < count:
        if sign == 0:  # at rest, until the pull exceeds friction
            following = int(np.searchsorted(loose, at))
            go = int(loose[following]) if following < loose.size else count
            kept[at:go] = 0.0
            if go == count:
                break
            at, sign = go, float(np.sign(pull[go]))
        way = forward if sign > 0 else backward
        turn = _next_turn(way, speed, age, at, sign * friction / mass)
        early[at : turn + 1] = late[at : turn + 1] = sign
        moving[at : turn + 1] = 1.0
        if turn == count:
            break
        step, stopping = float(steps[turn]), float(pull[turn]) - sign * friction
        used = _time_to_stop(float(speed[turn]), stopping / mass, way.device.rate, step)
        fraction[turn] = used / step
        if abs(pull[turn]) > friction:
            starting = float(pull[turn]) + sign * friction
            kept[turn] = starting / stopping
            way = backward if sign > 0 else forward
            speed[turn + 1] = starting / mass * _braked(step - used, way.device.rate)
            sign = late[turn] = -sign
        else:  # static friction then balances the pull
            kept[turn] = speed[turn + 1] = 0.0
            late[turn] = pull[turn] / friction
            sign = 0.0
        at = turn + 1
    direction = HeldColumn.turning(early, late, fraction, forward.device.steps)
    motion = Motion(direction=direction.times(moving), moving=moving)
    return Path(motion=motion, forward=early > 0, speed=speed, kept=kept)


def _time_to_stop(speed: float, acceleration: float, rate: float, longest: float) -> float:
    """When damping and a force against the motion have used up a speed, s.

    A force that changes inside the interval may not brake in the mean of it; then it is the end.
    """
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
    """Fill in the speed from one sample on up to the end of the interval in which it changes sign.

    Returns:
        That interval, or the number of intervals if there is none.
    """
    count = speed.size - 1
    excess = speed[at] - way.free[at]
    begin, length = at + 1, _LOOK
    while begin <= count:
        end = min(begin + length, count + 1)
        left, lost = way.after(age, at, begin, end)
        trial = way.free[begin:end] + left * excess - resisted * lost
        turned = trial * resisted < 0
        first = int(turned.argmax())
        if turned[first]:
            speed[begin : begin + first + 1] = trial[: first + 1]
            return begin + first - 1
        speed[begin:end] = trial
        begin, length = end, 4 * length
    return count
