"""Free motion in a log: from the furthest turning point to the last clear one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: A swing counts if it is larger than this many encoder counts, ...
_COUNTS = 4.0
#: ... than this many times the noise of a reading, ...
_NOISES = 8.0
#: ... and than this part of the largest deviation from rest.
_LEAST_SWING = 0.02
#: A swing larger than the one before it by this factor is a new push.
_GROWN = 1.05
#: So many swings, each larger than the one before, are no chance and no hand.
_GROWING = 5
#: Rows of motion that are worth looking at.
_SHORTEST = 50
#: The last part of the log tells where the handle comes to rest.
_REST = 0.05
#: Motion without turning is followed this many times as long as it takes to settle.
_TAIL = 1.5
#: Standard deviation of a normal variable over its median modulus.
_MAD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """The rows of free motion.

    Attributes:
        first: row at which it begins.
        end: row after its last one.
        turns: rows within at which the handle turns, ``first`` not among them.
        deviation: of the first row from rest, m.
        clear: smallest swing that is told from noise and counts, m.
        grows: whether swing after swing grew until the log ends: there is no free decay.
    """

    first: int
    end: int
    turns: tuple[int, ...]
    deviation: float
    clear: float
    grows: bool


def smallest_step(position: FloatArray) -> float:
    """Least distance of two different readings, m: one count, if the log is of an encoder.

    The position has shape (n,).
    """
    values = np.unique(position)
    return float(np.min(np.diff(values))) if values.size > 1 else 0.0


def reading_noise(position: FloatArray) -> float:
    """Standard deviation of one reading, m, from second differences, of which motion has few.

    The position has shape (n,).
    """
    second = np.diff(position, n=2)
    return float(_MAD * np.median(np.abs(second)) / np.sqrt(6))


def find_release(position: FloatArray, first: int) -> Release | None:
    """Free motion after row ``first``; None where nothing moves clearly.

    Args:
        position: m, shape (n,).
        first: row before which nothing is free: the stated release, or the last saturated row.
    """
    part = position[first:]
    if part.size < _SHORTEST:
        return None
    rest = float(np.median(part[-max(1, round(_REST * part.size)) :]))
    furthest = float(np.max(np.abs(part - rest)))
    noise = reading_noise(position)
    grain = smallest_step(position) if noise == 0 else 0.0
    clear = max(_COUNTS * grain, _NOISES * noise, _LEAST_SWING * furthest)
    turns = turning_points(part, clear)
    if furthest <= clear or not turns:
        return None
    start = max(range(len(turns)), key=lambda i: abs(part[turns[i]] - rest))
    kept = _decaying(part, turns[start:])
    # A hand may hold there for long; it has let go where the motion is clear.
    swing = part[kept[0] : kept[1] if len(kept) > 1 else part.size]
    begin = kept[0] + int(np.flatnonzero(np.abs(swing - swing[0]) <= clear)[-1])
    if len(kept) > 1:
        end = kept[-1] + 1
    else:
        near = np.abs(part - rest) < max(clear, _LEAST_SWING * abs(part[begin] - rest))
        moving = np.flatnonzero(~near[begin:])
        settled = int(moving[-1]) + 1 if moving.size else 1
        end = min(part.size, begin + round(_TAIL * settled))
    return Release(
        first=first + begin,
        end=first + end,
        turns=tuple(first + turn for turn in kept[1:]),
        deviation=float(part[begin]) - rest,
        clear=clear,
        grows=_grows(part, turns, start),
    )


def turning_points(position: FloatArray, clear: float) -> list[int]:
    """Rows at which the motion turns by more than ``clear``; the first is where it sets off.

    A turning point that spans several equal readings is in their middle, the first at their end.

    The position has shape (n,), m (rad), as has ``clear``; the answer has shape (turning points,).
    """
    found: list[int] = []
    low = high = 0
    rising: bool | None = None
    for row, place in enumerate(position.tolist()):
        if place > position[high] or (rising is None and place == position[high]):
            high = row
        if place < position[low] or (rising is None and place == position[low]):
            low = row
        if rising is not False and position[high] - place > clear:
            found.append(high if rising is None else _middle(position, high))
            rising, low = False, row
        elif rising is not True and place - position[low] > clear:
            found.append(low if rising is None else _middle(position, low))
            rising, high = True, row
    return found


def _middle(position: FloatArray, row: int) -> int:
    last = row
    while last + 1 < position.size and position[last + 1] == position[row]:
        last += 1
    return (row + last) // 2


def _grows(position: FloatArray, turns: list[int], start: int) -> bool:
    """Whether the furthest turning point ends a row of growing swings, at the end of the log."""
    swings = np.abs(np.diff(position[turns[: start + 1]]))[-_GROWING:]
    last = len(turns) - start <= 2
    return last and swings.size == _GROWING and bool(np.all(np.diff(swings) > 0))


def _decaying(position: FloatArray, turns: list[int]) -> list[int]:
    """The turning points before the swings grow again."""
    kept = turns[:2]
    for turn in turns[2:]:
        before = abs(position[kept[-1]] - position[kept[-2]])
        if abs(position[turn] - position[kept[-1]]) > _GROWN * before:
            break
        kept.append(turn)
    return kept
