"""What a hand feels of an element, by an own impedance, and what of it is beyond what is asked for.

docs/tuning.md, "Filters". Of filters low-passes alone.
"""

from __future__ import annotations

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
    difference = (1 - 1 / z) / step
    first = low_pass(z, step, loop.velocity_filter_hz, loop.velocity_filter_order, ratio)
    second = low_pass(z, step, loop.acceleration_filter_hz, loop.acceleration_filter_order, ratio)
    law = stiffness + damping * difference * first + mass * difference**2 * second
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
