"""A wall: where effects act, and elements that come and go there in a way of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.members import chosen

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
        """The walls of these members."""
        return replace(self, place=chosen(self.place, which))


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
        """The elements of these members; a value that all share stays one value."""
        fields = {name: chosen(getattr(self, name), which) for name in _FIELDS}
        gate = fields.pop("gate").astype(np.int64)
        return replace(self, gate=gate, **fields)  # pyright: ignore[reportArgumentType]


_FIELDS = ("stiffness", "damping", "mass", "fade_time", "gate")


class Gains(Protocol):
    """What has effects; numbers, or arrays of shape (batch,)."""

    @property
    def stiffness(self) -> float | FloatArray:
        """K, N/m (N·m/rad)."""
        ...

    @property
    def damping(self) -> float | FloatArray:
        """B, N·s/m (N·m·s/rad)."""
        ...

    @property
    def mass(self) -> float | FloatArray:
        """M, kg (kg·m²)."""
        ...


class Effects:
    """Spring, damper and mass as forces; what is zero for all members is not computed."""

    __slots__ = ("_damping", "_mass", "_stiffness")

    def __init__(self, gains: Gains) -> None:
        self._stiffness, self._damping, self._mass = (
            -np.asarray(each, dtype=np.float64) if np.any(each) else None
            for each in (gains.stiffness, gains.damping, gains.mass)
        )

    def force(
        self,
        depth: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        acts: NDArray[np.bool_] | None = None,
    ) -> FloatArray:
        """-(K·depth + B·velocity + M·acceleration), N, dampers only where they act."""
        force = np.zeros_like(depth) if self._stiffness is None else self._stiffness * depth
        if self._damping is not None:
            pull = self._damping * velocity
            force = force + (pull if acts is None else pull * acts)
        return force if self._mass is None else force + self._mass * acceleration


class ElementAtWork:
    """One element, remembering how far it is faded in and whether its gates are open."""

    __slots__ = (
        "_adverse",
        "_always",
        "_ceiling",
        "_effects",
        "_level",
        "_open",
        "_random",
        "_source",
        "_step",
        "gated",
    )

    def __init__(
        self, element: Element, sample_time: FloatArray, place: FloatArray | None = None
    ) -> None:
        """Sample time in s and place of the wall in m, each shape (batch,); None for no wall."""
        self._effects = Effects(element)
        fade = np.broadcast_to(np.asarray(element.fade_time, dtype=np.float64), sample_time.shape)
        free = np.isneginf(np.full(sample_time.shape, -np.inf) if place is None else place)
        #: Change of the level in a sample; None where nothing fades.
        self._step: FloatArray | None = None
        if np.any(fade[~free] > 0):
            self._step = np.where(free, 1.0, sample_time / np.maximum(fade, sample_time))
        self._level = np.zeros(sample_time.shape)
        #: The most force behind a wall, N; None where all may pull.
        self._ceiling: FloatArray | None = None
        if element.one_sided and not free.all():
            self._ceiling = np.where(free, np.inf, 0.0)
        gate = np.broadcast_to(np.asarray(element.gate), sample_time.shape)
        self._always, self._random, self._adverse = (
            gate == kind for kind in (OPEN, RANDOM, ADVERSE)
        )
        #: Whether any member has a gate.
        self.gated = not self._always.all()
        self._source = np.random.default_rng(0)  # one gate for all members, whatever the batch
        self._open = True

    def force(
        self,
        depth: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        moved: FloatArray | None,
        inside: NDArray[np.bool_] | None,
    ) -> FloatArray:
        """Force (N) of this sample, shape (batch,).

        Args:
            depth: of the reading, m.
            velocity: estimated, m/s.
            acceleration: estimated, m/s².
            moved: change of the reading since the last sample, m; None where nothing is gated.
            inside: where the reading is behind the wall; None without one: all acts fully.
        """
        acts = self._gates(velocity, moved) if self.gated and moved is not None else None
        force = self._effects.force(depth, velocity, acceleration, acts)
        if inside is None:
            return force
        if self._ceiling is not None:
            force = np.minimum(force, self._ceiling)
        if self._step is None:
            return force * inside
        if self._ceiling is not None:
            force = force * inside
        change = np.where(inside, self._step, -self._step)
        self._level = np.minimum(np.maximum(self._level + change, 0.0), 1.0)
        return self._level * force

    def _gates(self, velocity: FloatArray, moved: FloatArray) -> NDArray[np.bool_]:
        """Which dampers act."""
        if self._source.random() < _CHANGES:
            self._open = not self._open
        gives = velocity * moved < 0
        return self._always | (self._adverse & gives) | (self._random & self._open)
