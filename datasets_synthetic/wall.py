"""A one-sided wall: effects that act on one side of a place only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.members import chosen

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """Effects act while the reading is above ``place``; numbers, or arrays of shape (batch,).

    The spring is relaxed at ``place``; outside there is no force.

    Attributes:
        place: m (rad); -inf lets the effects act everywhere, about zero.
        unilateral: the wall never pulls: its force is kept from being positive.
        restarts: at the sample that finds the reading inside for the first time the estimates of
            velocity and acceleration start from rest there, so that entering makes no jump of
            force. They then take the speed of entering for an acceleration: a virtual mass M is
            hit like a mass at rest and gives the momentum -M·v, a negative one kicks the handle
            on. False lets the estimates follow the readings outside too.
    """

    place: float | FloatArray = 0.0
    unilateral: bool = False
    restarts: bool = True

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(self.place)]

    def members(self, which: NDArray[np.intp]) -> Wall:
        """The walls of these members."""
        return replace(self, place=chosen(self.place, which))
