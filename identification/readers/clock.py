"""Is the column of time in seconds? A control loop's step says so."""

from __future__ import annotations

import numpy as np

from identification.errors import InvalidInputError
from identification.trajectory import Trajectory

#: s. A loop slower than 10 Hz renders nothing, and stamps of a loop up to 10 kHz that count
#: milliseconds, microseconds or nanoseconds step by at least this.
LONGEST_STEP = 0.1
#: s. A loop of 10 MHz; no device file takes less either.
SHORTEST_STEP = 1e-7

#: Units stamps come in, and s in each; the first that makes a control loop is guessed.
_UNITS = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))


def refuse_clock(trajectory: Trajectory, column: str) -> None:
    """Refuse time that cannot be in seconds.

    Args:
        trajectory: the log as read.
        column: name of its column of time, for the message.

    Raises:
        InvalidInputError: a median step of LONGEST_STEP or more, or below SHORTEST_STEP.
    """
    step = trajectory.sample_time
    if SHORTEST_STEP <= step < LONGEST_STEP:
        return
    fitting = [name for name, size in _UNITS if SHORTEST_STEP <= step * size < LONGEST_STEP]
    guess = ""
    if step >= LONGEST_STEP and fitting:
        guess = f"; as {fitting[0]} it would be {step * dict(_UNITS)[fitting[0]]:.4g} s"
        if np.array_equal(np.diff(trajectory.time), np.ones(len(trajectory) - 1)):
            guess = "; it may count rows" + guess.replace(";", ",")
    raise InvalidInputError(
        trajectory.source,
        f"column '{column}' steps by {step:.4g} in the median, no step in seconds of a control "
        f"loop ({SHORTEST_STEP:g} to {LONGEST_STEP:g} s){guess}",
        "Give time in seconds, or name the right column with --time",
    )
