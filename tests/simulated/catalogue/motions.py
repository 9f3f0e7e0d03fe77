"""Smooth motions with their velocity and acceleration, to be played or followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Seconds over which a motion fades in from rest.
_FADE = 0.5
#: Lines of a multisine.
_LINES = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """Position, velocity and acceleration of a motion, each shape (n,), m (rad) and s."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    def scaled(self, travel: float) -> Course:
        """The same within ± travel about its middle, from rest at zero."""
        factor = 2 * travel / float(np.ptp(self.position))
        return Course(
            position=self.position * factor,
            velocity=self.velocity * factor,
            acceleration=self.acceleration * factor,
        )


def multisine(time: FloatArray, low: float, high: float, seed: int) -> Course:
    """Lines from ``low`` to ``high`` Hz with about equal speed and random phases."""
    generator = np.random.default_rng(seed)
    turn = 2 * np.pi * np.geomspace(low, high, _LINES) * generator.uniform(0.9, 1.1, _LINES)
    phase = generator.uniform(0, 2 * np.pi, _LINES)
    return _faded(time, np.sum(np.sin(np.outer(time, turn) + phase) / turn, axis=1))


def chirp(time: FloatArray, low: float, high: float, seed: int) -> Course:
    """A sine that sweeps from ``low`` to ``high`` Hz with about equal speed, or back."""
    generator = np.random.default_rng(seed)
    duration = float(time[-1])
    rate = np.log(high / low) / duration
    swept = low * np.exp(rate * time)
    phase = 2 * np.pi * (swept - low) / rate + generator.uniform(0, 2 * np.pi)
    wave = np.sin(phase) / swept
    return _faded(time, wave if generator.random() < 0.5 else wave[::-1])


def point_to_point(time: FloatArray, low: float, high: float, seed: int) -> Course:
    """Moves between random places, each of minimum jerk, lasting 1/high to 1/low s."""
    generator = np.random.default_rng(seed)
    place = np.zeros_like(time)
    start, here = float(time[0]), 0.0
    while start < time[-1]:
        lasts = (high / low) ** float(generator.random()) / high / 2
        there = float(generator.uniform(-1, 1))
        part = np.clip((time - start) / lasts, 0, 1)
        place += (there - here) * part**3 * (10 - 15 * part + 6 * part**2)
        start, here = start + lasts, there
    return _differentiated(time, place)


def _faded(time: FloatArray, wave: FloatArray) -> Course:
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip((time - time[0]) / _FADE, 0, 1))
    return _differentiated(time, wave * rise)


def _differentiated(time: FloatArray, place: FloatArray) -> Course:
    velocity = np.asarray(np.gradient(place, time), dtype=np.float64)
    return Course(
        position=place - place[0],
        velocity=velocity,
        acceleration=np.asarray(np.gradient(velocity, time), dtype=np.float64),
    )
