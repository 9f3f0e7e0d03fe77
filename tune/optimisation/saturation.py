"""Moments that push on one side only or are cut, as far as they are proved absolutely stable.

The linear loop is no yardstick for them: without its damper, or cut at a force, a spring is what it
is alone (docs/theory.md, 10). One file: multipliers and sizes are found in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification import round_to_digits
from tune.documents.certified import AbsoluteStability, Multiplier
from tune.documents.scene import Margin
from tune.optimisation.backends import Backend
from tune.optimisation.limits import is_feasible
from tune.optimisation.nash import largest_product
from tune.optimisation.one_sided import ROOM, AllFound, ProvedGain, search_gain, split_moment
from tune.optimisation.problem import Moment, Problem
from tune.stability.absolute import gain_slopes
from tune.stability.responses import Responses

FloatArray = NDArray[np.float64]

#: What of a gain beyond the margin is not claimed, relative.
_SHAVED = 2e-2
#: A constraint counts as at most this far from its limit, in the logarithm of the gain.
_FAR = 5.0
#: Turns of multipliers and sizes; two or three are usual.
_TURNS = 4
#: By how much a rank counts before the next.
_RANK = 100.0
#: Times that sizes are taken back, each of which comes closer.
_RETREATS = 12


def scale_to_feasible(problem: Problem, sizes: FloatArray) -> FloatArray:
    """Sizes at which every one-sided moment keeps the margin, its springs and dampers scaled alike.

    That is exact for one moment: its gain grows as its sizes fall. Sizes are 0 where none is safe.

    Sizes have shape (unknowns,), SI units, before and after.
    """
    sizes = sizes.copy()
    least = problem.margin.gain * (1 + ROOM)
    for _ in range(_RETREATS):
        kept = True
        for moment in saturation_constraints(problem):
            gain = search_gain(problem, moment, sizes).gain
            if gain < least:
                kept = False
                sizes[_members(problem, moment)] *= gain / least * (1 - ROOM / 10)
        if kept or not sizes.all():
            break
    return sizes


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation:
    """Absolute stability of moments with fixed multipliers, as constraints that solvers see.

    Attributes:
        problem: whose moments are asked.
        parts: moments, responses of a loop and its multiplier.
    """

    problem: Problem
    parts: tuple[tuple[Moment, Responses, Multiplier], ...]

    @classmethod
    def of(cls, problem: Problem, sizes: FloatArray, found: AllFound) -> Saturation:
        """With the multipliers that were found at some sizes, shape (unknowns,)."""
        parts: list[tuple[Moment, Responses, Multiplier]] = []
        for moment in saturation_constraints(problem):
            _, steady = split_moment(problem, moment, sizes)
            known = found[moment.elements]
            for loop in problem.loops.late:
                multiplier = known.held if loop.grounded else known.free
                if multiplier is not None:
                    parts.append((moment, Responses.of(loop, steady), multiplier))
        return cls(problem=problem, parts=tuple(parts))

    @property
    def size(self) -> int:
        """How many constraints these are."""
        return sum(len(responses.position) for _, responses, _ in self.parts)

    def at(self, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Constraints, shape (constraints,), and their slopes to log-sizes, (constraints, n)."""
        least = np.log(self.problem.margin.gain * (1 + ROOM))
        values: list[FloatArray] = []
        slopes: list[FloatArray] = []
        for moment, responses, multiplier in self.parts:
            switched, _ = split_moment(self.problem, moment, sizes)
            found = gain_slopes(responses, switched, multiplier)
            slope = np.zeros((found.gain.size, sizes.size))
            for row, members in zip(found.slopes, moment.members, strict=True):
                mine = [i for i in members if self.problem.unknowns[i].sign > 0]
                total = float(sum(sizes[i] for i in mine))
                for i in mine:
                    slope[:, i] = -row * sizes[i] / total
            values.append(np.clip(least - np.log(found.gain), -_FAR, _FAR))
            slopes.append(slope)
        return np.concatenate(values), np.concatenate(slopes)


def absolutely_stable(
    problem: Problem, starts: Sequence[FloatArray], backends: Sequence[Backend]
) -> tuple[FloatArray, AllFound]:
    """The largest product found at which every moment that asks for it is absolutely stable.

    Multipliers and sizes in turn: those that were the best at some sizes bound the next. Sizes are
    rounded to six digits.

    All sizes have shape (unknowns,), SI units.

    Args:
        problem: with moments that ask for it.
        starts: sizes, the optimum without among them.
        backends: solvers that know constraints with slopes of their own.
    """
    back = [scale_to_feasible(problem, sizes) for sizes in starts]
    best = max(back, key=lambda sizes: _product(problem, sizes))
    unbound = any(np.array_equal(best, sizes) for sizes in starts[:1])
    if len(problem.unknowns) > 1 and not unbound and np.all(best >= problem.low):
        for _ in range(_TURNS):
            more = Saturation.of(problem, best, search_gains(problem, best))
            answer = largest_product(problem, backends, [best * (1 - ROOM)], [more]).sizes
            if answer is None:
                break
            answer = scale_to_feasible(problem, answer)
            gained = _product(problem, answer) - _product(problem, best)
            if gained > 0:
                best = answer
            if not gained > ROOM:
                break
    grown = _grown(problem, best)
    if _product(problem, grown) > _product(problem, best):
        best = grown
    best = np.array([_floored(float(size)) for size in best])
    return best, search_gains(problem, best)


def _grown(problem: Problem, sizes: FloatArray) -> FloatArray:
    """Springs and dampers scaled alike to what absolute stability leaves, where that is allowed."""
    found = search_gains(problem, sizes)
    spare = min((each.gain for each in found.values()), default=0.0)
    trial = sizes.copy()
    members = sorted(
        {i for moment in saturation_constraints(problem) for i in _members(problem, moment)}
    )
    trial[members] *= max(spare / (problem.margin.gain * (1 + ROOM)), 1.0) * (1 - ROOM / 10)
    trial = scale_to_feasible(problem, np.minimum(trial, problem.high))
    return trial if is_feasible(problem, trial) else sizes


def _product(problem: Problem, sizes: FloatArray) -> float:
    """The weighed sum of the logarithms of steps, the first ranks far before the next."""
    return float(
        sum(
            unknown.weight * _RANK**-unknown.level * np.log(unknown.steps(float(size)))
            if size >= unknown.low
            else -_FAR
            for unknown, size in zip(problem.unknowns, sizes, strict=True)
        )
    )


def _floored(size: float) -> float:
    """Rounded to six digits towards nothing."""
    if size <= 0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(size)) - 5)
    return round_to_digits(float(np.floor(size / unit) * unit))


def search_gains(problem: Problem, sizes: FloatArray) -> AllFound:
    """`search_gain` of every moment that is one-sided.

    Sizes have shape (unknowns,), SI units.
    """
    return {
        moment.elements: search_gain(problem, moment, sizes)
        for moment in saturation_constraints(problem)
    }


def saturation_constraints(problem: Problem) -> list[Moment]:
    """The moments that must be absolutely stable."""
    return [moment for moment in problem.moments if moment.absolute]


def saturated_unknowns(problem: Problem, found: AllFound) -> frozenset[int]:
    """Unknowns of the moments that have no more than the margin of absolute stability."""
    return frozenset(
        index
        for moment in saturation_constraints(problem)
        if found[moment.elements].gain < problem.margin.gain * (1 + 1.5 * ROOM)
        for index in _members(problem, moment)
    )


def _members(problem: Problem, moment: Moment) -> list[int]:
    """Springs and positive dampers of a moment."""
    stiffness, damping, _ = moment.members
    return [*stiffness, *(i for i in damping if problem.unknowns[i].sign > 0)]


def witness_of(found: ProvedGain, margin: Margin, slack: float) -> AbsoluteStability:
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
