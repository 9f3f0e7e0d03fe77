"""Sums with clamps that may be reached, as far as they are proved absolutely stable.

Sizes are found by linear limits; here each sum is given the multipliers that prove it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby, product

import numpy as np
from numpy.typing import NDArray

from identification import round_to_digits
from tune.documents.certified import AbsoluteStability, Channel, Multiplier, Tap
from tune.documents.effects import EFFECT_NAMES, Effects
from tune.documents.scene import Margin
from tune.optimisation.problem import ROOM, Moment, Problem
from tune.optimisation.zames_falb import find_multiplier
from tune.stability.absolute import Nonlinearities, absolute_gain
from tune.stability.responses import Responses

FloatArray = NDArray[np.float64]

#: What of a gain beyond the margin is not claimed, relative; beyond the most a margin says nothing.
_SHAVED, _MOST_GAIN = 2e-2, 1000.0
#: Parts of the gain that is asked for, at which a multiplier is looked for in turn.
_PARTS = (1.02, 1.0, 0.9, 0.7, 0.4)
#: Digits to which B/K and M/K agree where clamps act on one signal.
_ALIKE = 9
#: Taps of less than these parts of the largest of their channel are left out, if so much of the
#: gain is kept.
_FAINT, _KEPT = (0.3, 0.1, 0.03, 0.01, 1e-3, 0.0), 0.99
#: Slope of a tap of one sample, as a part of that of all of them.
_FIRST_TAP = (0.03, 3e-3, 3e-4)
#: Digits of a weight.
_DIGITS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvedGain:
    """The gain that was found for a moment, and the multipliers that give it.

    Attributes:
        gain: for the worst loop, free or held; 0 where none was found.
        free: for loops whose position nothing holds; None where there are none.
        held: for the others.
    """

    gain: float
    free: Multiplier | None = None
    held: Multiplier | None = None


#: By the elements of each moment that must be absolutely stable.
AllFound = Mapping[tuple[str, ...], ProvedGain]


def prove_moments(problem: Problem, sizes: FloatArray, known: AllFound | None = None) -> AllFound:
    """`search_gain` of every moment that must be absolutely stable.

    Sizes have shape (unknowns,), SI units; what is known is of others.
    """
    known = known or {}
    return {
        moment.elements: search_gain(problem, moment, sizes, known.get(moment.elements))
        for moment in problem.moments
        if moment.absolute
    }


def _members(moment: Moment) -> set[int]:
    return {index for members in moment.members for index in members}


def search_gain(
    problem: Problem, moment: Moment, sizes: FloatArray, known: ProvedGain | None = None
) -> ProvedGain:
    """The gain up to which a moment is absolutely stable at every corner and delay of the margin.

    Args:
        problem: loops and margin.
        moment: with a clamp.
        sizes: of the unknowns, shape (unknowns,).
        known: multipliers of other sizes, which may do.
    """
    if not problem.region.box.damping[0] > 0:
        return ProvedGain(gain=0.0)
    parts, steady = nonlinearities(problem, moment, sizes)
    least = problem.proved_gain
    # What acts steadily is looked at up to the gain of the margin: nothing is claimed beyond it.
    gains = [problem.margin.gain * (1 + 2 * ROOM) if steady else _MOST_GAIN]
    multipliers: dict[bool, Multiplier | None] = {}
    box = problem.region.box
    late = box.delay[1] / box.sample_time[0] + problem.margin.extra_delay_samples
    for loop in problem.loops.between(problem.margin.extra_delay_samples):
        responses = Responses.of(loop, steady)
        multiplier, gain = None, 0.0
        if known is not None:
            multiplier = known.held if loop.grounded else known.free
        if multiplier is not None:
            gain = _least_gain(responses, parts, multiplier)
        for part in () if gain >= least else _PARTS:
            multiplier = find_multiplier(responses, parts, part * least, late)
            if multiplier is not None:
                gain = _least_gain(responses, parts, multiplier)
                multiplier, gain = _with_few_taps(responses, parts, multiplier, gain, least)
                break
        gains.append(gain)
        multipliers[loop.grounded] = multiplier
    return ProvedGain(gain=min(gains), free=multipliers.get(False), held=multipliers.get(True))


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
    order = sorted(_members(moment))
    order.sort(key=lambda i: moment.elements.index(problem.unknowns[i].element))
    for name, own in groupby(order, key=lambda i: problem.unknowns[i].element):
        values = {
            problem.unknowns[i].effect: problem.unknowns[i].sign * float(sizes[i]) for i in own
        }
        if "stiffness" in values:
            # Clamps of one signal are one clamp.
            K, B, M = (values.get(effect, 0.0) for effect in EFFECT_NAMES)
            signal = (round_to_digits(B / K, _ALIKE), round_to_digits(M / K, _ALIKE))
            names, stiffness = clamps.get(signal, ((), 0.0))
            clamps[signal] = (*names, name), stiffness + K
        elif "mass" in values or values["damping"] < 0:
            gain = problem.margin.gain
            steady.append(Effects(**{effect: gain * value for effect, value in values.items()}))
        else:
            damping += values["damping"]
    found = tuple(
        (
            " + ".join(names),
            Effects(stiffness=K, damping=K * lead or None, mass=K * inertia or None),
        )
        for (lead, inertia), (names, K) in clamps.items()
    )
    return Nonlinearities(clamps=found, damping=damping), tuple(steady)


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
