"""Delay margin of settings, all moments of a scene judged side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EFFECT_NAMES, EffectName, Effects
from tune.documents.profile import MOST_EXTRA_DELAY
from tune.loop.plant import LONGEST_DELAY
from tune.optimisation.loops import Loops
from tune.optimisation.problem import Moment, Problem
from tune.stability.search import CLOSE
from tune.stability.verdict import safe_up_to

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Parts of a sample in which a delay margin is looked for and claimed.
_PARTS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class SizedMoment:
    """One moment at certain sizes of the unknowns.

    Attributes:
        problem: whose moment it is.
        moment: elements felt at the same time.
        sizes: of the unknowns, shape (unknowns,).
    """

    problem: Problem
    moment: Moment
    sizes: FloatArray


def extra_delays(felt: Sequence[SizedMoment]) -> list[float]:
    """Extra samples of delay up to which every gain in (0, 1] is stable at every corner.

    Looked for at whole samples and, before the first that fails, at tenths; what lies between is
    for the certificate to prove.

    Args:
        felt: moments, of one problem or of many.

    Returns:
        Of each moment; `MOST_EXTRA_DELAY` where more may be borne.
    """
    tops = np.array([_top(one.problem) for one in felt], dtype=np.int64)
    holds = np.zeros(len(felt), dtype=np.int64)
    rising = holds < tops
    while rising.any():
        # Of those that hold so far, the next whole sample.
        chosen = np.flatnonzero(rising)
        good = _holding([felt[int(i)] for i in chosen], _PARTS * (holds[chosen] + 1))
        holds[chosen[good]] += 1
        rising[chosen[~good]] = False
        rising &= holds < tops
    low, high = np.zeros(len(felt), dtype=np.int64), np.full(len(felt), _PARTS)
    open_ = np.flatnonzero(holds < tops)
    while np.any(high[open_] - low[open_] > 1):
        middle = (low + high) // 2
        good = _holding([felt[int(i)] for i in open_], (_PARTS * holds + middle)[open_])
        low[open_[good]] = middle[open_[good]]
        high[open_[~good]] = middle[open_[~good]]
    return [round(float(whole + part / _PARTS), 1) for whole, part in zip(holds, low, strict=True)]


def _top(problem: Problem) -> int:
    """Samples that can be added before a loop is longer than any that can be judged."""
    box = problem.region.box
    return max(0, min(MOST_EXTRA_DELAY, int(LONGEST_DELAY - box.delay[1] / box.sample_time[0])))


def _holding(felt: Sequence[SizedMoment], parts: NDArray[np.int64]) -> BoolArray:
    """Whether each moment is stable at its own parts of a sample more, at every gain in (0, 1]."""
    good = np.zeros(len(felt), dtype=np.bool_)
    together: dict[tuple[int, float, bool], list[int]] = {}
    for place, (one, part) in enumerate(zip(felt, parts.tolist(), strict=True)):
        late = part / _PARTS
        alone = one.moment.lone
        if alone is not None:
            unknown = one.problem.unknowns[alone]
            end = one.problem.loops.end_alone_at(unknown.effect, unknown.sign, late)
            good[place] = end > float(one.sizes[alone]) * (1 + CLOSE)
        else:
            sprung = bool(one.moment.members[0])
            together.setdefault((id(one.problem.loops), late, sprung), []).append(place)
    for (_, late, _), places in together.items():
        loops = felt[places[0]].problem.loops
        good[places] = _stable([felt[place] for place in places], loops, late)
    return good


def _stable(felt: Sequence[SizedMoment], loops: Loops, late: float) -> BoolArray:
    """Moments with the same loops, all with a spring or all without, at one extra delay."""
    each = [one.problem.effects(one.moment, one.sizes) for one in felt]
    totals: dict[EffectName, FloatArray | None] = {}
    for name in EFFECT_NAMES:
        values: list[float | None] = [getattr(effects, name) for effects in each]
        there = any(value is not None for value in values)
        totals[name] = np.array([[value or 0.0] for value in values]) if there else None
    effects = Effects(**totals)
    good = np.ones(len(felt), dtype=np.bool_)
    for loop in loops.latest(late):
        good &= np.all(safe_up_to(loop, effects, 1 + CLOSE), axis=1)
    return good
