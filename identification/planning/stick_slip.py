"""How a guessed device answers a held force: exact motion with viscous and Coulomb friction.

m·q̈ + b·q̇ + Fc·sign(q̇) + f0 = F with F held over each sample is linear between two turns of the
velocity, so each piece is a closed form, the instant of the turn too: q̇ = 0 after
ln(1 - p·v/u)/p for a velocity v under the net pull u, p = b/m.
"""

from __future__ import annotations

from cmath import log
from dataclasses import dataclass
from math import copysign

import numpy as np
from numpy.typing import NDArray

from identification.planning.response import step_response

FloatArray = NDArray[np.float64]

#: Imaginary step of a parameter in its SI unit; nothing is subtracted, so derivatives are exact.
_COMPLEX_STEP = 1e-40
#: Below this the logarithm of the instant of a turn is summed: the next term is below rounding.
_SERIES_BELOW = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """One device: m, b, Fc, f0 in kg, N·s/m, N, N (kg·m², N·m·s/rad, N·m, N·m)."""

    mass: float
    damping: float
    coulomb_friction: float = 0.0
    force_offset: float = 0.0

    @property
    def rate(self) -> float:
        """p = b/m, 1/s."""
        return self.damping / self.mass


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Motion of a device that starts at zero and at rest.

    Attributes:
        position: m (rad), shape (n + 1,).
        velocity: m/s (rad/s), shape (n + 1,).
        direction: mean of sign(q̇) over each interval in which it moves, 0 at a standstill, (n,).
        moving: 1, or 0 for intervals in which static friction holds the device, shape (n,).
    """

    position: FloatArray
    velocity: FloatArray
    direction: FloatArray
    moving: FloatArray

    @property
    def reach(self) -> float:
        """Largest distance from the start, m (rad)."""
        return float(np.max(np.abs(self.position)))

    @property
    def speed(self) -> float:
        """Largest speed, m/s (rad/s)."""
        return float(np.max(np.abs(self.velocity)))


def simulate_stick_slip(force: FloatArray, guess: Guess, step: float) -> Answer:
    """Position and velocity at each sample of a force held in between.

    Args:
        force: N (N·m), shape (n,).
        guess: the device.
        step: s.
    """
    trace = _trace(
        force,
        (guess.mass, guess.damping, guess.coulomb_friction, guess.force_offset, 0.0),
        step,
    )
    return Answer(
        position=np.array(trace.position, dtype=np.float64),
        velocity=np.array(trace.velocity, dtype=np.float64),
        direction=np.array(trace.direction, dtype=np.float64),
        moving=np.array(trace.moving, dtype=np.float64),
    )


def sensitivities(force: FloatArray, guess: Guess, step: float) -> FloatArray:
    """Derivatives of position by m, b, Fc, f0 and the velocity at the start, shape (n + 1, 5).

    Turns and standstills move with the parameters, and rest forgets how the device got there. An
    imaginary step far below rounding takes all of that along exactly.

    Args:
        force: N (N·m), shape (n,).
        guess: the device.
        step: s.
    """
    middle = (guess.mass, guess.damping, guess.coulomb_friction, guess.force_offset, 0.0)
    columns: list[FloatArray] = []
    for index in range(len(middle)):
        moved = tuple(
            complex(value, _COMPLEX_STEP * (place == index)) for place, value in enumerate(middle)
        )
        position = np.array(_trace(force, moved, step).position, dtype=np.complex128)
        columns.append(position.imag / _COMPLEX_STEP)
    return np.stack(columns, axis=1)


@dataclass(slots=True)
class _Trace:
    """Motion so far, numbers real or complex as the device is given."""

    position: list[complex]
    velocity: list[complex]
    direction: list[float]
    moving: list[float]


def _trace(force: FloatArray, device: tuple[complex, ...], step: float) -> _Trace:
    """The motion of (m, b, Fc, f0, velocity at the start); decisions go by real parts."""
    mass, damping, friction, offset, speed = device
    rate, grip = damping / mass, friction / mass
    coast, fall = step_response(rate, step)
    decay = 1 - rate * coast
    place = 0.0 * speed
    trace = _Trace([place], [speed], [], [])
    for each in force.tolist():
        drive = (each - offset) / mass
        sense = copysign(1.0, speed.real or drive.real)
        net = drive - grip * sense
        later = decay * speed + coast * net
        turned = moved = 1.0
        if speed.real == 0 and abs(drive.real) <= grip.real:
            speed, turned, moved = 0.0 * speed, 0.0, 0.0
        elif later.real * sense >= 0:
            place += coast * speed + fall * net
            speed, turned = later, sense
        else:
            before = _instant(rate, speed, net)
            near, far = step_response(rate, before)
            place += near * speed + far * net
            after, onto = step - before, copysign(1.0, drive.real)
            held = abs(drive.real) <= grip.real
            onward = 0.0 * drive if held else drive - grip * onto
            near, far = step_response(rate, after)
            place, speed = place + far * onward, near * onward
            beyond = drive.real / grip.real if held else onto
            turned = (sense * before.real + beyond * after.real) / step
        trace.position.append(place)
        trace.velocity.append(speed)
        trace.direction.append(turned)
        trace.moving.append(moved)
    return trace


def _instant(rate: complex, speed: complex, net: complex) -> complex:
    """Time until a net pull against the velocity has used it up, s: ln(1 - p·v/u)/p."""
    ratio = -speed / net
    part = rate * ratio
    if abs(part) < _SERIES_BELOW:
        return ratio * (1 - part / 2 + part**2 / 3 - part**3 / 4)
    logarithm = log(1 + part)
    return (logarithm if isinstance(part, complex) else logarithm.real) / rate
