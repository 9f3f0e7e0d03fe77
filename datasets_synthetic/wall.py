"""A wall: where effects act, and elements that come and go there in a way of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import choose_members, per_member

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: What a gate does to a damper: nothing, shuts and opens at random, or acts against the device:
#: shut where the damper would take energy, open where its lag makes it give some.
OPEN, RANDOM, ADVERSE = 0, 1, 2
#: Chance that a random gate changes in a sample.
_CHANGES = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """Effects act while the reading is above ``place``; a number, or an array of shape (batch,).

    The springs are relaxed at ``place``; outside there is no force but of what still fades out.

    Attributes:
        place: m (rad); -inf is no wall: the effects act everywhere, about zero, and elements
            beside them neither fade nor keep from pulling.
    """

    place: float | FloatArray = 0.0

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(self.place)]

    def members(self, which: NDArray[np.intp]) -> Wall:
        """The walls of these members, shape (members,)."""
        return replace(self, place=choose_members(self.place, which))


@dataclass(frozen=True, slots=True, kw_only=True)
class Element:
    """Effects beside a controller's own; numbers, or arrays of shape (batch,).

    Attributes:
        stiffness: K, N/m (N·m/rad).
        damping: B, N·s/m (N·m·s/rad).
        mass: M, kg (kg·m²).
        one_sided: behind a wall its force is kept from pulling.
        fade_time: s, over which its force fades in and out at a wall; 0 switches it at once.
        gate: of its damping: OPEN, RANDOM or ADVERSE.
    """

    stiffness: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    mass: float | FloatArray = 0.0
    one_sided: bool = False
    fade_time: float | FloatArray = 0.0
    gate: int | IntArray = OPEN

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, name)) for name in _FIELDS]

    def members(self, which: NDArray[np.intp]) -> Element:
        """The elements of these members, shape (members,); what all share stays one value."""
        fields = {name: choose_members(getattr(self, name), which) for name in _FIELDS}
        gate = fields.pop("gate").astype(np.int64)
        return replace(self, gate=gate, **fields)  # pyright: ignore[reportArgumentType]


_FIELDS = ("stiffness", "damping", "mass", "fade_time", "gate")


class ElementsAtWork:
    """Elements together, each remembering how far it is faded in and whether its gate is open.

    What no element has is not computed.
    """

    __slots__ = (
        "_always",
        "_ceiling",
        "_damping",
        "_ends",
        "_fade",
        "_gates",
        "_last",
        "_level",
        "_mass",
        "_open",
        "_place",
        "_source",
        "_start",
        "_stiffness",
    )

    def __init__(
        self, elements: Sequence[Element], wall: Wall | None, sample_time: FloatArray
    ) -> None:
        """Sample time in s, shape (batch,)."""

        def rows(name: str) -> FloatArray:
            return np.stack([per_member(getattr(e, name), sample_time.size) for e in elements])

        self._stiffness, self._damping, self._mass = (
            -each if each.any() else None
            for each in (rows("stiffness"), rows("damping"), rows("mass"))
        )
        self._place = None if wall is None else per_member(wall.place, sample_time.size)
        free = np.isneginf(-np.inf if self._place is None else self._place)
        #: Where springs are relaxed, m; None where all are about zero.
        start = None if self._place is None else np.where(np.isinf(self._place), 0.0, self._place)
        self._start = start if start is not None and start.any() else None
        fade = np.where(free, 0.0, rows("fade_time"))
        step = sample_time / np.maximum(fade, sample_time)
        #: Change of the level in a sample inside and outside; without a fade all at once.
        self._fade = step, -step
        self._level = np.zeros(step.shape)
        sides = np.array([each.one_sided for each in elements])[:, None] & ~free
        #: The most force behind a wall, N; None where all may pull.
        self._ceiling = np.where(sides, 0.0, np.inf) if sides.any() else None
        #: Where what only pushes is still fading out; None nowhere.
        self._ends = sides if (sides & (fade > 0)).any() else None
        gate = rows("gate")
        self._always = gate == OPEN
        self._gates = None if self._always.all() else (gate == RANDOM, gate == ADVERSE)
        self._source = np.random.default_rng(0)  # one gate for all members, whatever the batch
        self._open = True
        self._last: FloatArray | None = None

    def force(
        self, reading: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> FloatArray:
        """Sum of the forces (N) of this sample, shape (batch,).

        Args:
            reading: of the position, m.
            velocity: estimated, m/s.
            acceleration: estimated, m/s².
        """
        force = np.zeros(self._level.shape)
        if self._stiffness is not None:
            depth = reading if self._start is None else reading - self._start
            force = self._stiffness * depth
        if self._damping is not None:
            pull = self._damping * velocity
            force = force + (pull if self._gates is None else pull * self._acts(reading, velocity))
        if self._mass is not None:
            force = force + self._mass * acceleration
        if self._place is None:
            return np.add.reduce(force)
        if self._ceiling is not None:
            force = np.minimum(force, self._ceiling)
        inside = reading > self._place
        if self._ends is not None:
            force = force * (inside | ~self._ends)
        change = np.where(inside, *self._fade)
        self._level = np.minimum(np.maximum(self._level + change, 0.0), 1.0)
        return np.add.reduce(self._level * force)

    def _acts(self, reading: FloatArray, velocity: FloatArray) -> NDArray[np.bool_]:
        """Which dampers act."""
        assert self._gates is not None
        if self._source.random() < _CHANGES:
            self._open = not self._open
        moved = np.zeros_like(reading) if self._last is None else reading - self._last
        self._last = reading
        at_random, adverse = self._gates
        acts = self._always | (adverse & (velocity * moved < 0))
        return acts | at_random if self._open else acts
