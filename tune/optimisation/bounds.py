"""How large one unknown may be under each kind of limit, the others as they are.

One file: each kind of limit bounds the same unknown.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.loop.loop import Loop
from tune.optimisation.limits import largest_quiet_size, ripple, stable_points
from tune.optimisation.problem import Moment, Problem
from tune.stability.search import CLOSE, last_within
from tune.stability.verdict import stable_intervals

FloatArray = NDArray[np.float64]

#: Halvings in a search along one coordinate: 2^-50 of the range.
_HALVINGS = 50


def largest_allowed(problem: Problem, sizes: FloatArray, index: int) -> float:
    """The largest size of one unknown that every limit allows, grown from what is given.

    Sizes have shape (unknowns,), SI units, and so has the answer.
    """
    most = min(problem.unknowns[index].high, linear_bound(problem, sizes, index))
    least = min(most, *stable_bounds(problem, sizes, [index], [most], problem.margin.gain))
    return min(least, ripple_bound(problem, sizes, index, least))


def linear_bound(problem: Problem, sizes: FloatArray, index: int) -> float:
    """Size at which force is used up or something else is felt; inf where nothing is known.

    Sizes have shape (unknowns,), SI units; the answer is in the unit of the unknown.
    """
    return min(problem.linear.bounds(sizes, index).values(), default=np.inf)


def ripple_bound(problem: Problem, sizes: FloatArray, index: int, top: float) -> float:
    """Size up to which the ripple keeps to its limit, from what is given; inf if to the top.

    Sizes have shape (unknowns,), SI units; top and answer are in the unit of the unknown.
    """
    if top <= 0 or problem.limits.encoder_resolution is None:
        return np.inf
    if len(problem.unknowns) == 1:
        return largest_quiet_size(problem, index, top)
    moments = [
        m
        for m in problem.moments
        if not m.meeting and any(index in members for members in m.members)
    ]
    if not moments:
        return np.inf
    trial = sizes.copy()

    def noise(size: float) -> float:
        trial[index] = size
        return max(ripple(problem, moment, trial) or 0.0 for moment in moments)

    return last_within(noise, problem.limits.ripple, top, float(sizes[index]))


def stable_bounds(
    problem: Problem,
    sizes: FloatArray,
    indices: Sequence[int],
    tops: Sequence[float],
    gain: float,
    *,
    late: bool = True,
) -> list[float]:
    """Size up to which each unknown, others as given, is stable for every gain in (0, gain].

    The closed form in the coordinate at the full gain is the answer wherever the ray below it is
    stable too; where it is not (a second stable interval), the end of what is safe is halved to.
    Where others need the unknown, as a spring may need a damper, it must not be nothing at first.

    Sizes have shape (unknowns,), SI units; tops and answers are in the units of their unknowns.

    Args:
        problem: with its loops.
        sizes: of all unknowns, from where each one grows.
        indices: the unknowns to be told about.
        tops: largest size of each that matters; inf is the answer where that is stable.
        gain: the largest.
        late: with the margin's extra delay, or at the device's own delay alone.
    """
    if len(problem.unknowns) == 1:
        unknown = problem.unknowns[0]
        end = problem.loops.end_alone(unknown.effect, unknown.sign, late=late) / gain
        return [np.inf if end > top * (1 + CLOSE) else end * (1 - 4 * CLOSE) for top in tops]
    bounds = np.full(len(indices), np.inf)
    trials = np.repeat(sizes[None], len(indices), axis=0)
    trials[np.arange(len(indices)), indices] = tops
    short = np.flatnonzero(~stable_points(problem, trials, gain, late=late))
    if not short.size:
        return bounds.tolist()
    chosen = [indices[int(place)] for place in short]
    ends = _ends(problem, sizes, chosen, gain, late=late) * (1 - 4 * CLOSE)
    bounds[short] = np.clip(ends, 0.0, np.array(tops)[short])
    trials = trials[short]
    trials[np.arange(short.size), chosen] = bounds[short]
    good = stable_points(problem, trials, gain, late=late)
    for place, index, fine in zip(short, chosen, good, strict=True):
        if bounds[place] > 0 and not fine:
            top = float(bounds[place])
            bounds[place] = _halved(problem, sizes, index, top, gain, late=late)
    return bounds.tolist()


def _ends(
    problem: Problem, sizes: FloatArray, indices: Sequence[int], gain: float, *, late: bool
) -> FloatArray:
    """Where each unknown leaves the stable interval it is in, at the full gain alone."""
    ends = np.full(len(indices), np.inf)
    cases = [
        (row, moment, place)
        for row, index in enumerate(indices)
        for moment in problem.moments
        for place, members in enumerate(moment.members)
        if index in members
    ]
    loops = problem.loops.late if late else problem.loops.present
    for sprung in (True, False):
        chosen = [case for case in cases if bool(case[1].members[0]) == sprung]
        if not chosen:
            continue
        bases: list[float] = []
        others: list[list[float]] = []
        for row, moment, place in chosen:
            base, rest = _others(problem, moment, sizes, indices[row], place)
            bases.append(base)
            others.append(rest)
        signs = np.array([problem.unknowns[indices[row]].sign for row, _, _ in chosen])
        starts = gain * (signs * np.array(bases) + sizes[[indices[row] for row, _, _ in chosen]])
        places = [place for _, _, place in chosen]
        for loop in loops:
            limits = _ends_at(loop, gain * np.array(others), places, signs, starts, free=not sprung)
            sizes_at = limits / gain - signs * np.array(bases)
            for (row, _, _), end in zip(chosen, sizes_at, strict=True):
                ends[row] = min(ends[row], end)
    return ends


def _others(
    problem: Problem, moment: Moment, sizes: FloatArray, index: int, place: int
) -> tuple[float, list[float]]:
    """What other elements have of the same effect, and the totals of the other effects."""
    totals = [
        float(sum(problem.unknowns[i].sign * sizes[i] for i in members if i != index))
        for members in moment.members
    ]
    base = totals[place]
    totals[place] = 0.0
    return base, totals


def _ends_at(
    loop: Loop,
    others: FloatArray,
    places: list[int],
    signs: FloatArray,
    starts: FloatArray,
    *,
    free: bool,
) -> FloatArray:
    """Least upper end over the corners of one loop, of the interval above each start.

    Args:
        loop: of shape (corners,).
        others: totals of the effects that stay, (cases, 3).
        places: which effect varies, by case.
        signs: of what varies.
        starts: of the total of the effect that varies, from where it grows.
        free: no spring is there.

    Returns:
        of shape (cases,); -inf where the start is not stable.
    """
    stiffness, damping, mass = (column[:, None] for column in others.T)
    fixed, fixed_size = loop.polynomial(Effects(stiffness=stiffness, damping=damping, mass=mass))
    terms, sizes = (
        np.stack([part.alpha, part.beta, part.gamma])[places] for part in (loop.terms, loop.sizes)
    )
    scales = np.stack([np.broadcast_to(scale, terms.shape[2:]) for scale in loop.scales])[places]
    varied = np.moveaxis(terms * scales[:, None] * signs[:, None, None], 0, 1)
    varied_size = np.moveaxis(sizes * scales[:, None], 0, 1)
    skip = loop.lowest_power(Effects(stiffness=None if free else stiffness))
    low, high = stable_intervals(fixed[skip:], varied[skip:], fixed_size[skip:], varied_size[skip:])
    start = starts[:, None]
    inside = (low <= np.maximum(start, 0.0)) & (high > start)
    return np.min(np.max(np.where(inside, high, -np.inf), axis=0), axis=1)


def _halved(
    problem: Problem, sizes: FloatArray, index: int, top: float, gain: float, *, late: bool
) -> float:
    """The end of what is stable from what is given on, below a size that is not."""
    trial = sizes.copy()

    def stable(size: float) -> bool:
        trial[index] = size
        return bool(stable_points(problem, trial[None], gain, late=late)[0])

    low, high = float(sizes[index]), top
    if not (0 < low < high and stable(low)):
        low = 0.0
    for _ in range(_HALVINGS):
        if high < problem.unknowns[index].low or high - low <= CLOSE * high:
            break
        middle = high / 8 if low == 0 else (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
