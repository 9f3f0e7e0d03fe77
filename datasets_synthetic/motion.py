"""Continuous motion of a mass with friction under a held force, in a field or free.

The law is m·dv/dt = u - b·v - Fc·sign(v) - field(x), dx/dt = v, with u constant over one step and b
and Fc each with a value for v > 0 and one for v < 0; a mass at rest stays there while the pull
u - field(x) does not exceed the friction of its own sense. It is integrated by the classical
fourth-order Runge-Kutta method, never by a closed form, so that the simulator shares no algebra
with what it is used to test.

Local error: with h the step and p the larger of b/m and the natural frequency of the field, one
step misses the velocity it gains by a relative |h·p|⁴/120, and behaves like a device whose b (or
whose frequency) is wrong by that fraction. One file: one step of the integration, with its stops
and reversals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.field import Field

FloatArray = NDArray[np.float64]

#: Largest |h·p| of one step: relative error of the effective damping 0.02⁴/120 = 1.3e-9, a
#: thousand times below what a log of any length can tell.
LARGEST_STEP = 0.02

#: Newton steps to the instant of rest. The velocity is all but linear in time over one step
#: (curvature at most h·p), so the error after each is squared: 1e-2, 1e-4, 1e-8, 1e-16.
_NEWTON_STEPS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Drag:
    """Resistance per unit mass; each array shape (batch,).

    Attributes:
        rate: p = b/m of motion along +position, 1/s.
        grip: Fc/m of motion along +position, m/s² (rad/s²).
        rate_back: the same for motion along -position; the very same array where nothing differs.
        grip_back: likewise.
        turning: where the law changes with the direction, or None when nowhere.
        field: forces of position, or None when there are none.
    """

    rate: FloatArray
    grip: FloatArray
    rate_back: FloatArray
    grip_back: FloatArray
    turning: NDArray[np.bool_] | None
    field: Field | None = None

    @classmethod
    def of(
        cls,
        *,
        mass: FloatArray,
        damping: FloatArray,
        coulomb_friction: FloatArray,
        damping_asymmetry: FloatArray | None = None,
        coulomb_asymmetry: FloatArray | None = None,
        field: Field | None = None,
    ) -> Drag:
        """The drag of a batch of devices: kg, N·s/m, N, each shape (batch,).

        An asymmetry is added for motion along +position and taken off for motion along -position.
        """
        rate, grip = damping / mass, coulomb_friction / mass
        rate_back, grip_back = rate, grip
        turning = coulomb_friction > 0
        if damping_asymmetry is not None and np.any(damping_asymmetry):
            rate_back = (damping - damping_asymmetry) / mass
            rate = (damping + damping_asymmetry) / mass
            turning = turning | (damping_asymmetry != 0)
        if coulomb_asymmetry is not None and np.any(coulomb_asymmetry):
            grip_back = (coulomb_friction - coulomb_asymmetry) / mass
            grip = (coulomb_friction + coulomb_asymmetry) / mass
        return cls(
            rate=rate,
            grip=grip,
            rate_back=rate_back,
            grip_back=grip_back,
            turning=turning if turning.any() else None,
            field=field,
        )

    def fastest(self) -> FloatArray:
        """The largest rate in the law, what a step of integration has to resolve, 1/s, (batch,)."""
        rate = np.maximum(np.abs(self.rate), np.abs(self.rate_back))
        return rate if self.field is None else np.maximum(rate, self.field.fastest())

    def members(self, which: NDArray[np.intp]) -> Drag:
        """The drag of these members, shape (members,)."""
        rate, grip = self.rate[which], self.grip[which]
        return Drag(
            rate=rate,
            grip=grip,
            rate_back=rate if self.rate_back is self.rate else self.rate_back[which],
            grip_back=grip if self.grip_back is self.grip else self.grip_back[which],
            turning=None if self.turning is None else self.turning[which],
            field=None if self.field is None else self.field.members(which),
        )


def steps_needed(duration: FloatArray, rate: FloatArray, largest: float = LARGEST_STEP) -> int:
    """Number of equal steps that keeps |h·p| <= largest for every member over ``duration`` (s).

    Duration (s) and rate (1/s) have shape (batch,).
    """
    return max(1, int(np.ceil(np.max(np.abs(duration * rate)) / largest - 1e-9)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Stride:
    """Some equal steps of a linear law as the linear map they are, less one.

    The map is what the steps make of unit vectors; it serves at every sample.

    Attributes:
        moving: change of (position, velocity) for each unit of velocity, shape (2, batch).
        driven: for each unit of drive, which is held, of the same shape.
        pulled: for each unit of position, of the same shape; None where no force depends on it.
    """

    moving: FloatArray
    driven: FloatArray
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
    """Position (m) and velocity (m/s) one step later, shape (2, batch).

    Args:
        state: (position, velocity) at the start of the step, shape (2, batch); a velocity of
            exactly zero means at rest.
        pull: force without friction and field, held over the step, per unit mass, u/m, m/s²,
            shape (batch,).
        drag: resistance of each member.
        step: length of the step of each member, s; zero leaves that member as it is.
        stride: the step as a linear map, where it is one.
    """
    if drag.turning is None:
        if stride is not None:
            return state + stride.change(state, pull)
        return state + _runge_kutta(state[0], state[1], pull, drag.rate, drag.field, step)
    drive, rate, direction, slips = _slipping(state, pull, drag)
    # What sticks stays, or it would be turned back at once, at more cost.
    if stride is not None:
        later = state + stride.change(state, drive) * slips
    else:
        moving = step * slips
        later = state + _runge_kutta(state[0], state[1], drive, rate, drag.field, moving)
    turning = np.nonzero((later[1] * direction < 0) & drag.turning)[0]
    if turning.size:
        later[:, turning] = _turn(
            (state[0, turning], state[1, turning], later[1, turning]),
            (drive[turning], rate[turning], pull[turning]),
            drag.members(turning),
            step[turning],
        )
    return later


def _slipping(
    state: FloatArray, pull: FloatArray, drag: Drag
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Drive (pull less Coulomb friction), rate, direction of motion, and which members slip."""
    position, velocity = state[0], state[1]
    net = pull if drag.field is None else pull - drag.field.at(position)
    moves = velocity != 0
    direction = np.sign(np.where(moves, velocity, net))
    rate, grip = drag.rate, drag.grip
    if drag.rate_back is not drag.rate:
        rate = np.where(direction > 0, rate, drag.rate_back)
    if drag.grip_back is not drag.grip:
        grip = np.where(direction > 0, grip, drag.grip_back)
    slips = moves | (np.abs(net) > grip)
    return pull - grip * direction, rate, direction, slips


def _runge_kutta(
    position: FloatArray,
    velocity: FloatArray,
    drive: FloatArray,
    rate: FloatArray,
    field: Field | None,
    step: FloatArray,
) -> FloatArray:
    """Travel and gain of velocity over one step of dv/dt = drive - rate·v - field(x), dx/dt = v.

    Shape (2, ..., batch).
    """
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
    drive, rate, _, slips = _slipping(stopped, pull, drag)
    rest = (step - instant) * slips
    return stopped + _runge_kutta(stopped[0], stopped[1], drive, rate, drag.field, rest)
