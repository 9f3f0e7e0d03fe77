"""Many devices with many effects, a block of points at a time.

Each point is computed for itself, number by number, so that what a single loop answers it answers
among a million too, to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tune.documents.scene import EFFECT_NAMES, Effects
from tune.loop.loop import Loop
from tune.loop.polynomials import FloatArray, Polynomial

#: Points of a block: some megabytes of arrays, whatever the number of all.
BLOCK = 4096

_Answer = Callable[[Loop, Effects], tuple[NDArray[Any], ...]]


def answered(answer: _Answer, loop: Loop, effects: Effects) -> tuple[NDArray[Any], ...]:
    """What a function answers for each point of loop and effects, arrays of their broadcast shape.

    Many points are parted along the longest axis, and parts that are still too many again.
    """
    given = zip(EFFECT_NAMES, effects.arrays(), strict=True)
    present = {name: value for name, value in given if value is not None}
    shape = np.broadcast_shapes(
        loop.terms.free.shape[1:], *(value.shape for value in present.values())
    )
    count = int(np.prod(shape))
    if count <= BLOCK:
        return answer(loop, effects)
    longest = int(np.argmax(shape))
    length, behind = shape[longest], len(shape) - longest
    step = max(1, BLOCK * length // count)
    found: list[tuple[NDArray[Any], ...]] = []
    for start in range(0, length, step):
        part = slice(start, start + step)
        chosen = {name: _part(value, part, behind) for name, value in present.items()}
        found.append(answered(answer, _loops(loop, part, behind), Effects(**chosen)))
    return tuple(np.concatenate(parts, axis=-behind) for parts in zip(*found, strict=True))


def _part(whole: FloatArray, part: slice, behind: int, leading: int = 0) -> FloatArray:
    """A part of an array along the axis that is so many from its end, if it is as long there.

    Leading axes are not of the loops: powers.
    """
    if whole.ndim - leading < behind or whole.shape[-behind] == 1:
        return whole
    return whole[(..., part, *(slice(None),) * (behind - 1))]


def _loops(loop: Loop, part: slice, behind: int) -> Loop:
    """Some of the loops of an array."""

    def rows(whole: Any) -> Any:
        """Those of arrays and polynomials, in tuples however deep."""
        if whole is None or isinstance(whole, int):
            return whole
        if isinstance(whole, Polynomial):
            return Polynomial(value=rows(whole.value), size=rows(whole.size))
        if hasattr(whole, "_make"):
            return whole._make(map(rows, whole))
        if isinstance(whole, tuple):
            return tuple(map(rows, cast("tuple[Any, ...]", whole)))
        return _part(whole, part, behind, leading=1)

    one, two, three = (_part(scale, part, behind) for scale in loop.scales)
    return replace(
        loop,
        terms=rows(loop.terms),
        sizes=rows(loop.sizes),
        transfer=rows(loop.transfer),
        scales=(one, two, three),
        factors=rows(loop.factors),
    )
