"""Continuous motion of a mass with viscous and Coulomb friction under a held force.

The law is m·dv/dt = u - b·v - Fc·sign(v), dx/dt = v, with u constant over one step; a mass at rest
stays there while |u| <= Fc. It is integrated by the classical fourth-order Runge-Kutta method,
never by a closed form, so that the simulator shares no algebra with what it is used to test.

Local error: with h the step and p = b/m, one step misses the velocity it gains by a relative
|h·p|⁴/120, and behaves like a device whose b is wrong by that fraction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        rate: p = b/m, 1/s.
        grip: Fc/m, m/s² (rad/s²).
        gripping: where grip is positive, or None when nowhere.
    """

    rate: FloatArray
    grip: FloatArray
    gripping: NDArray[np.bool_] | None

    @classmethod
    def of(cls, *, mass: FloatArray, damping: FloatArray, coulomb_friction: FloatArray) -> Drag:
        """The drag of a batch of devices: kg, N·s/m, N, each shape (batch,)."""
        gripping = coulomb_friction > 0
        return cls(
            rate=damping / mass,
            grip=coulomb_friction / mass,
            gripping=gripping if gripping.any() else None,
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
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and velocity (m/s) one step later; every array shape (batch,).

    Args:
        position: at the start of the step, m.
        velocity: at the start of the step, m/s; exactly zero means at rest.
        pull: force without friction, held over the step, per unit mass, u/m, m/s².
        drag: resistance of each member.
        step: length of the step of each member, s; zero leaves that member as it is.
    """
    if drag.gripping is None:
        travel, gain = _runge_kutta(velocity, pull, drag.rate, step)
        return position + travel, velocity + gain
    drive, direction = _slipping(velocity, pull, drag.grip)
    travel, gain = _runge_kutta(velocity, drive, drag.rate, step)
    later_position, later_velocity = position + travel, velocity + gain
    turning = np.flatnonzero((later_velocity * direction < 0) & drag.gripping)
    if turning.size:
        later_position[turning], later_velocity[turning] = _turn(
            position[turning],
            velocity[turning],
            (drive[turning], pull[turning]),
            (drag.rate[turning], drag.grip[turning]),
            step[turning],
        )
    return later_position, later_velocity


def _slipping(
    velocity: FloatArray, pull: FloatArray, grip: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pull less Coulomb friction per unit mass, zero where the member sticks; and its direction."""
    at_rest = velocity == 0
    direction = np.sign(np.where(at_rest, pull, velocity))
    stuck = at_rest & (np.abs(pull) <= grip)
    return np.where(stuck, 0.0, pull - grip * direction), direction


def _runge_kutta(
    velocity: FloatArray, drive: FloatArray, rate: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Travel and gain of velocity over one step of dv/dt = drive - rate·v, dx/dt = v."""
    half = 0.5 * step
    first = drive - rate * velocity
    second = drive - rate * (velocity + half * first)
    third = drive - rate * (velocity + half * second)
    fourth = drive - rate * (velocity + step * third)
    middle = second + third
    sixth = step / 6
    return step * (velocity + sixth * (first + middle)), sixth * (first + 2 * middle + fourth)


def _turn(
    position: FloatArray,
    velocity: FloatArray,
    drives: tuple[FloatArray, FloatArray],
    drags: tuple[FloatArray, FloatArray],
    step: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """One step of members that come to rest inside it: up to rest, then stuck or reversed.

    ``drives`` is (drive before rest, pull), ``drags`` is (rate, grip), as in ``advance``.
    """
    drive, pull = drives
    rate, grip = drags
    instant = np.clip(-velocity / (drive - rate * velocity), 0.0, step)
    for _ in range(_NEWTON_STEPS):
        _, gain = _runge_kutta(velocity, drive, rate, instant)
        speed = velocity + gain
        instant = np.clip(instant - speed / (drive - rate * speed), 0.0, step)
    travel, _ = _runge_kutta(velocity, drive, rate, instant)
    at_rest = np.zeros_like(velocity)
    drive, _ = _slipping(at_rest, pull, grip)
    onward, gain = _runge_kutta(at_rest, drive, rate, step - instant)
    return position + travel + onward, gain
