"""A smooth motion with its velocity and acceleration, to be played or followed."""

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
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip((time - time[0]) / _FADE, 0, 1))
    place = rise * np.sum(np.sin(np.outer(time, turn) + phase) / turn, axis=1)
    velocity = np.asarray(np.gradient(place, time), dtype=np.float64)
    return Course(
        position=place - place[0],
        velocity=velocity,
        acceleration=np.asarray(np.gradient(velocity, time), dtype=np.float64),
    )
