"""Exact answers about one setting of a problem: is it allowed, and what bounds each effect."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from tune.effects import EFFECT_NAMES, Effects
from tune.loop import LONGEST_DELAY
from tune.problem import Moment, Problem
from tune.ripple import force_ripple
from tune.stability import safe_gain, stable_values

FloatArray = NDArray[np.float64]

#: Gains and sizes this close to a boundary, relative, are taken to be on it: the verdicts decide
#: at 1e-9, and a written profile is rounded to six digits anyway.
CLOSE = 1e-9
#: Halvings in a search along one coordinate: 2^-50 of the range.
_HALVINGS = 50
#: Samples to which a delay margin is looked for; it is claimed in tenths.
_DELAY_STEP = 0.01


def worst_gain(problem: Problem, moment: Moment, sizes: FloatArray, *, late: bool = True) -> float:
    """Largest g such that every gain in (0, g) is stable at every corner and delay.

    Args:
        problem: loops and margin.
        moment: the elements felt.
        sizes: of the unknowns, shape (unknowns,).
        late: with the margin's extra delay, or at the device's own delay alone.
    """
    effects = problem.effects(moment, sizes)
    loops = problem.late if late else problem.present
    return min(float(np.min(safe_gain(loop, effects))) for loop in loops)


def weakest(
    problem: Problem, sizes: FloatArray, *, broken: bool = False
) -> Iterator[tuple[int, int]]:
    """(loop of ``problem.late``, column) of the least margin of each moment and loop.

    Args:
        problem: loops and margin.
        sizes: of the unknowns.
        broken: only where the margin is not kept.
    """
    found: set[tuple[int, int]] = set()
    for moment in problem.moments:
        effects = problem.effects(moment, sizes)
        for place, loop in enumerate(problem.late):
            gains = safe_gain(loop, effects)
            column = int(np.argmin(gains))
            if not broken or not gains[column] > problem.margin.gain * (1 + CLOSE):
                found.add((place, column))
    yield from sorted(found)


def extra_delay(problem: Problem, moment: Moment, sizes: FloatArray, most: int) -> float:
    """Extra samples of delay up to which every gain in (0, 1] is stable at every corner; to most.

    Looked for at whole samples and, in the first that fails, halved to a hundredth; what lies
    between is for the certificate to prove.
    """
    effects = problem.effects(moment, sizes)

    def holds(extra: float) -> bool:
        return all(
            float(np.min(safe_gain(loop, effects))) > 1 + CLOSE
            for loop in problem.region.latest(problem.filters, extra)
        )

    box = problem.region.box
    most = min(most, int(LONGEST_DELAY - box.delay[1] / box.sample_time[0]))
    whole = next((extra for extra in range(1, most + 1) if not holds(extra)), None)
    if whole is None:
        return float(most)
    low, high = whole - 1.0, float(whole)
    while high - low > _DELAY_STEP:
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def ripple(problem: Problem, moment: Moment, sizes: FloatArray) -> float | None:
    """Force ripple of one moment on the device at its best estimate, N rms; None if unknown."""
    if problem.limits.encoder_resolution is None:
        return None
    effects = problem.effects(moment, sizes)
    return float(force_ripple(problem.nominal, effects, problem.limits.encoder_resolution))


def forces(moment: Moment, sizes: FloatArray) -> tuple[float, float]:
    """(sustained, peak) force, N: K·penetration; the same plus |B|·speed + |M|·acceleration."""
    parts = [
        float(sum(sizes[i] * reach for i, reach in zip(indices, reaches, strict=True)))
        for indices, reaches in zip(moment.members, moment.reach, strict=True)
    ]
    return parts[0], sum(parts)


def allowed(problem: Problem, sizes: FloatArray) -> bool:
    """True where forces, ripple and stability with the whole margin all hold, exactly."""
    return (
        forces_allowed(problem, sizes)
        and stable_with_margin(problem, sizes, problem.margin.gain)
        and ripple_allowed(problem, sizes)
    )


def forces_allowed(problem: Problem, sizes: FloatArray) -> bool:
    """True where no moment asks for more force than the actuator has."""
    limits = problem.limits
    for moment in problem.moments:
        sustained, peak = forces(moment, sizes)
        if limits.continuous_force is not None and sustained > limits.continuous_force * (
            1 + CLOSE
        ):
            return False
        if limits.peak_force is not None and peak > limits.peak_force * (1 + CLOSE):
            return False
    return True


def ripple_allowed(problem: Problem, sizes: FloatArray) -> bool:
    """True where the encoder ripple of every moment keeps to its limit."""
    for moment in problem.moments:
        value = ripple(problem, moment, sizes)
        if value is not None and not value <= problem.limits.ripple * (1 + CLOSE):
            return False
    return True


def stable_with_margin(
    problem: Problem, sizes: FloatArray, gain: float, *, late: bool = True
) -> bool:
    """True where every moment is stable for every gain in (0, gain], late or not."""
    return all(
        worst_gain(problem, moment, sizes, late=late) > gain * (1 + CLOSE)
        for moment in problem.moments
    )


def largest_allowed(problem: Problem, sizes: FloatArray, index: int) -> float:
    """The largest size of one unknown that every limit allows, the others as given."""
    high = problem.unknowns[index].high
    force = _largest(problem, sizes, index, lambda x: forces_allowed(problem, x))
    stable = largest_stable(problem, sizes, index, problem.margin.gain)
    least = min(force, stable, high)
    return min(
        least, _largest(problem, sizes, index, lambda x: ripple_allowed(problem, x), top=least)
    )


def bounds_of(problem: Problem, sizes: FloatArray, index: int) -> dict[str, float]:
    """The largest size of one unknown under each kind of limit alone, the others as given.

    Returns:
        by ``limited_by`` word, inf where a limit would allow more than is sensible: wanted or
        range, force, ripple, and the three of stability, each at most the one before.
    """
    unknown = problem.unknowns[index]
    gain = problem.margin.gain
    bounds = {
        "force": _largest(problem, sizes, index, lambda x: forces_allowed(problem, x)),
        "stability": largest_stable(problem, sizes, index, 1.0, late=False),
        "gain-margin": largest_stable(problem, sizes, index, gain, late=False),
        "delay-margin": largest_stable(problem, sizes, index, gain),
    }
    least = min(*bounds.values(), unknown.high)
    bounds["ripple"] = _largest(
        problem, sizes, index, lambda x: ripple_allowed(problem, x), top=least
    )
    word = {"value": "wanted", "range": "range"}.get(unknown.wish.kind)
    if word is not None:
        bounds[word] = unknown.high
    elif unknown.sign < 0:
        bounds["gain-margin"] = min(bounds["gain-margin"], unknown.high)
    return bounds


def largest_stable(
    problem: Problem, sizes: FloatArray, index: int, gain: float, *, late: bool = True
) -> float:
    """Largest size of one unknown, others as given, stable for every gain in (0, gain]; or inf.

    The closed form in the coordinate at the full gain is the answer wherever the ray below it is
    stable too; where it is not (a second stable interval), the end of what is safe is halved to.
    """
    unknown = problem.unknowns[index]
    place = EFFECT_NAMES.index(unknown.effect)
    answer = unknown.high
    for moment in problem.moments:
        if index not in moment.members[place]:
            continue
        rest = sizes.copy()
        rest[index] = 0.0
        effects = problem.effects(moment, rest)
        others = Effects(
            **{
                name: None if value is None or name == unknown.effect else gain * value
                for name, value in zip(EFFECT_NAMES, effects.arrays(), strict=True)
            }
        )
        base = 0.0 if len(moment.members[place]) == 1 else _value(effects, place)
        for loop in problem.late if late else problem.present:
            low, high = stable_values(loop, unknown.effect, others, sign=unknown.sign)
            # Intervals in the total of this effect, of which ``base`` belongs to other elements.
            start = unknown.sign * gain * base
            inside = (low <= max(start, 0.0)) & (high > start)
            ends = np.max(np.where(inside, high, -np.inf), axis=0, initial=-np.inf)
            answer = min(answer, float(np.min(ends)) / gain - unknown.sign * base)
    trial = sizes.copy()
    boundless = answer >= unknown.high
    trial[index] = unknown.high if boundless else max(answer, 0.0) * (1 - 4 * CLOSE)
    if trial[index] <= 0 or stable_with_margin(problem, trial, gain, late=late):
        return float("inf") if boundless else float(trial[index])
    return _largest(
        problem,
        sizes,
        index,
        lambda x: stable_with_margin(problem, x, gain, late=late),
        top=float(trial[index]),
    )


def _value(effects: Effects, place: int) -> float:
    value = effects.arrays()[place]
    return 0.0 if value is None else float(value)


def _largest(
    problem: Problem,
    sizes: FloatArray,
    index: int,
    holds: Callable[[FloatArray], bool],
    top: float | None = None,
) -> float:
    """Largest size up to ``top`` to which a limit holds from nothing on; inf if to the top."""
    trial = sizes.copy()
    trial[index] = problem.unknowns[index].high if top is None else top
    if holds(trial):
        return float("inf")
    low, high = 0.0, float(trial[index])
    start = min(float(sizes[index]), high)
    for step in range(_HALVINGS):
        middle = start if step == 0 and 0 < start < high else _between(low, high)
        trial[index] = middle
        if holds(trial):
            low = middle
        else:
            high = middle
        if high - low <= CLOSE * high:
            break
    return low


def _between(low: float, high: float) -> float:
    return high / 8 if low == 0 else (np.sqrt(low * high) if high > 2 * low else (low + high) / 2)
