"""Bracketing: the last value that keeps to a limit, between one that does and one that does not.

scipy.optimize's bracketing searches want finite values and give a root; here values may be infinite
or jump, what is wanted is the last place seen to keep to the limit, and no scipy is loaded for it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Gains and sizes this close to a boundary, relative, are taken to be on it: the verdicts decide
#: at 1e-9, and a written profile is rounded to six digits anyway.
CLOSE = 1e-9
#: Sizes below this part of the top are as good as nothing.
_NOTHING = 1e-15
#: Steps at most; regula falsi needs about eight, halving alone forty for the closest asked for.
_MOST_STEPS = 80


def last_kept(
    room: Callable[[float], float],
    kept: float,
    broken: float,
    *,
    room_kept: float,
    room_broken: float,
    close: float,
) -> float:
    """The last place seen to keep to a limit, ``close`` to one that does not.

    Regula falsi with the Illinois rule (Dowell and Jarratt, BIT 11, 1971, p. 168), halvings where a
    value is infinite.

    Args:
        room: what a place leaves to the limit, negative beyond it; may be infinite, and may jump.
        kept: below ``broken``.
        broken: a place beyond the limit.
        room_kept: room at ``kept``.
        room_broken: room at ``broken``.
        close: distance of the two at which the search ends.
    """
    last = 0
    for _ in range(_MOST_STEPS):
        if broken - kept <= close:
            break
        part = 0.5
        if np.isfinite(room_kept) and np.isfinite(room_broken):
            part = float(np.clip(room_kept / (room_kept - room_broken), 0.0, 1.0))
        # A step that ends on the limit must leave room on both sides to end the search.
        place = float(np.clip(kept + part * (broken - kept), kept + close / 2, broken - close / 2))
        found = room(place)
        # An end that stays twice counts half, so that both ends move.
        if found >= 0:
            kept, room_kept = place, found
            room_broken = room_broken / 2 if last > 0 else room_broken
            last = 1
        else:
            broken, room_broken = place, found
            room_kept = room_kept / 2 if last < 0 else room_kept
            last = -1
    return kept


def last_within(
    value: Callable[[float], float], limit: float, top: float, first: float = 0.0
) -> float:
    """The size up to which a growing value keeps to a limit; inf where it does so to the top.

    Narrowed on logarithms; nan is beyond any limit.

    Args:
        value: positive, of a size.
        limit: positive.
        top: the largest size looked at.
        first: where to begin; where the limit is kept there, sizes below do not matter.

    Returns:
        A size at which the limit was seen kept, 0 where none was.
    """

    def room(size: float) -> float:
        with np.errstate(all="ignore"):
            found = -float(np.log(value(size) / limit))
        return -np.inf if np.isnan(found) else found

    high, room_high = top, room(top)
    if room_high >= 0:
        return np.inf
    low, room_low = top, room_high
    if 0 < first < top:
        low, room_low = first, room(first)
    while room_low < -CLOSE:
        if low < _NOTHING * top:
            return 0.0
        high, room_high = low, room_low
        # In proportion, as the ripple of a small effect is, and a little less.
        low *= min(0.5, 0.9 * float(np.exp(room_low)) if np.isfinite(room_low) else 0.1)
        room_low = room(low)
    end = last_kept(
        lambda place: room(float(np.exp(place))),
        float(np.log(low)),
        float(np.log(high)),
        room_kept=room_low,
        room_broken=room_high,
        close=CLOSE,
    )
    return float(np.exp(end))
