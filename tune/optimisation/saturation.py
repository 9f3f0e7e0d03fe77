"""Moments that push on one side only, as far as they can be proved absolutely stable.

The linear loop is no yardstick for them: without its damper, or cut at a force, a spring is what it
is alone (docs/theory.md, 10).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.certified import AbsoluteStability, Multiplier
from tune.documents.effects import Effects
from tune.documents.scene import Margin
from tune.loop.loop import Loop
from tune.optimisation.problem import Moment, Problem
from tune.stability.absolute import absolute_gain
from tune.stability.multipliers import find_multiplier
from tune.stability.responses import Responses

FloatArray = NDArray[np.float64]

#: Kept on top of the margin, relative, for what lies between the corners of the box; and what of a
#: gain beyond it is not claimed.
_ROOM, _SHAVED = 2e-3, 2e-2
#: Beyond this gain a margin says nothing more.
_MOST_GAIN = 1000.0
#: Times that sizes are taken back, each of which comes closer.
_RETREATS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """The largest gain found for a moment, and the multipliers that give it.

    Attributes:
        gain: for the worst loop, free or held; 0 where none was found.
        free: for loops whose position nothing holds; None where there are none.
        held: for the others.
    """

    gain: float
    free: Multiplier | None = None
    held: Multiplier | None = None


#: By the elements of each moment that pushes on one side only.
AllFound = Mapping[tuple[str, ...], Found]


def found_gain(problem: Problem, moment: Moment, sizes: FloatArray) -> Found:
    """The gain up to which a moment is absolutely stable at every corner and delay of the margin.

    Args:
        problem: loops and margin.
        moment: one-sided.
        sizes: of the unknowns, shape (unknowns,).
    """
    if not problem.region.box.damping[0] > 0:
        return Found(gain=0.0)
    switched, steady = split(problem, moment, sizes)
    # What acts steadily is looked at up to the gain of the margin: nothing is claimed beyond it.
    gains = [_MOST_GAIN if steady is None else problem.margin.gain * (1 + 2 * _ROOM)]
    multipliers: dict[bool, Multiplier | None] = {}
    for loop in problem.loops.late:
        gain, multiplier = _at(loop, switched, steady)
        gains.append(gain)
        multipliers[loop.held] = multiplier
    return Found(gain=min(gains), free=multipliers.get(False), held=multipliers.get(True))


def split(problem: Problem, moment: Moment, sizes: FloatArray) -> tuple[Effects, Effects | None]:
    """(springs and positive dampers, masses and what is negative at the gain of the margin)."""
    signed = [u.sign * float(size) for u, size in zip(problem.unknowns, sizes, strict=True)]
    stiffness, damping, mass = ([signed[i] for i in members] for members in moment.members)
    positive = [value for value in damping if value > 0]
    negative = [value for value in damping if value < 0]
    gain = problem.margin.gain
    steady = None
    if negative or mass:
        steady = Effects(
            damping=gain * sum(negative) if negative else None,
            mass=gain * sum(mass) if mass else None,
        )
    return Effects(
        stiffness=sum(stiffness) if stiffness else None,
        damping=sum(positive) if positive else None,
    ), steady


def _at(loop: Loop, switched: Effects, steady: Effects | None) -> tuple[float, Multiplier | None]:
    responses = Responses.of(loop, steady)
    multiplier = find_multiplier(responses, switched)
    if multiplier is None:
        return 0.0, None
    return float(np.min(absolute_gain(responses, switched, multiplier))), multiplier


def taken_back(problem: Problem, sizes: FloatArray) -> FloatArray:
    """Sizes at which every one-sided moment keeps the margin, its springs and dampers scaled alike.

    That is exact for one moment: its gain grows as its sizes fall. Sizes are 0 where none is safe.
    """
    sizes = sizes.copy()
    least = problem.margin.gain * (1 + _ROOM)
    for _ in range(_RETREATS):
        kept = True
        for moment in asking(problem):
            gain = found_gain(problem, moment, sizes).gain
            if gain < least:
                kept = False
                sizes[_members(problem, moment)] *= gain / least * (1 - _ROOM / 10)
        if kept or not sizes.all():
            break
    return sizes


def all_found(problem: Problem, sizes: FloatArray) -> AllFound:
    """`found_gain` of every moment that is one-sided."""
    return {moment.elements: found_gain(problem, moment, sizes) for moment in asking(problem)}


def asking(problem: Problem) -> list[Moment]:
    """The moments that must be absolutely stable."""
    return [moment for moment in problem.moments if moment.one_sided and any(moment.members)]


def saturated(problem: Problem, found: AllFound) -> frozenset[int]:
    """Unknowns of the moments that have no more than the margin of absolute stability."""
    return frozenset(
        index
        for moment in asking(problem)
        if found[moment.elements].gain < problem.margin.gain * (1 + 1.5 * _ROOM)
        for index in _members(problem, moment)
    )


def _members(problem: Problem, moment: Moment) -> list[int]:
    """Springs and positive dampers of a moment."""
    stiffness, damping, _ = moment.members
    return [*stiffness, *(i for i in damping if problem.unknowns[i].sign > 0)]


def witness_of(found: Found, margin: Margin, slack: float) -> AbsoluteStability:
    """What is claimed of a moment: multipliers, and the gain to three decimals downwards.

    Args:
        found: for it.
        margin: that is kept.
        slack: part of a margin beyond it that is not claimed.
    """
    gain = float(np.floor(found.gain * (1 - max(_SHAVED, slack)) * 1000) / 1000)
    return AbsoluteStability(
        gain=max(gain, margin.gain),
        extra_delay_samples=float(margin.extra_delay_samples),
        free=found.free,
        held=found.held,
        covers=(),
    )
