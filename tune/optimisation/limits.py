"""Feasibility of settings, exact: do they keep every limit, and with which margins.

One file: every limit that a setting has to keep, asked in one place.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import Effects
from tune.optimisation.problem import Moment, Problem
from tune.rendering.ripple import force_ripple
from tune.stability.search import CLOSE
from tune.stability.verdict import is_stable, safe_gain, safe_up_to

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def worst_gain(problem: Problem, moment: Moment, sizes: FloatArray, *, late: bool = True) -> float:
    """Largest g such that every gain in (0, g) is stable at every corner and delay.

    Args:
        problem: loops and margin.
        moment: the elements felt.
        sizes: of the unknowns, shape (unknowns,).
        late: with the margin's extra delay, or at the device's own delay alone.
    """
    if moment.lone is not None:
        unknown = problem.unknowns[moment.lone]
        end = problem.loops.end_alone(unknown.effect, unknown.sign, late=late)
        return end / float(sizes[moment.lone])
    effects = problem.effects(moment, sizes)
    loops = problem.loops.late if late else problem.loops.present
    return min(float(np.min(safe_gain(loop, effects))) for loop in loops)


def least_margin_loops(
    problem: Problem, sizes: FloatArray, *, broken: bool = False
) -> Iterator[tuple[int, int]]:
    """(loop of ``problem.loops.late``, column) of the least margin of each moment and loop.

    Sizes have shape (unknowns,), SI units.

    Args:
        problem: loops and margin.
        sizes: of the unknowns.
        broken: only where the margin is not kept.
    """
    found: set[tuple[int, int]] = set()
    for effects in _felt(problem, sizes[None]):
        for place, loop in enumerate(problem.loops.late):
            for gains in safe_gain(loop, effects)[0]:
                column = int(np.argmin(gains))
                if not broken or not gains[column] > problem.margin.gain * (1 + CLOSE):
                    found.add((place, column))
    yield from sorted(found)


def ripple(problem: Problem, moment: Moment, sizes: FloatArray) -> float | None:
    """Force ripple of one moment on the device at its best estimate, N rms; None if unknown.

    Sizes have shape (unknowns,), SI units.
    """
    if problem.limits.encoder_resolution is None:
        return None
    effects = problem.effects(moment, sizes)
    return float(force_ripple(problem.loops.nominal, effects, problem.limits.encoder_resolution))


def forces(moment: Moment, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(sustained, peak) force, N: K·penetration; the same plus |B|·speed + |M|·acceleration.

    Args:
        moment: the elements felt.
        sizes: shape (unknowns, ...).

    Returns:
        Each of the shape behind the unknowns.
    """
    parts = [
        np.asarray(
            sum(sizes[i] * (reach or 0.0) for i, reach in zip(indices, reaches, strict=True))
        )
        for indices, reaches in zip(moment.members, moment.reach, strict=True)
    ]
    return parts[0], parts[0] + parts[1] + parts[2]


def is_feasible(problem: Problem, sizes: FloatArray) -> bool:
    """True where forces, rendering, ripple and stability with the whole margin hold, exactly.

    Sizes have shape (unknowns,), SI units.
    """
    if not bool(keeps_linear_limits(problem, sizes)):
        return False
    if len(problem.unknowns) == 1:
        size = float(sizes[0])
        return size <= largest_quiet_size(problem, 0, size) * (1 + CLOSE) and all(
            stable_points(problem, sizes[None], problem.margin.gain)
        )
    return bool(feasible_points(problem, sizes[None])[0])


def feasible_points(problem: Problem, points: FloatArray) -> BoolArray:
    """Feasibility of many settings at once.

    Args:
        problem: with all its limits.
        points: sizes, shape (points, unknowns).

    Returns:
        of shape (points,).
    """
    good = passes_cheap_limits(problem, points)
    good[good] = stable_points(problem, points[good], problem.margin.gain)
    return good


def passes_cheap_limits(problem: Problem, points: FloatArray) -> BoolArray:
    """True where forces, rendering and ripple keep to their limits; stability is not looked at.

    Points have shape (points, unknowns), SI units; the answer has shape (points,).
    """
    good = keeps_linear_limits(problem, points.T).copy()
    good[good] = _ripple_allowed(problem, points[good])
    return good


def stable_in_doubles(problem: Problem, points: FloatArray) -> BoolArray:
    """Stability in a tenth of the time: asked for at the full gain only, shape (points,)."""
    stable = np.ones(len(points), dtype=np.bool_)
    for loop in problem.loops.late:
        for effects in _felt(problem, problem.margin.gain * points):
            stable &= np.all(is_stable(loop, effects), axis=(1, 2))
    return stable


def keeps_linear_limits(problem: Problem, sizes: FloatArray) -> BoolArray:
    """True where no moment asks for more force than there is, and all is felt as what it is.

    Args:
        problem: with its linear limits.
        sizes: shape (unknowns, ...).
    """
    return np.all(problem.linear.used(sizes) <= 1 + CLOSE, axis=0)


def largest_quiet_size(problem: Problem, index: int, top: float) -> float:
    """Size of one unknown, felt alone, up to which the ripple keeps to its limit; inf to the top.

    Up to where it is stable at all where that is less than ``top``: so far it is found only once.
    """
    limits, unknown = problem.limits, problem.unknowns[index]
    if limits.encoder_resolution is None:
        return np.inf
    end = problem.loops.end_alone(unknown.effect, unknown.sign, late=True) / problem.margin.gain
    return problem.loops.quiet_alone(
        unknown.effect,
        unknown.sign,
        resolution=limits.encoder_resolution,
        limit=limits.ripple,
        top=end if 0 < end < np.inf else top,
    )


def stable_points(
    problem: Problem, points: FloatArray, gain: float, *, late: bool = True
) -> BoolArray:
    """True where every moment is stable for every gain in (0, gain], late or not.

    Args:
        problem: with its loops.
        points: sizes, shape (points, unknowns).
        gain: the largest.
        late: with the margin's extra delay, or at the device's own delay alone.

    Returns:
        of shape (points,).
    """
    top = gain * (1 + CLOSE)
    if len(problem.unknowns) == 1:
        unknown = problem.unknowns[0]
        end = problem.loops.end_alone(unknown.effect, unknown.sign, late=late)
        return end > points[:, 0] * top
    good = np.ones(len(points), dtype=np.bool_)
    for loop in problem.loops.late if late else problem.loops.present:
        for effects in _felt(problem, points):
            good &= np.all(safe_up_to(loop, effects, top), axis=(1, 2))
    return good


def _ripple_allowed(problem: Problem, points: FloatArray) -> BoolArray:
    """True where the encoder ripple of all but meetings keeps to its limit; (points,)."""
    resolution = problem.limits.encoder_resolution
    good = np.ones(len(points), dtype=np.bool_)
    if resolution is not None:
        for effects in _felt(problem, points, meetings=False):
            noise = force_ripple(problem.loops.nominal, effects, resolution)[..., 0]
            good &= np.all(noise <= problem.limits.ripple * (1 + CLOSE), axis=1)
    return good


def _felt(problem: Problem, points: FloatArray, *, meetings: bool = True) -> Iterator[Effects]:
    """Effects of shape (points, moments, 1): of the moments with a spring, of those without.

    Within each, an effect that one moment lacks is zero in it, which is the same for all but a
    spring.
    """
    for sprung in (True, False):
        shares = problem.shares(sprung=sprung, meetings=meetings)
        if not len(shares) or not len(points):
            continue
        stiffness, damping, mass = (
            (points @ part.T)[..., None] if part.any() else None for part in shares.swapaxes(0, 1)
        )
        yield Effects(stiffness=stiffness, damping=damping, mass=mass)
