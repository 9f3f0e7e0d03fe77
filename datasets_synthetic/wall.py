"""Elements of a controller: each a clamp round its spring, damper and mass, walls among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import choose_members, per_member
from datasets_synthetic.calls import Calls, Transitions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Element:
    """Effects that act as one; numbers, or arrays of shape (batch,).

    The force is -clamp(u) with u = K·(reading - place) + B·velocity + M·acceleration: between
    -level and level, of a wall between 0 and level on the side to which it pushes.

    Attributes:
        stiffness: K, N/m (N·m/rad).
        damping: B, N·s/m (N·m·s/rad).
        mass: M, kg (kg·m²).
        side: to which it pushes: -1 or 1 of a wall, which lies above its place or below it; 0 both.
        place: of the face of a wall and of the rest of another spring, m (rad).
        level: the most force of what has a spring or a side, N (N·m).
        fade_time: s, over which it fades in and out when it is entered and left; 0 switches it.
    """

    stiffness: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    mass: float | FloatArray = 0.0
    side: int | IntArray = 0
    place: float | FloatArray = 0.0
    level: float | FloatArray = np.inf
    fade_time: float | FloatArray = 0.0

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, each.name)) for each in fields(self)]

    def members(self, which: NDArray[np.intp]) -> Element:
        """The elements of these members, shape (members,); what all share stays one value."""
        chosen = {each.name: choose_members(getattr(self, each.name), which) for each in fields(self)}
        return replace(self, **chosen)  # pyright: ignore[reportArgumentType]


class ElementsAtWork:
    """Elements together; arrays of shape (elements, batch). What no element has is not computed."""

    __slots__ = (
        "_cut",
        "_damping",
        "_high",
        "_low",
        "_mass",
        "_moving",
        "_rest",
        "_stiffness",
        "_transitions",
    )

    def __init__(
        self, elements: Sequence[Element], calls: Calls | None, sample_time: FloatArray
    ) -> None:
        """Sample time in s, shape (batch,)."""

        def rows(name: str) -> FloatArray:
            return np.stack([per_member(getattr(e, name), sample_time.size) for e in elements])

        stiffness, self._damping, mass = rows("stiffness"), rows("damping"), rows("mass")
        self._stiffness = stiffness if stiffness.any() else None
        self._mass = mass if mass.any() else None
        self._rest, side = rows("place"), rows("side")
        most = np.where((stiffness > 0) | (side != 0), rows("level"), np.inf)
        # A wall that pushes to lower readings lets pass what is positive, and the other way round.
        self._low = np.where(side < 0, 0.0, -most)
        self._high = np.where(side > 0, 0.0, most)
        self._cut = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self._transitions = None
        #: The first member of those whose elements come and go.
        self._moving = sample_time.size
        if calls is not None:
            self._moving = first = calls.first(sample_time.size)
            some = slice(first, None)
            self._transitions = Transitions(
                calls.members(np.arange(first, sample_time.size)),
                stiffness=stiffness[:, some],
                damping=self._damping[:, some],
                mass=mass[:, some],
                side=side[:, some],
                rest=self._rest[:, some],
                bounds=(self._low[:, some], self._high[:, some]),
                fade=sample_time[some] / rows("fade_time")[:, some].clip(sample_time[some]),
            )

    def force(
        self, reading: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> FloatArray:
        """Sum of the forces (N) of this sample, shape (batch,).

        Args:
            reading: of the position, m.
            velocity: estimated, m/s.
            acceleration: estimated, m/s².
        """
        moving = self._damping * velocity
        if self._mass is not None:
            moving += self._mass * acceleration
        law = moving
        if self._stiffness is not None:
            law = self._stiffness * (reading - self._rest) + moving
        if self._cut:
            law = np.minimum(np.maximum(law, self._low), self._high)
        if self._transitions is not None:
            some = slice(self._moving, None)
            law[:, some] = self._transitions.played(
                reading[some], moving[:, some], law[:, some]
            )
        return -np.add.reduce(law)
