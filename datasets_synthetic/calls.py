"""What a program asks of elements while they play, and what may change while they do.

Leaving is always safe, and so is less: they take effect at once. A spring is entered where it gives
no force, and acts with more force only after it gave none for a while. What fades, fades, but not
while a wall pushes. A damper alone is switched at any moment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.batch_values import choose_members, per_member

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Who calls: nobody, somebody who enters and leaves and asks for gains at random, or somebody who
#: holds the device less where that takes energy than where it gives some.
NOBODY, RANDOM, ADVERSE = 0, 1, 2
#: Chance that one element is called at random in a sample, and the gains it may be asked for.
_CHANCE, _GAINS = 0.05, (0.0, 0.0, 0.3, 1.0, 1.0)
#: Gain of a spring while it takes energy, where a caller is adverse.
_LEAST = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Calls:
    """What is asked of the elements of a controller; numbers, or arrays of shape (batch,).

    Attributes:
        entrance: m (rad); what is no wall is entered where the reading passes it and left where it
            comes back; -inf is everywhere.
        caller: NOBODY, RANDOM or ADVERSE.
        dampers: whether only elements that are nothing but a damper are called, to the end.
        until: samples after which all others are: at random what is no wall is left then, else all
            is entered.
        taps: samples without force after which a spring may act with more.
    """

    entrance: float | FloatArray = -np.inf
    caller: int | IntArray = NOBODY
    dampers: bool | Mask = False
    until: int = 0
    taps: int = 1

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        return [np.size(getattr(self, name)) for name in _FIELDS]

    def members(self, which: NDArray[np.intp]) -> Calls:
        """The calls of these members, shape (members,); what all share stays one value."""
        chosen = {name: choose_members(getattr(self, name), which) for name in _FIELDS}
        return replace(self, **chosen)  # pyright: ignore[reportArgumentType]

    def first(self, batch: int) -> int:
        """The first member of whose elements anything is asked; the batch where of none."""
        asked = np.isfinite(per_member(self.entrance, batch)) | (per_member(self.caller, batch) > 0)
        return int(np.argmax(asked)) if asked.any() else batch


_FIELDS = ("entrance", "caller", "dampers")


class Transitions:
    """Elements that come and go, each remembering its rest, its level and how long it was quiet.

    All arrays have shape (elements, batch), but for ``calls``.
    """

    __slots__ = (
        "_adverse",
        "_asked",
        "_bounds",
        "_clear",
        "_entrance",
        "_fade",
        "_fades",
        "_gain",
        "_last",
        "_least",
        "_left",
        "_level",
        "_place",
        "_quiet",
        "_random",
        "_rest",
        "_source",
        "_spring",
        "_stiffness",
        "_taps",
        "_until",
        "_walls",
        "_wanted",
    )

    def __init__(
        self,
        calls: Calls,
        *,
        stiffness: FloatArray,
        damping: FloatArray,
        mass: FloatArray,
        side: FloatArray,
        rest: FloatArray,
        bounds: tuple[FloatArray, FloatArray],
        fade: FloatArray,
    ) -> None:
        """``rest`` is a view: what it is changed to here is played.

        Args:
            calls: of these members.
            stiffness: K, N/m.
            damping: B, N·s/m.
            mass: M, kg.
            side: of each, 0 of what is no wall.
            rest: m.
            bounds: of each clamp, N.
            fade: change of a level in a sample, 1 where nothing fades.
        """
        batch = stiffness.shape[1]
        self._stiffness, self._rest, self._bounds = np.where(stiffness, stiffness, 1.0), rest, bounds
        self._spring, self._walls, self._place = stiffness > 0, side != 0, rest.copy()
        self._fade, self._fades = fade, fade < 1
        self._taps, self._until = calls.taps, calls.until
        entrance = np.where(self._walls, -np.inf, per_member(calls.entrance, batch))
        self._entrance = entrance if np.isfinite(entrance).any() else None
        caller, alone = per_member(calls.caller, batch), per_member(calls.dampers, batch) > 0
        called = np.where(alone, (damping > 0) & ~self._spring & (mass == 0) & ~self._fades, True)
        self._random, self._adverse = called & (caller == RANDOM), called & (caller == ADVERSE)
        self._left = ~alone, np.where((caller == RANDOM) & ~alone & ~self._walls, 0.0, 1.0)
        self._least = np.where(self._spring, _LEAST, 0.0)
        self._source = np.random.default_rng(0)  # one caller for all members, whatever the batch
        self._gain = np.ones((len(stiffness), 1))
        self._asked = np.ones(stiffness.shape)
        self._level = self._quiet = self._clear = np.zeros(stiffness.shape)
        self._wanted = self._spring  # what is there at the start is not entered
        self._last: FloatArray | None = None

    def played(self, reading: FloatArray, moving: FloatArray, law: FloatArray) -> FloatArray:
        """What is felt of each clamp, N.

        Args:
            reading: m, shape (batch,).
            moving: B·velocity + M·acceleration, N.
            law: each clamp of all of it, N.
        """
        started, last = self._last is not None, reading if self._last is None else self._last
        self._last = reading
        asked = self._called(reading, law * (reading - last))
        wanted = asked > 0
        if not started:
            self._level, self._wanted = asked.copy(), wanted
        at_face = None
        entering = self._spring & wanted & ~self._wanted & (self._level == 0)
        if entering.any():
            at_face = self._at_face(reading, moving)
            stays = self._walls & (at_face == 0)
            here = np.where(stays, self._place, reading + moving / self._stiffness)
            np.copyto(self._rest, here, where=entering)
            law = np.where(entering, 0.0, law)
            self._quiet, self._clear = self._quiet * ~entering, self._clear * ~entering
        self._quiet = (self._quiet + 1) * (law == 0)
        moved = self._walls & (self._rest != self._place)
        if moved.any():
            at_face = self._at_face(reading, moving) if at_face is None else at_face
            self._clear = (self._clear + 1) * (at_face == 0)
            np.copyto(self._rest, self._place, where=moved & (self._clear >= self._taps))
        rises = ~self._spring | entering | (self._quiet >= self._taps)
        level = np.where(rises, asked, np.minimum(self._level, asked))
        if self._fades.any():
            pushes = np.any(self._walls & (law * level != 0), axis=0)
            change = self._fade * ~pushes
            faded = np.minimum(np.maximum(asked, self._level - change), self._level + change)
            level = np.where(self._fades, faded, level)
        self._level, self._wanted = level, wanted
        return law * level

    def _at_face(self, reading: FloatArray, moving: FloatArray) -> FloatArray:
        """Each clamp where it was asked for to be."""
        law = self._stiffness * (reading - self._place) + moving
        return np.minimum(np.maximum(law, self._bounds[0]), self._bounds[1])

    def _called(self, reading: FloatArray, taken: FloatArray) -> FloatArray:
        """Gain that is asked for of each, by a reading, m, and the energy each takes, J."""
        if self._until == 0:
            still, left = self._left
            self._random, self._adverse = self._random & ~still, self._adverse & ~still
            self._asked = np.where(still, left, self._asked)
        self._until -= 1
        asked = self._asked
        if self._random.any():
            if self._source.random() < _CHANCE:
                self._gain[self._source.integers(len(self._gain))] = self._source.choice(_GAINS)
            asked = np.where(self._random, self._gain, asked)
        if self._adverse.any():
            # The lag of a damper makes it give some.
            asked = np.where(self._adverse & ~(taken < 0), self._least, asked)
        if self._entrance is not None:
            asked = asked * (reading > self._entrance)
        return asked
