"""Which elements keep the profile's margin on every loop that a log allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.profile import Design
from tune.loop.filters import Filters, used_filters
from tune.loop.mechanism import HandNumbers
from tune.stability.verdict import safe_up_to
from tune.verification.consistent_loops import ConsistentLoops
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


def judge_margin(
    profile: Design, moment: tuple[str, ...], filters: tuple[Filters, ...], allowed: ConsistentLoops
) -> Kept:
    """Judge one moment, at the gain of the profile, on all allowed loops.

    Args:
        profile: with the margin to keep.
        moment: elements felt together.
        filters: all that the log allows.
        allowed: the loops.
    """
    judge = MarginJudge(profile, moment)
    lost = (delay for delay in _judged_delays(allowed) if not judge.keeps(filters, allowed, delay))
    return Kept(moment=moment, lost_at=next(lost, None))


class MarginJudge:
    """Whether one moment keeps the margin of a profile, on any loops; what is known is kept.

    Every gain in (0, g] must be stable, and every gain in (0, 1] with the extra delay of the
    margin, half of it and all of it; without a hand and with every corner of the hand's box. Of
    each mass and own stiffness the least and the largest damping that is allowed are judged, at
    whole samples of delay and at the shortest and the longest delay.
    """

    __slots__ = ("_effects", "_hands", "_known", "_profile", "_tasks")

    def __init__(self, profile: Design, moment: tuple[str, ...]) -> None:
        """Takes a profile and elements felt together."""
        margin = profile.margin
        self._profile, self._effects = profile, effects_of(profile, moment)
        self._hands = hands_of(profile.hand)
        self._tasks = [(0.0, margin.gain)]
        self._tasks += [(part * margin.extra_delay_samples, 1.0) for part in _PARTS]
        #: Gain up to which all of the loops were found stable, or the least at which they were not.
        self._known: dict[tuple[object, ...], tuple[float, float]] = {}

    def keeps_all(self, filters: tuple[Filters, ...], allowed: ConsistentLoops) -> bool:
        """Whether the margin is kept on every loop; the longest delays, likely lost, go first."""
        delays = _judged_delays(allowed)[::-1]
        return all(self.keeps(filters, allowed, delay) for delay in delays)

    def keeps(self, filters: tuple[Filters, ...], allowed: ConsistentLoops, delay: float) -> bool:
        """Whether the margin is kept on every loop of one delay, samples."""
        rigid = _extremes(allowed, delay)
        used = dict.fromkeys(used_filters(each, self._effects) for each in filters)
        return all(
            self._stable(rigid, delay + further, each, hand, gain)
            for each in used
            for hand in self._hands
            for further, gain in self._tasks
        )

    def _stable(
        self,
        rigid: tuple[FloatArray, FloatArray, FloatArray],
        delay: float,
        filters: Filters,
        hand: HandNumbers | None,
        gain: float,
    ) -> bool:
        """Whether all loops of these masses, dampings and own stiffnesses are stable up to it."""
        which = (*(part.tobytes() for part in rigid), delay, filters, hand)
        up_to, not_at = self._known.get(which, (0.0, np.inf))
        if up_to < gain < not_at:
            loop = loops_over(self._profile.device, *rigid, delay, filters, hand)
            if np.all(safe_up_to(loop, self._effects, gain)):
                up_to = gain
            else:
                not_at = gain
            self._known[which] = up_to, not_at
        return gain <= up_to


def _judged_delays(allowed: ConsistentLoops) -> list[float]:
    """The shortest and the longest delay and the whole samples between, samples, ascending."""
    delays = np.unique(allowed.delay_samples)
    ends = np.isin(delays, (delays.min(initial=np.inf), delays.max(initial=0.0)))
    return delays[ends | (delays % 1 == 0)].tolist()


def _extremes(allowed: ConsistentLoops, delay: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(mass, damping, own stiffness), of each first and last the ends of damping, at one delay."""
    here = allowed.delay_samples == delay
    parts = allowed.mass[here], allowed.damping[here], allowed.position_stiffness[here]
    order = np.lexsort((parts[1], parts[2], parts[0]))
    mass, damping, slope = (part[order] for part in parts)
    new = (np.diff(mass) > 0) | (np.diff(slope) > 0)
    ends = np.concatenate([[True], new]) | np.concatenate([new, [True]])
    return mass[ends], damping[ends], slope[ends]
