"""What a hand feels of an element, by an own impedance, and what of it is beyond what is asked for.

docs/tuning.md, "Filters".
"""

from dataclasses import dataclass
from math import comb, factorial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification import Device

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: Hz, 400 of them: half where people move, half beyond.
HERTZ: Array = np.concatenate([np.geomspace(0.5, 5, 200), np.geomspace(5, 20, 201)[1:]])
MOTION = HERTZ <= 5
#: Part of a limit that is left for the frequencies between these.
SPARE = 1e-3


class Felt(NamedTuple):
    """Mass and damping felt at every frequency of `HERTZ`."""

    mass: Array
    damping: Array


@dataclass
class Observer:
    """So many states, the error's poles at f Hz, two of them of a damping ratio.

    States of a position and its derivatives under a constant highest one, gains by Ackermann's
    formula.
    """

    states: int
    hertz: float
    ratio: float = 1.0
    sample_time: float = 1e-3

    def __post_init__(self) -> None:
        n, turn = self.states, 2 * np.pi * self.hertz * self.sample_time
        pair = np.exp(-turn * (self.ratio + 1j * np.sqrt(1 - self.ratio**2)))
        poles = [pair, np.conj(pair), *[np.exp(-turn)] * (n - 2)]
        self.step = np.array([[comb(j, i) for j in range(n)] for i in range(n)], float)
        wanted = np.eye(n, dtype=complex)
        for pole in poles:
            wanted = wanted @ (self.step - pole * np.eye(n))
        seen = np.array([np.linalg.matrix_power(self.step, k + 1)[0] for k in range(n)])
        self.gain = np.asarray((wanted @ np.linalg.inv(seen)[:, -1]).real, float)

    def play(self, readings: Array, power: int) -> Array:
        """The estimate after every reading, from rest at the first."""
        state, found = np.zeros(self.states), np.zeros(readings.size)
        state[0] = readings[0]
        for place, reading in enumerate(readings):
            state = self.step @ state
            state = state + self.gain * (reading - state[0])
            found[place] = state[power]
        return found * factorial(power) / self.sample_time**power

    def response(self, z: Complex, power: int) -> Complex:
        """The estimate of motion in a sine over the motion, at points of the unit circle."""
        one = np.eye(self.states)
        kept = (one - np.outer(self.gain, one[0])) @ self.step
        states = np.asarray(
            np.linalg.solve(one - kept / z[:, None, None], self.gain[:, None]), dtype=np.complex128
        )
        return np.asarray(states[:, power, 0] * (factorial(power) / self.sample_time**power))


def low_pass(z: Complex, step: float, hertz: float | None, poles: int, ratio: float) -> Complex:
    """One pole, or a pair of a damping ratio."""
    passed = np.ones_like(z)
    if hertz is not None:
        turned = 1j * np.sqrt(1 - ratio**2)
        for angle in (1.0,) if poles == 1 else (ratio + turned, ratio - turned):
            pole = np.exp(-2 * np.pi * hertz * step * angle)
            passed = passed * (1 - pole) / (1 - pole / z)
    return passed


def felt(device: Device, loop: Any, stiffness: float, damping: float, mass: float) -> Felt:
    """Of the held force a sample late, over the velocity of a hand that moves in a sine."""
    step, turn = device.sample_time.value, 2j * np.pi * HERTZ
    z, ratio = np.exp(turn * step), loop.filter_damping_ratio
    rates: list[Complex] = []
    for power, name in enumerate(("velocity_filter", "acceleration_filter"), start=1):
        kind, hertz, order = (getattr(loop, name + end) for end in ("", "_hz", "_order"))
        if kind == "tracking":
            rates.append(Observer(order, hertz, ratio, step).response(z, power))
        else:
            differences = ((1 - 1 / z) / step) ** power
            rates.append(differences * low_pass(z, step, hertz, order, ratio))
    law = stiffness + damping * rates[0] + mass * rates[1]
    held = (1 - 1 / z) / (turn * step) * np.exp(-turn * device.delay.value)
    # A spring is felt as one; what it has of mass by its lag is not counted.
    whole = held * law / turn
    moving = held * (law - stiffness) / turn
    return Felt(mass=moving.imag / (2 * np.pi * HERTZ), damping=whole.real)


def beyond(
    device: Device,
    seen: Felt,
    damping: float,
    mass: float,
    *,
    weber: tuple[float, float],
    floors: tuple[float, float],
) -> list[str]:
    """Limits that what is felt exceeds, by name.

    Weber fractions of damping and of mass, and the least of each that is noticed.
    """
    m, b = device.mass.value, device.damping.value
    least, step = mass * 2 * np.pi * HERTZ, 1 + SPARE
    near, beyond = MOTION, ~MOTION
    if mass:
        share = seen.mass / mass
        alike = (share <= 1.2 * step) & (share >= 1 / 1.2 / step)
    else:
        share = np.ones_like(HERTZ)
        alike = np.abs(_steps(m + seen.mass, m, weber[1], floors[1])) <= step
    off = _steps(b + seen.damping, b + damping, weber[0], floors[0])
    rest = _steps(b + seen.damping - abs(least), b + damping, weber[0], floors[0])
    kept = {
        "mass": alike | beyond,
        "damping": (np.abs(off) <= step) | beyond,
        "mass beyond": (np.abs(share - 1) <= step) | near,
        "damping taken away": (b + seen.damping >= -SPARE * b) | near,
        "parasitic damping": (rest <= step) | near,
    }
    return [name for name, good in kept.items() if not np.all(good)]


def _steps(total: Array, other: float, weber: float, floor: float) -> Array:
    """Steps between two totals: of one floor each below the corner, of a Weber fraction above."""
    corner = floor / np.log1p(weber)

    def height(each: Array) -> Array:
        above = np.log(np.maximum(each, corner) / corner) / np.log1p(weber)
        return above + np.minimum(each, corner) / floor

    return height(total) - height(np.array(other))
