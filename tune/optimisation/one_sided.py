"""One-sided moments: the gain up to which they are proved absolutely stable.

Multipliers are found once for sizes in about one ratio and kept with the loops: the gain falls as
sizes grow, whatever the multiplier.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.certified import Multiplier
from tune.documents.effects import Effects
from tune.loop.loop import Loop
from tune.optimisation.loops import Loops
from tune.optimisation.problem import Moment, Problem
from tune.stability.absolute import absolute_gain
from tune.stability.multipliers import find_multiplier
from tune.stability.responses import Responses

FloatArray = NDArray[np.float64]

#: Kept on top of the margin, relative, for what lies between the corners of the box.
ROOM = 2e-3
#: Beyond this gain a margin says nothing more.
_MOST_GAIN = 1000.0
#: Sizes in ratios that differ by less, relative, share a multiplier; less than this is nothing.
_ALIKE, _TINY = 1e-2, 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvedGain:
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
AllFound = Mapping[tuple[str, ...], ProvedGain]


def search_gain(problem: Problem, moment: Moment, sizes: FloatArray) -> ProvedGain:
    """The gain up to which a moment is absolutely stable at every corner and delay of the margin.

    Args:
        problem: loops and margin.
        moment: one-sided or cut.
        sizes: of the unknowns, shape (unknowns,).
    """
    if not problem.region.box.damping[0] > 0:
        return ProvedGain(gain=0.0)
    switched, steady = split_moment(problem, moment, sizes)
    # What acts steadily is looked at up to the gain of the margin: nothing is claimed beyond it.
    gains = [_MOST_GAIN if steady is None else problem.margin.gain * (1 + 2 * ROOM)]
    multipliers: dict[bool, Multiplier | None] = {}
    for loop in problem.loops.late:
        gain, multiplier = _at(problem.loops, loop, switched, steady)
        gains.append(gain)
        multipliers[loop.grounded] = multiplier
    return ProvedGain(gain=min(gains), free=multipliers.get(False), held=multipliers.get(True))


def split_moment(
    problem: Problem, moment: Moment, sizes: FloatArray
) -> tuple[Effects, Effects | None]:
    """(springs and positive dampers, masses and what is negative at the gain of the margin).

    Sizes have shape (unknowns,), SI units.
    """
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


def _at(
    loops: Loops, loop: Loop, switched: Effects, steady: Effects | None
) -> tuple[float, Multiplier | None]:
    """The gain of one of the loops, with the multiplier that is best for sizes in about this ratio.

    A gain changes by the multiplier to second order only, and all of it is exact for the one taken.
    """
    responses = Responses.of(loop, steady)
    multiplier = loops.multiplier(
        (loop.grounded, _direction(switched), None if steady is None else _sizes(steady)),
        lambda: find_multiplier(responses, switched),
    )
    if multiplier is None:
        return 0.0, None
    return float(np.min(absolute_gain(responses, switched, multiplier))), multiplier


def _direction(effects: Effects) -> tuple[int, ...]:
    """Which there are, and their ratios to the first in logarithmic parts."""
    logs = _logs(effects)
    (_, first), *_ = logs
    return tuple(part for place, log in logs for part in (place, round((log - first) / _ALIKE)))


def _sizes(effects: Effects) -> tuple[int, ...]:
    """Which there are, and their sizes in logarithmic parts."""
    return tuple(part for place, log in _logs(effects) for part in (place, round(log / _ALIKE)))


def _logs(effects: Effects) -> list[tuple[int, float]]:
    """(place, logarithm of the size) of every effect that is there."""
    return [
        (place, float(np.log(max(abs(float(value)), _TINY))))
        for place, value in enumerate(effects.arrays())
        if value is not None
    ]
