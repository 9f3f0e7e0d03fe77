"""Unknown delay: can the log tell the delay that nobody states?"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.errors import Finding
from identification.estimators.estimate import NORMAL_95, Estimate
from identification.estimators.least_squares import MOST_SAMPLES, Delay
from identification.trajectory import Trajectory

#: Samples from the end of the scan within which the true delay may lie beyond it, ...
_AT_END = 0.1
#: ... if the residual still falls there by this part from one sample to the next. A log that does
#: not tell its delay may have its smallest residual anywhere.
STILL_FALLING = 0.01
#: Half-width of the 95 % interval of a delay, in samples, above which it is doubted: a stability
#: margin is of one sample.
WIDEST = 1.0
#: Two delays contradict each other if they are further apart than this many deviations of both ...
_SIGMAS = 4.0
#: ... and than this part of a sample, below which the difference matters to nothing.
_APART = 0.25


def unknown_delay(trajectory: Trajectory, delay: Delay | None) -> tuple[Finding, ...]:
    """``delay-unknown``: beyond what is looked for, or nowhere in particular.

    Args:
        trajectory: the log.
        delay: read from the log; None if it was stated.
    """
    if delay is None:
        return ()
    step = trajectory.sample_time
    # Nothing is known beyond the scan, so no doubt is wider.
    width = min(NORMAL_95 * delay.deviation / step, float(MOST_SAMPLES))
    found = delay.value / step
    before, last = delay.residuals[-2:]
    beyond = found >= MOST_SAMPLES - _AT_END and last < (1 - STILL_FALLING) * before
    if not beyond and width <= WIDEST:
        return ()
    seen = (
        f"the residual of {trajectory.source} is smallest at {found:.2f} ± {width:.2g} samples "
        "of delay"
    )
    return (
        Finding(
            code="delay-unknown",
            severity="refusal" if beyond else "warning",
            seen=seen + (f", the end of the scan from 0 to {MOST_SAMPLES}" if beyond else ""),
            needed=f"a delay below {MOST_SAMPLES} samples"
            if beyond
            else f"a delay within ± {WIDEST:g} sample",
            remedy="State delay in the hardware file, or excite fast enough to show it.",
        ),
    )


def contradicting_delays(
    trajectory: Trajectory, chosen: Estimate, others: Iterable[Estimate]
) -> tuple[Finding, ...]:
    """``delay-unknown``: two methods read delays that exclude each other.

    Args:
        trajectory: the log.
        chosen: the estimate believed.
        others: estimates by other methods; only those that fitted a delay as well are heard.
    """
    if chosen.delay_deviation is None:
        return ()
    step = trajectory.sample_time
    for other in others:
        if other.delay_deviation is None:
            continue
        apart = abs(other.delay - chosen.delay)
        chance = float(np.hypot(other.delay_deviation, chosen.delay_deviation))
        if apart > max(_SIGMAS * chance, _APART * step):
            return (
                Finding(
                    code="delay-unknown",
                    severity="warning",
                    seen=f"{_told(chosen, step)} in {trajectory.source}, {_told(other, step)}",
                    needed=f"delays within {_SIGMAS:g} deviations or {_APART:g} samples",
                    remedy="State delay in the hardware file; where it varies from sample to "
                    "sample, state its largest value.",
                ),
            )
    return ()


def _told(estimate: Estimate, step: float) -> str:
    width = NORMAL_95 * (estimate.delay_deviation or 0.0)
    name = estimate.method.replace("-", " ")
    return f"{name} say {estimate.delay / step:.2f} ± {width / step:.2g} samples of delay"
