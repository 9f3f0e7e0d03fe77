"""Many devices with many effects, a block of points at a time.

Each point is computed for itself, number by number, so that what a single loop answers it answers
among a million too, to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tune.documents.scene import EFFECT_NAMES, Effects
from tune.loop.loop import Factors, Law, Loop
from tune.loop.polynomials import Polynomial

FloatArray = NDArray[np.float64]

#: Points of a block: some megabytes of arrays, whatever the number of all.
BLOCK = 4096

_Answer = Callable[[Loop, Effects], tuple[NDArray[Any], ...]]


def in_blocks(
    answer: _Answer, loop: Loop, effects: Effects, shape: tuple[int, ...]
) -> tuple[NDArray[Any], ...]:
    """What a function answers for each point of loop and effects, arrays of their broadcast shape.

    Many points are parted along the longest axis, and parts that are still too many again.
    """
    count = int(np.prod(shape))
    if count <= BLOCK:
        return answer(loop, effects)
    longest = int(np.argmax(shape))
    length, behind = shape[longest], len(shape) - longest
    step = max(1, BLOCK * length // count)
    found: list[tuple[NDArray[Any], ...]] = []
    for start in range(0, length, step):
        part = slice(start, start + step)
        given = {name: getattr(effects, name) for name in EFFECT_NAMES}
        chosen = {name: _part(x, part, behind) for name, x in given.items() if x is not None}
        size = (*shape[:longest], min(step, length - start), *shape[longest + 1 :])
        found.append(in_blocks(answer, _loops(loop, part, behind), Effects(**chosen), size))
    return tuple(np.concatenate(parts, axis=-behind) for parts in zip(*found, strict=True))


def _part(array: Any, part: slice, behind: int, leading: int = 0) -> FloatArray:
    """A part of an array along the axis that is so many from its end, if it is as long there.

    Leading axes are not of the loops: powers.
    """
    whole = np.asarray(array, float)
    if whole.ndim - leading < behind or whole.shape[-behind] == 1:
        return whole
    return whole[(..., part, *(slice(None),) * (behind - 1))]


def _loops(loop: Loop, part: slice, behind: int) -> Loop:
    """Some of the loops of an array."""

    def rows(coefficients: FloatArray) -> FloatArray:
        return _part(coefficients, part, behind, leading=1)

    def polynomial(whole: Polynomial) -> Polynomial:
        return Polynomial(value=rows(whole.value), size=rows(whole.size))

    factors = loop.factors
    if factors is not None:
        hold, law = factors
        estimators = [
            each._replace(
                numerator=polynomial(each.numerator), factors=tuple(map(polynomial, each.factors))
            )
            for each in (law.velocity, law.acceleration)
        ]
        blocks = tuple((polynomial(over), polynomial(under)) for over, under in hold.blocks)
        factors = Factors(hold._replace(blocks=blocks), Law(*law[:3], *estimators))
    one, two, three = (_part(scale, part, behind) for scale in loop.scales)
    return replace(
        loop,
        terms=loop.terms._make(map(rows, loop.terms)),
        sizes=loop.sizes._make(map(rows, loop.sizes)),
        transfer=loop.transfer._make(map(rows, loop.transfer)),
        scales=(one, two, three),
        factors=factors,
    )
