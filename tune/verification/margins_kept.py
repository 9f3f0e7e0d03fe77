"""Which elements keep the profile's margin on every loop that a log allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.profile import Design
from tune.loop.filters import Filters, used_filters
from tune.stability.verdict import safe_up_to
from tune.verification.allowed import AllowedLoops
from tune.verification.elements import effects_of
from tune.verification.loops_over import hands_of, loops_over

FloatArray = NDArray[np.float64]

#: Parts of the margin's extra delay that are judged.
_PARTS = (0.5, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Whether one moment keeps its margin.

    Attributes:
        moment: the elements felt together.
        lost_at: the least delay, samples, at which an allowed loop does not keep the margin; None
            where every one keeps it.
    """

    moment: tuple[str, ...]
    lost_at: float | None


def margin_kept(
    profile: Design, moment: tuple[str, ...], filters: tuple[Filters, ...], allowed: AllowedLoops
) -> Kept:
    """Judge one moment, at the gain of the profile, on all allowed loops.

    Every gain in (0, g] must be stable, and every gain in (0, 1] with the extra delay of the
    margin, half of it and all of it; without a hand and with every corner of the hand's box. Of
    each mass and own stiffness the least and the largest damping that is allowed are judged, at
    whole samples of delay and at the shortest and the longest delay.

    Args:
        profile: with the margin to keep.
        moment: elements felt together.
        filters: all that the log allows.
        allowed: the loops.
    """
    effects, margin = effects_of(profile, moment), profile.margin
    tasks = [(0.0, margin.gain), *((part * margin.extra_delay_samples, 1.0) for part in _PARTS)]
    used = dict.fromkeys(used_filters(each, effects) for each in filters)
    delays = np.unique(allowed.delay_samples)
    ends = np.isin(delays, (delays.min(initial=np.inf), delays.max(initial=0.0)))
    for delay in delays[ends | (delays % 1 == 0)].tolist():
        masses, dampings, slopes = _extremes(allowed, delay)
        for each in used:
            for hand in hands_of(profile.hand):
                for further, gain in tasks:
                    loop = loops_over(
                        profile.device,
                        masses,
                        dampings,
                        slopes,
                        delay + further,
                        each,
                        hand,
                    )
                    if not np.all(safe_up_to(loop, effects, gain)):
                        return Kept(moment=moment, lost_at=delay)
    return Kept(moment=moment, lost_at=None)


def _extremes(allowed: AllowedLoops, delay: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(mass, damping, own stiffness), of each first and last the ends of damping, at one delay."""
    here = allowed.delay_samples == delay
    parts = allowed.mass[here], allowed.damping[here], allowed.position_stiffness[here]
    order = np.lexsort((parts[1], parts[2], parts[0]))
    mass, damping, slope = (part[order] for part in parts)
    new = (np.diff(mass) > 0) | (np.diff(slope) > 0)
    ends = np.concatenate([[True], new]) | np.concatenate([new, [True]])
    return mass[ends], damping[ends], slope[ends]
