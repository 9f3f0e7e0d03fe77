"""A wall: where effects act, and elements that come and go there in a way of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import choose_members, per_member

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: What whoever calls does: plays everything as it is; enters and leaves what is no wall, and lets
#: the gains of all fall and rise, at random; or leaves what takes energy and enters what gives it.
OPEN, RANDOM, ADVERSE = 0, 1, 2
#: Chance that a caller changes its mind in a sample, and the least gain it asks for.
_CHANGES, _LEAST = 0.02, 0.3
#: Samples without force after which a spring may act in full again, unless a controller says.
QUIET = 32


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """Effects are entered where the reading passes ``place``; a number, or shape (batch,).

    A one-sided element has its face there and is always at hand: it begins to push where its law
    passes zero. What else has a spring is entered where it gives no force; what fades, fades.

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

    With a stiffness its force is one clamp, -clamp(K·(y - rest) + B·v + M·a); without, it is
    switched at any moment, or fades.

    Attributes:
        stiffness: K, N/m (N·m/rad).
        damping: B, N·s/m (N·m·s/rad).
        mass: M, kg (kg·m²).
        one_sided: behind a wall it pushes only.
        level: of its clamp, N (N·m).
        fade_time: s, over which its force fades in and out at a wall; 0 switches it at once.
        gate: what the caller does with it: OPEN, RANDOM or ADVERSE.
        calls: samples after which the caller leaves it as it is.
        quiet: samples without force after which a spring whose gain fell may act in full again.
    """

    stiffness: float | FloatArray = 0.0
    damping: float | FloatArray = 0.0
    mass: float | FloatArray = 0.0
    one_sided: bool = False
    level: float | FloatArray = np.inf
    fade_time: float | FloatArray = 0.0
    gate: int | IntArray = OPEN
    calls: int | IntArray = 0
    quiet: int | IntArray = QUIET

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, name)) for name in _FIELDS]

    def members(self, which: NDArray[np.intp]) -> Element:
        """The elements of these members, shape (members,); what all share stays one value."""
        fields = {name: choose_members(getattr(self, name), which) for name in _FIELDS}
        whole = {name: fields.pop(name).astype(np.int64) for name in _WHOLE}
        return replace(self, **whole, **fields)  # pyright: ignore[reportArgumentType]


_WHOLE = ("gate", "calls", "quiet")
_FIELDS = ("stiffness", "damping", "mass", "level", "fade_time", *_WHOLE)


class ElementsAtWork:
    """Elements together, each remembering its rest, its level and how long it gave no force.

    All arrays have shape (elements, batch). What no element has is not computed.
    """

    __slots__ = (
        "_calls",
        "_clamped",
        "_damping",
        "_entered",
        "_fade",
        "_faded",
        "_gain",
        "_gates",
        "_high",
        "_last",
        "_level",
        "_low",
        "_mass",
        "_open",
        "_place",
        "_quiet",
        "_rest",
        "_since",
        "_source",
        "_stiffness",
        "_walls",
    )

    def __init__(
        self, elements: Sequence[Element], wall: Wall | None, sample_time: FloatArray
    ) -> None:
        """Sample time in s, shape (batch,)."""

        def rows(name: str) -> FloatArray:
            return np.stack([per_member(getattr(e, name), sample_time.size) for e in elements])

        self._stiffness, damping, mass = rows("stiffness"), rows("damping"), rows("mass")
        self._damping = damping if damping.any() else None
        self._mass = mass if mass.any() else None
        place = -np.inf if wall is None else wall.place
        self._place = per_member(place, sample_time.size)
        free = np.isneginf(self._place)
        self._walls = np.array([each.one_sided for each in elements])[:, None] & ~free
        self._clamped = self._stiffness > 0
        level = rows("level")
        self._high = np.where(self._clamped, level, np.inf)
        self._low = np.where(self._walls, 0.0, -self._high)
        #: Where each spring is relaxed.
        self._rest = np.broadcast_to(np.where(free, 0.0, self._place), level.shape)
        fade = np.where(free, 0.0, rows("fade_time"))
        self._faded = fade > 0
        #: Change of a level in a sample.
        self._fade = np.where(self._faded, sample_time / np.maximum(fade, sample_time), 1.0)
        self._level = np.where(self._walls | free, 1.0, 0.0)
        self._entered = self._walls | free
        gate = rows("gate")
        self._gates = None if not gate.any() else (gate == RANDOM, gate == ADVERSE)
        self._quiet, self._calls = rows("quiet"), int(rows("calls").max())
        self._since = np.zeros(level.shape)
        self._source = np.random.default_rng(0)  # one caller for all members, whatever the batch
        self._open, self._gain = True, 1.0
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
        moving: FloatArray | float = 0.0
        if self._damping is not None:
            moving = moving + self._damping * velocity
        if self._mass is not None:
            moving = moving + self._mass * acceleration
        wanted, gain = (reading > self._place) | self._walls, 1.0
        if self._gates is not None and self._calls > 0:
            self._calls -= 1
            wanted, gain = self._called(wanted, reading, velocity)
        entering = wanted & ~self._entered & self._clamped
        if entering.any():
            # A spring is entered where it gives no force.
            here = reading + moving / np.where(self._clamped, self._stiffness, 1.0)
            self._rest = np.where(entering, here, self._rest)
        law = np.minimum(
            np.maximum(self._stiffness * (reading - self._rest) + moving, self._low), self._high
        )
        asked = wanted * gain
        # What rises does so while it gives no force, or slowly.
        resting = law == 0
        self._since = (self._since + 1) * resting
        steady = self._clamped & ~self._faded
        free = ~steady | entering | (self._since >= self._quiet)
        up = np.where(free, self._level + np.where(steady, 1.0, self._fade), self._level)
        down = self._level - np.where(self._faded, self._fade, 1.0)
        level = np.maximum(np.minimum(asked, up), down)
        if self._faded.any() and self._walls.any():
            # What fades stands still while a wall pushes.
            pushing = (self._walls & ~resting).any(axis=0)
            level = np.where(self._faded & pushing, self._level, level)
        self._level, self._entered = level, wanted
        return -np.add.reduce(level * law)

    def _called(
        self, wanted: NDArray[np.bool_], reading: FloatArray, velocity: FloatArray
    ) -> tuple[NDArray[np.bool_], FloatArray | float]:
        """(which elements are asked for, at which gain)."""
        assert self._gates is not None
        if self._source.random() < _CHANGES:
            self._open = not self._open
            self._gain = float(self._source.uniform(_LEAST, 1.0)) if self._open else 1.0
        moved = np.zeros_like(reading) if self._last is None else reading - self._last
        self._last = reading
        at_random, adverse = self._gates
        # A damper is left where it takes energy, and entered where its lag makes it give some.
        gives = np.where(self._clamped, self._level > 0, velocity * moved < 0)
        shut = ((at_random & (not self._open)) | (adverse & ~gives)) & ~self._walls
        gain = np.where(at_random, self._gain, 1.0)
        return wanted & ~shut, gain
