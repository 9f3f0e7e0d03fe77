"""Continuous motion of a mass with friction, in a field or free, under a held force.

The law is m·dv/dt = u - b·v - Fc·sign(v) - field(x), dx/dt = v, with u constant over one step and b
and Fc each with a value for v > 0 and one for v < 0; a mass at rest stays there while the pull
u - field(x) does not exceed the friction of its own sense. It is integrated by the classical
fourth-order Runge-Kutta method, never by a closed form, so that the simulator shares no algebra
with what it is used to test.

Local error: with h the step and p the larger of b/m and the natural frequency of the field, one
step misses the velocity it gains by a relative |h·p|⁴/120, and behaves like a device whose b (or
whose frequency) is wrong by that fraction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.field import Field
from datasets_synthetic.stride import Stride

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
        """The largest rate in the law, what a step of integration has to resolve, 1/s."""
        rate = np.maximum(np.abs(self.rate), np.abs(self.rate_back))
        return rate if self.field is None else np.maximum(rate, self.field.fastest())

    def stride(self, steps: int, step: FloatArray) -> Stride | None:
        """Some steps (s) as one linear map; with friction of each step alone.

        None where the law between reversals is not linear, or not one and the same both ways.
        """
        if self.rate_back is not self.rate or (self.field is not None and self.field.curved):
            return None

        def once(
            position: FloatArray, velocity: FloatArray, drive: FloatArray
        ) -> tuple[FloatArray, FloatArray]:
            return _runge_kutta(position, velocity, drive, self.rate, self.field, step)

        together = steps if self.turning is None else 1
        return Stride.of(once, together, self.rate.size, in_field=self.field is not None)

    def members(self, which: NDArray[np.intp]) -> Drag:
        """The drag of these members."""
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
    """Number of equal steps that keeps |h·p| <= largest for every member over ``duration`` (s)."""
    return max(1, int(np.ceil(np.max(np.abs(duration * rate)) / largest - 1e-9)))


def advance(
    position: FloatArray,
    velocity: FloatArray,
    pull: FloatArray,
    drag: Drag,
    step: FloatArray,
    stride: Stride | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and velocity (m/s) one step later; every array shape (batch,).

    Args:
        position: at the start of the step, m.
        velocity: at the start of the step, m/s; exactly zero means at rest.
        pull: force without friction and field, held over the step, per unit mass, u/m, m/s².
        drag: resistance of each member.
        step: length of the step of each member, s; zero leaves that member as it is.
        stride: the step as a linear map, where it is one.
    """
    if drag.turning is None:
        if stride is not None:
            travel, gain = stride.changes(position, velocity, pull)
        else:
            travel, gain = _runge_kutta(position, velocity, pull, drag.rate, drag.field, step)
        return position + travel, velocity + gain
    drive, rate, direction, stuck = _slipping(position, velocity, pull, drag)
    # What sticks stays, or it would be turned back at once, at more cost.
    if stride is not None:
        travel, gain = stride.changes(position, velocity, drive)
        travel[stuck] = gain[stuck] = 0.0
    else:
        free = np.where(stuck, 0.0, step)
        travel, gain = _runge_kutta(position, velocity, drive, rate, drag.field, free)
    later_position, later_velocity = position + travel, velocity + gain
    turning = ((later_velocity * direction < 0) & drag.turning).nonzero()[0]
    if turning.size:
        later_position[turning], later_velocity[turning] = _turn(
            (position[turning], velocity[turning], later_velocity[turning]),
            (drive[turning], rate[turning], pull[turning]),
            drag.members(turning),
            step[turning],
        )
    return later_position, later_velocity


def _slipping(
    position: FloatArray, velocity: FloatArray, pull: FloatArray, drag: Drag
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Drive (pull less Coulomb friction), rate, direction of motion, and which members stick."""
    net = pull if drag.field is None else pull - drag.field.at(position)
    at_rest = velocity == 0
    direction = np.sign(np.where(at_rest, net, velocity))
    rate, grip = drag.rate, drag.grip
    if drag.rate_back is not drag.rate:
        rate = np.where(direction > 0, rate, drag.rate_back)
    if drag.grip_back is not drag.grip:
        grip = np.where(direction > 0, grip, drag.grip_back)
    stuck = at_rest & (np.abs(net) <= grip)
    return pull - grip * direction, rate, direction, stuck


def _runge_kutta(
    position: FloatArray,
    velocity: FloatArray,
    drive: FloatArray,
    rate: FloatArray,
    field: Field | None,
    step: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Travel and gain of velocity over one step of dv/dt = drive - rate·v - field(x), dx/dt = v."""
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
    return step * (velocity + sixth * (first + middle)), sixth * (first + 2 * middle + fourth)


def _turn(
    states: tuple[FloatArray, FloatArray, FloatArray],
    pulls: tuple[FloatArray, FloatArray, FloatArray],
    drag: Drag,
    step: FloatArray,
) -> tuple[FloatArray, FloatArray]:
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
    place, at_rest = position + travel, np.zeros_like(velocity)
    drive, rate, _, stuck = _slipping(place, at_rest, pull, drag)
    rest = np.where(stuck, 0.0, step - instant)
    onward, gain = _runge_kutta(place, at_rest, drive, rate, drag.field, rest)
    return place + onward, gain
