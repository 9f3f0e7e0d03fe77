"""Sums with clamps that may be reached, as far as they are proved absolutely stable.

Sizes are found by linear limits; here each sum is given the multipliers that prove it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import round_to_digits
from tune.documents.certified import AbsoluteStability, Channel, Multiplier, Tap
from tune.documents.effects import EFFECT_NAMES, EffectName, Effects
from tune.documents.scene import Margin
from tune.optimisation.problem import ROOM, Moment, Problem
from tune.optimisation.zames_falb import find_multiplier
from tune.stability.absolute import Nonlinearities, Responses, absolute_gain

FloatArray = NDArray[np.float64]

#: What of a gain beyond the margin is not claimed, relative; beyond the most a margin says nothing.
_SHAVED, _MOST_GAIN = 2e-2, 1000.0
#: Parts of the gain that is asked for, at which a multiplier is looked for in turn.
_PARTS = (1.02, 1.0, 0.9, 0.7, 0.4)
#: Digits to which B/K and M/K agree where clamps act on one signal, and those of a weight.
_ALIKE, _DIGITS = 9, 6
#: Taps of less than these parts of the largest of their channel are left out, if so much of the
#: gain is kept; slopes of a tap of one sample, as parts of that of all of them.
_FAINT, _KEPT, _FIRST_TAP = (0.3, 0.03, 1e-3, 0.0), 0.99, (0.03, 1e-3)


#: Gains that were found, 0 for none, by the elements of moments that must be absolutely stable.
AllFound = Mapping[tuple[str, ...], AbsoluteStability]


def prove_moments(problem: Problem, sizes: FloatArray, known: AllFound | None = None) -> AllFound:
    """`search_gain` of every moment that must be absolutely stable and is part of no other.

    Sizes have shape (unknowns,), SI units; what is known is of others.
    """
    known = known or {}
    moments = {each.elements: each for each in problem.moments if each.absolute}
    return {
        names: search_gain(problem, moments[names], sizes, known.get(names))
        for names in largest_sets(moments)
    }


def largest_sets(moments: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Those that are part of no other: what proves one proves its parts."""
    sets = {frozenset(each): each for each in moments}
    return [names for each, names in sets.items() if not any(each < other for other in sets)]


def search_gain(
    problem: Problem, moment: Moment, sizes: FloatArray, known: AbsoluteStability | None = None
) -> AbsoluteStability:
    """The gain up to which a moment is absolutely stable at every corner and delay of the margin.

    Sizes have shape (unknowns,); what is known are multipliers of others, which may do.
    """
    margin, box, least = problem.margin, problem.region.box, problem.proved_gain
    parts, steady = nonlinearities(problem, moment, sizes)
    # What acts steadily is looked at up to the gain of the margin: nothing is claimed beyond it.
    gains = [margin.gain * (1 + 2 * ROOM) if steady else _MOST_GAIN]
    multipliers: dict[bool, Multiplier | None] = {}
    late = box.delay[1] / box.sample_time[0] + margin.extra_delay_samples
    for loop in problem.loops.between(margin.extra_delay_samples) if box.damping[0] > 0 else ():
        responses = Responses.of(loop, steady)
        multiplier = known and (known.held if loop.grounded else known.free)
        gain = 0.0 if multiplier is None else _least_gain(responses, parts, multiplier)
        for part in () if gain >= least else _PARTS:
            multiplier = find_multiplier(responses, parts, part * least, late)
            if multiplier is not None:
                gain = _least_gain(responses, parts, multiplier)
                multiplier, gain = _with_few_taps(responses, parts, multiplier, gain, least)
                break
        gains.append(gain)
        multipliers[loop.grounded] = multiplier
    return AbsoluteStability(
        gain=min(gains) if multipliers else 0.0,
        extra_delay_samples=float(margin.extra_delay_samples),
        free=multipliers.get(False),
        held=multipliers.get(True),
        covers=(),
    )


def _least_gain(responses: Responses, parts: Nonlinearities, multiplier: Multiplier) -> float:
    return float(np.min(absolute_gain(responses, parts, multiplier)))


def _with_few_taps(
    responses: Responses, parts: Nonlinearities, multiplier: Multiplier, gain: float, least: float
) -> tuple[Multiplier, float]:
    """The multiplier without the taps that hardly change its gain, and the gain it has then.

    Each clamp keeps some of a tap of one sample, without which M may vanish at some frequency, as
    taps of 3 and 6 samples do at θ = 2π/3: a proof would then have nothing to show.
    """
    for part, first in product(_FAINT, _FIRST_TAP):
        channels = tuple(_thinned(channel, part, first) for channel in multiplier.channels)
        fewer = Multiplier(channels=channels)
        left = _least_gain(responses, parts, fewer)
        if left >= _KEPT * gain and (left >= least or gain < least):
            return fewer, left
    return multiplier, gain


def _thinned(channel: Channel, part: float, first: float) -> Channel:
    """Taps of at least a part of the largest, and of one sample at least a part of the slope."""
    if not channel.taps:
        return channel
    most = max(tap.weight for tap in channel.taps)
    slope = sum(tap.weight * tap.samples for tap in channel.taps)
    weights = {1: first * slope}
    weights |= {
        tap.samples: max(tap.weight, weights.get(tap.samples, 0.0))
        for tap in channel.taps
        if tap.weight >= part * most
    }
    taps = (Tap(samples=n, weight=round_to_digits(w, _DIGITS)) for n, w in weights.items())
    return channel.model_copy(update={"taps": tuple(taps)})


def nonlinearities(
    problem: Problem, moment: Moment, sizes: FloatArray
) -> tuple[Nonlinearities, tuple[Effects, ...]]:
    """(clamps and what is damping only, elements that fade at the gain of the margin).

    Sizes have shape (unknowns,), SI units.
    """
    clamps: dict[tuple[float, float], tuple[tuple[str, ...], float]] = {}
    steady: list[Effects] = []
    damping = 0.0
    values: dict[str, dict[EffectName, float]] = {name: {} for name in moment.elements}
    for index in {index for members in moment.members for index in members}:
        unknown = problem.unknowns[index]
        values[unknown.element][unknown.effect] = unknown.sign * float(sizes[index])
    for name, own in values.items():
        K, B, M = (own.get(effect, 0.0) for effect in EFFECT_NAMES)
        if K:
            # Clamps of one signal are one clamp.
            signal = (round_to_digits(B / K, _ALIKE), round_to_digits(M / K, _ALIKE))
            names, stiffness = clamps.get(signal, ((), 0.0))
            clamps[signal] = (*names, name), stiffness + K
        elif M or B < 0:
            steady.append(Effects(**{e: problem.margin.gain * v for e, v in own.items()}))
        else:
            damping += B
    found = (
        (" + ".join(names), Effects(stiffness=K, damping=K * lead or None, mass=K * lag or None))
        for (lead, lag), (names, K) in clamps.items()
    )
    return Nonlinearities(clamps=tuple(found), damping=damping), tuple(steady)


def witness_of(found: AbsoluteStability, margin: Margin, slack: float) -> AbsoluteStability:
    """What is claimed of a moment: what was found, with its gain to three decimals downwards.

    It is at least that of the margin; a part of what is beyond it, the slack, is not claimed.
    """
    gain = float(np.floor(found.gain * (1 - max(_SHAVED, slack)) * 1000) / 1000)
    return found.model_copy(update={"gain": max(gain, margin.gain)})
