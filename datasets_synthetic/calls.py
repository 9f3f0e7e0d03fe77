"""What a program asks of elements while they play, and what may change while they do.

Leaving is always safe, and so is less: they take effect at once. A spring rests where it is
entered, and acts with more force only after it gave none for a while. What fades, fades, but not
while a wall pushes. A damper alone is switched at any moment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import choose_members, per_member

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
        "_always",
        "_asked",
        "_bounds",
        "_busy",
        "_entrance",
        "_fade",
        "_fades",
        "_gain",
        "_last",
        "_least",
        "_left",
        "_level",
        "_met",
        "_moved",
        "_place",
        "_random",
        "_rest",
        "_sample",
        "_side",
        "_source",
        "_spring",
        "_stiffness",
        "_taps",
        "_until",
        "_walls",
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
        self._stiffness = stiffness
        self._rest, self._bounds = rest, bounds
        self._spring, self._walls, self._side = stiffness > 0, side != 0, side
        self._place = rest.copy()
        fades = fade < 1
        self._fade, self._fades = fade, fades if fades.any() else None
        self._taps, self._until = calls.taps, calls.until
        entrance = np.where(self._walls, -np.inf, per_member(calls.entrance, batch))
        self._entrance = entrance if np.isfinite(entrance).any() else None
        caller, alone = per_member(calls.caller, batch), per_member(calls.dampers, batch) > 0
        called = ~alone | ((damping > 0) & ~self._spring & (mass == 0) & ~fades)
        random = called & (caller == RANDOM)
        # A spring that fades is taken to fade all the way: at a low level it could be pumped.
        adverse = called & (caller == ADVERSE) & ~(self._spring & fades)
        self._random, self._adverse = (
            random if random.any() else None,
            adverse if adverse.any() else None,
        )
        self._left = alone & random, alone & adverse, random & ~alone & ~self._walls
        self._least = np.where(self._spring, _LEAST, 0.0)
        self._source = np.random.default_rng(0)  # one caller for all members, whatever the batch
        self._gain = np.ones((len(stiffness), 1))
        self._always = np.ones(stiffness.shape)
        self._asked: FloatArray | None = None
        self._level = np.zeros(stiffness.shape)
        #: Walls that are not at their faces, and the last samples with a force, there or here.
        self._moved: Mask | None = None
        self._met, self._busy = np.zeros(stiffness.shape), np.zeros(stiffness.shape)
        self._last, self._sample = np.zeros(batch), 0

    def played(self, reading: FloatArray, moving: FloatArray, law: FloatArray) -> FloatArray:
        """What is felt of each clamp, N.

        Args:
            reading: m, shape (batch,).
            moving: B·velocity + M·acceleration, N.
            law: each clamp of all of it, N.
        """
        self._sample = k = self._sample + 1
        asked, before = self._called(reading, law), self._asked
        self._asked = asked
        if before is None:  # what is there from the start is not entered
            self._level, before = asked.copy(), asked
        entering = None
        if asked is not before:
            entering = self._spring & (asked > 0) & (before == 0) & (self._level == 0)
            if np.count_nonzero(entering):
                self._enter(entering, reading, moving)
                law = np.where(entering, self._clamped(reading, moving, self._rest), law)
        np.copyto(self._busy, k, where=law != 0)
        quiet = self._busy <= k - self._taps
        if self._moved is not None and np.count_nonzero(self._moved & (law == 0)):
            self._return(quiet, reading, moving)
        rises = quiet | ~self._spring
        if entering is not None:
            rises |= entering
        level = np.where(rises, asked, np.minimum(self._level, asked))
        if self._fades is not None:
            pushes = np.logical_or.reduce((law * level != 0) & self._walls)
            change = self._fade * ~pushes
            faded = np.minimum(np.maximum(asked, self._level - change), self._level + change)
            np.copyto(level, faded, where=self._fades)
        self._level = level
        return law * level

    def _enter(self, entering: Mask, reading: FloatArray, moving: FloatArray) -> None:
        """Each rests where the device is; a wall at its face, if the device is not behind it."""
        stays = self._walls & ~(self._side * (self._place - reading) > 0)
        clear = self._clamped(reading, moving, self._place) == 0
        np.copyto(self._rest, np.where(stays, self._place, reading), where=entering)
        np.copyto(self._met, self._sample - clear, where=entering)
        np.copyto(self._busy, self._sample - 1, where=entering)
        self._look()

    def _return(self, quiet: Mask, reading: FloatArray, moving: FloatArray) -> None:
        """Walls that would have given no force for a while are at their faces again."""
        at_face = self._clamped(reading, moving, self._place)
        np.copyto(self._met, self._sample, where=at_face != 0)
        back = quiet & (self._met <= self._sample - self._taps)
        np.copyto(self._rest, self._place, where=back & self._walls)
        self._look()

    def _look(self) -> None:
        """Which walls are not at their faces."""
        moved = self._walls & (self._rest != self._place)
        self._moved = moved if moved.any() else None

    def _clamped(self, reading: FloatArray, moving: FloatArray, rest: FloatArray) -> FloatArray:
        """Each clamp as it is where it rests there."""
        law = self._stiffness * (reading - rest) + moving
        return np.minimum(np.maximum(law, self._bounds[0]), self._bounds[1])

    def _called(self, reading: FloatArray, law: FloatArray) -> FloatArray:
        """Gain that is asked for of each: the array of before where that is the same."""
        if self._until == 0:
            random, adverse, left = self._left
            self._random = random if random.any() else None
            self._adverse = adverse if adverse.any() else None
            self._always = np.where(left, 0.0, 1.0)
        self._until -= 1
        asked, before = self._always, self._asked
        if self._random is not None:
            if self._source.random() < _CHANCE:
                self._gain = self._gain.copy()
                self._gain[self._source.integers(len(self._gain))] = self._source.choice(_GAINS)
            asked = np.where(self._random, self._gain, asked)
        if self._adverse is not None:
            # The lag of a damper makes it give some.
            gives = law * (reading - self._last) < 0
            asked = np.where(self._adverse & ~gives, self._least, asked)
        self._last = reading
        if self._entrance is not None:
            asked = asked * (reading > self._entrance)
        return before if before is not None and np.array_equal(asked, before) else asked
