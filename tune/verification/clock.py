"""The clock of a log: its rows must be those of the controller's loop."""

from __future__ import annotations

import numpy as np

from identification import Finding, LogRefusedError, Trajectory
from tune.documents.profile import Design

#: A log whose steps differ from the sample time of the profile by more is of another loop.
SAMPLE_TIME_TOLERANCE = 0.01
#: A step this many times the usual one has lost a row, which the filters of the law need.
_LOST = 1.5
#: rms of the steps about their mean, as part of it, above which backward differences are not those
#: of an even clock.
_MOST_JITTER = 0.05


def check_clock(profile: Design, trajectory: Trajectory) -> None:
    """Refuse a log whose rows are not those of the controller's loop.

    Raises:
        LogRefusedError: rows lost, an uneven clock, another sample time.
    """
    steps = np.diff(trajectory.time)
    usual, stated = float(np.median(steps)), profile.loop.sample_time
    known = profile.device.sample_time
    low = min(stated, known.low) * (1 - SAMPLE_TIME_TOLERANCE)
    high = max(stated, known.high) * (1 + SAMPLE_TIME_TOLERANCE)
    long = int(np.count_nonzero(steps > _LOST * usual))
    jitter = float(np.std(steps) / np.mean(steps))
    finding: tuple[str, str, str, str] | None = None
    if not low <= usual <= high:
        finding = (
            "dropped-samples" if usual > high else "jitter",
            f"{trajectory.source} steps by {usual * 1e3:.5g} ms",
            f"the sample time of the profile, {stated * 1e3:.5g} ms",
            "Log every sample of the control loop, with time in seconds; if the loop runs at "
            "another rate, correct the device and tune again.",
        )
    elif long:
        finding = (
            "dropped-samples",
            f"{trajectory.source} has {long} gaps, the longest {steps.max() * 1e3:.4g} ms",
            "every sample, since the filters of the law remember all of them",
            "Log with a real-time thread, or cut the log to a part without gaps.",
        )
    elif jitter > _MOST_JITTER:
        finding = (
            "jitter",
            f"the steps of {trajectory.source} vary by {jitter:.2%} rms",
            f"at most {_MOST_JITTER:.0%}",
            "Run the controller at a constant rate.",
        )
    if finding is not None:
        code, seen, needed, remedy = finding
        raise LogRefusedError(
            (
                Finding(
                    code=code,
                    severity="refusal",
                    seen=seen,
                    needed=needed,
                    remedy=remedy,
                    source=trajectory.source,
                ),
            )
        )
