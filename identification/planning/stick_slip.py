"""How a guessed device answers a held force: linear filters, and exact motion with friction.

Without friction, position answers a force per mass u, held for one step h, by
q[k+1] = q[k] + h·φ1·v[k] + h²·φ2·u[k], v[k+1] = (1 - p·h·φ1)·v[k] + h·φ1·u[k] with
φ1 = (1 - e^(-ph))/(ph), φ2 = (1 - φ1)/(ph), p = b/m: a filter of second order. An imaginary step of
p far below rounding gives its derivative exactly (Squire and Trapp, SIAM Review 40, 1998, p. 110).

With Coulomb friction, m·q̈ + b·q̇ + Fc·sign(q̇) + f0 = F is linear between two turns of the
velocity, so each piece is a closed form, the instant of the turn too: q̇ = 0 after
ln(1 - p·v/u)/p for a velocity v under the net pull u.
"""

from __future__ import annotations

from cmath import log
from dataclasses import dataclass
from functools import cached_property
from math import copysign
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Imaginary step of p, as part of 1/h; nothing is subtracted, so the derivative is exact.
_RATE_STEP = 1e-30
#: Below this |p·h| the φ-functions are summed as series, where expm1 would cancel.
_PHI_SERIES_BELOW = 0.5
_TERMS = 17  # terms of the series: 0.5^17/17! is below the last bit
#: The gain of the noise filter has settled when one step changes it by less than this part.
_SETTLED = 1e-10


def _phi(delta: complex) -> tuple[complex, complex]:
    """φ1 and φ2 at δ = p·h, finite at δ = 0."""
    if abs(delta) < _PHI_SERIES_BELOW:
        second: complex = 0.0
        for k in range(_TERMS, 1, -1):
            second = (1 - delta * second) / k
        return 1 - delta * second, second
    first = complex(-np.expm1(-delta) / delta)
    return first, (1 - first) / delta


def step_response(rate: complex, span: complex) -> tuple[complex, complex]:
    """Velocity and position after a unit force per mass for ``span`` s, from rest; real for reals.

    The first is also the distance coasted in that time per unit of velocity.
    """
    delta = rate * span
    first, second = _phi(delta)
    if not isinstance(delta, complex):
        first, second = first.real, second.real
    return span * first, span * span * second


@dataclass(frozen=True, kw_only=True)
class Response:
    """Filters of one device on one grid of n samples after the first."""

    rate: float  # p = b/m, 1/s
    step: float  # h, s
    count: int  # n
    noise: float  # standard deviation of one position reading, m
    acceleration_noise: float = 0.0  # rms of an unknown force per mass, white, held one step, m/s²

    @cached_property
    def _position(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        delta = complex(self.rate * self.step, _RATE_STEP)
        first, second = _phi(delta)
        decay = 1 - delta * first
        top = np.array([second, first * first - decay * second], dtype=np.complex128)
        return top * self.step**2, np.array([1, -1 - decay, decay], dtype=np.complex128)

    @cached_property
    def _velocity(self) -> tuple[FloatArray, FloatArray]:
        coast = step_response(self.rate, self.step)[0].real
        return np.array([coast]), np.array([1.0, self.rate * coast - 1.0])

    @cached_property
    def _whitening(self) -> tuple[FloatArray, FloatArray]:
        """Filter from position noise, the unknown force's part included, to unit white noise.

        The steady Kalman filter in units of one reading: its innovations are white.
        """
        first, second = (part.real for part in _phi(self.rate * self.step))
        decay = 1 - self.rate * self.step * first
        size = self.acceleration_noise * self.step**2 / self.noise
        if size == 0:
            return np.array([1 / self.noise]), np.array([1.0])
        a, b, c = (size * second) ** 2, size**2 * first * second, (size * first) ** 2
        place = cross = speed = 0.0  # covariance of the predicted position and velocity
        for _ in range(self.count):
            gain, turn = place / (place + 1), cross / (place + 1)
            held, mixed = gain, cross * (1 - gain)
            rest = speed - turn * cross
            following = held + 2 * first * mixed + first**2 * rest + a
            cross = decay * (mixed + first * rest) + b
            speed = decay**2 * rest + c
            settled = abs(following - place) <= _SETTLED * following
            place = following
            if settled:
                break
        gain, turn = place / (place + 1), cross / (place + 1)
        # det(z - A·(1 - K·C)), A = [[1, φ1], [0, e]], gain K = (gain, turn) of the update.
        top = np.array([1.0, -1.0 - decay, decay])
        matrix = np.array(
            [[1 - gain - first * turn, first], [-decay * turn, decay]], dtype=np.float64
        )
        bottom = np.array([1.0, -float(np.trace(matrix)), float(np.linalg.det(matrix))])
        return top / (self.noise * np.sqrt(place + 1)), bottom

    def driven(self, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position at samples 1 to n, in standard deviations, and its derivative by p."""
        position = np.asarray(_filtered(*self._position, pull), dtype=np.complex128)
        return self.whitened(position.real), self.whitened(position.imag) * (self.step / _RATE_STEP)

    def returned(self, weight: FloatArray, slope_weight: FloatArray) -> FloatArray:
        """What ``driven`` transposed makes of weights of position and derivative, shape (n,)."""
        # A causal filter is transposed by running it backwards.
        place, _ = self.driven(weight[::-1])
        _, slope = self.driven(slope_weight[::-1])
        return (place + slope)[::-1]

    def speed(self, pull: FloatArray) -> FloatArray:
        """Velocity at samples 1 to n, m/s; shape of ``pull``, time along the first axis."""
        return _filtered(*self._velocity, pull)

    def speed_returned(self, weight: FloatArray) -> FloatArray:
        """What ``speed`` transposed makes of a weight, shape (n,)."""
        return self.speed(weight[::-1])[::-1]

    def place(self, pull: FloatArray) -> FloatArray:
        """Position at samples 1 to n, m; shape of ``pull``, time along the first axis."""
        top, bottom = self._position
        return _filtered(top.real, bottom.real, pull)

    def whitened(self, position: FloatArray) -> FloatArray:
        """A position in m as unit white noise would have to be added to it; shape (n,)."""
        top, bottom = self._whitening
        return position * top[0] if bottom.size == 1 else _filtered(top, bottom, position)

    def unknowns(self) -> FloatArray:
        """Columns of initial position, initial velocity and constant force, orthonormal, (n, 3)."""
        ones = np.ones(self.count)
        thrown = np.zeros(self.count)
        thrown[0] = 1 / self.step
        columns = [self.whitened(ones), self.driven(thrown)[0], self.driven(ones)[0]]
        table = np.stack([column / np.linalg.norm(column) for column in columns], axis=1)
        return np.linalg.qr(table)[0]


def _filtered(top: NDArray[Any], bottom: NDArray[Any], column: FloatArray) -> NDArray[Any]:
    from scipy.signal import lfilter

    return np.asarray(lfilter(top, bottom, column, axis=0))


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
    """Motion of a device that starts at zero and at rest."""

    position: FloatArray  # m (rad), shape (n + 1,)
    velocity: FloatArray  # m/s (rad/s), shape (n + 1,)

    @property
    def reach(self) -> float:
        """Largest distance from the start, m (rad)."""
        return float(np.max(np.abs(self.position)))

    @property
    def speed(self) -> float:
        """Largest speed, m/s (rad/s)."""
        return float(np.max(np.abs(self.velocity)))


def simulate_stick_slip(force: FloatArray, guess: Guess, step: float) -> Answer:
    """Position and velocity at each sample of a force held in between."""
    position, velocity = (
        np.array(each, dtype=np.float64) for each in _trace(force, _numbers(guess), step)
    )
    return Answer(position=position, velocity=velocity)


def sensitivities(force: FloatArray, guess: Guess, step: float) -> FloatArray:
    """Derivatives of position by m, b, Fc, f0 and the velocity at the start, shape (n + 1, 5).

    Turns and standstills move with the parameters, and rest forgets how the device got there. An
    imaginary step far below rounding takes all of that along exactly.
    """
    middle = _numbers(guess)
    columns: list[FloatArray] = []
    for index in range(len(middle)):
        moved = tuple(
            complex(value, _COMPLEX_STEP * (place == index)) for place, value in enumerate(middle)
        )
        position = np.array(_trace(force, moved, step)[0], dtype=np.complex128)
        columns.append(position.imag / _COMPLEX_STEP)
    return np.stack(columns, axis=1)


def _numbers(guess: Guess) -> tuple[float, ...]:
    return guess.mass, guess.damping, guess.coulomb_friction, guess.force_offset, 0.0


def _trace(
    force: FloatArray, device: tuple[complex, ...], step: float
) -> tuple[list[complex], list[complex]]:
    """Position and velocity of (m, b, Fc, f0, velocity at the start).

    Numbers are real or complex as the device is given; decisions go by real parts.
    """
    mass, damping, friction, offset, speed = device
    rate, grip = damping / mass, friction / mass
    coast, fall = step_response(rate, step)
    decay = 1 - rate * coast
    place = 0.0 * speed
    places, speeds = [place], [speed]
    for each in force.tolist():
        drive = (each - offset) / mass
        sense = copysign(1.0, speed.real or drive.real)
        net = drive - grip * sense
        later = decay * speed + coast * net
        if speed.real == 0 and abs(drive.real) <= grip.real:
            speed = 0.0 * speed
        elif later.real * sense >= 0:
            place += coast * speed + fall * net
            speed = later
        else:
            before = _instant(rate, speed, net)
            near, far = step_response(rate, before)
            place += near * speed + far * net
            held = abs(drive.real) <= grip.real
            onward = 0.0 * drive if held else drive - grip * copysign(1.0, drive.real)
            near, far = step_response(rate, step - before)
            place, speed = place + far * onward, near * onward
        places.append(place)
        speeds.append(speed)
    return places, speeds


def _instant(rate: complex, speed: complex, net: complex) -> complex:
    """Time until a net pull against the velocity has used it up, s: ln(1 - p·v/u)/p."""
    ratio = -speed / net
    part = rate * ratio
    if abs(part) < _SERIES_BELOW:
        return ratio * (1 - part / 2 + part**2 / 3 - part**3 / 4)
    logarithm = log(1 + part)
    return (logarithm if isinstance(part, complex) else logarithm.real) / rate
