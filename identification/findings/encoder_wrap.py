"""Encoder wrap: did the position counter run over, or slip?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.errors import Finding
from identification.estimators.signals import LOST
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: A jump is this many times the largest step that is none; no device speeds up so from one sample
#: to the next and back.
FASTEST = 8.0
#: Jumps of one log agree in size within this part, beside the steps of the motion itself: a counter
#: has one range.
ALIKE = 0.05
#: A jump is at least this part of the travel; less is a count or two of noise.
LEAST_JUMP = 0.02
#: A range within this part of a turn is named in the message.
_NAMED = 0.02


def encoder_wrap(trajectory: Trajectory) -> tuple[Finding, ...]:
    """``encoder-wrap``: jumps of one size, far above what speed allows.

    A counter that starts anew jumps by its range; a reading that is lost goes there and back.
    """
    jumps = _jumps(trajectory)
    if jumps.size == 0:
        return ()
    size = float(np.median(np.abs(jumps)))
    turn = trajectory.motion == "rotary" and abs(size / (2 * np.pi) - 1) < _NAMED
    return (
        Finding(
            code="encoder-wrap",
            severity="refusal",
            seen=f"position in {trajectory.source} jumps {jumps.size} times by {size:.4g}"
            + (", one turn," if turn else "")
            + " from one sample to the next",
            needed=f"steps of at most {FASTEST:g} times the others, as mass allows",
            remedy="Where a counter starts anew, add or subtract its range after each jump "
            f"(numpy.unwrap with period={size:.6g}); where a reading is lost, log it again.",
        ),
    )


def _jumps(trajectory: Trajectory) -> FloatArray:
    """Steps of position that are the range of a counter, with their signs."""
    steps = np.diff(trajectory.position)
    # What happens during a gap is unknown, but not a jump.
    whole = np.diff(trajectory.time) <= LOST * trajectory.sample_time
    steps = np.where(whole, steps, 0.0)
    size = np.abs(steps)
    largest = float(size.max())
    far = size > largest / 2
    usual = float(size[~far].max(initial=0.0))
    travel = float(np.ptp(trajectory.position))
    if usual == 0 or largest < FASTEST * usual or largest < LEAST_JUMP * travel:
        return np.empty(0)
    if np.ptp(size[far]) > ALIKE * largest + 2 * usual:
        return np.empty(0)
    return steps[far]
