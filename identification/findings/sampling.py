"""Are the samples evenly spaced, complete, and as fast as the hardware says?"""

from __future__ import annotations

import numpy as np

from identification.device import Hardware
from identification.errors import Finding, InvalidInputError
from identification.trajectory import Trajectory

#: A step longer than this many median steps has lost a sample.
LOST = 1.5
#: Root mean square of the steps about their mean, as part of it: above the first the log is
#: doubted, above the second refused. At 0.5 m/s and 1 ms, 1 % is 5 um: an encoder count or so.
#: A real log with steps of 10 and 12 ms in turn (9 %) shifts the inertia by a tenth.
DOUBTED_JITTER = 0.01
REFUSED_JITTER = 0.05
#: Hardware and log may differ by this part in sample time; mass goes with its square.
SAMPLE_TIME_TOLERANCE = 0.01


def sampling(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """``dropped-samples`` and ``jitter``.

    Raises:
        InvalidInputError: the log's sample time is not the hardware's nor a multiple of it.
    """
    steps = np.diff(trajectory.time)
    median = trajectory.sample_time
    findings = [*_against_hardware(trajectory, hardware)]
    long = steps > LOST * median
    if long.any():
        lost = int(np.sum(np.rint(steps[long] / median) - 1))
        first = int(np.flatnonzero(long)[0])
        findings.append(
            Finding(
                code="dropped-samples",
                severity="refusal",
                seen=f"{trajectory.source} has {int(long.sum())} gaps, about {lost} samples lost, "
                f"the first after {trajectory.time[first]:g} s, the longest "
                f"{steps.max() * 1e3:.4g} ms at a usual step of {median * 1e3:.4g} ms",
                needed=f"no step above {LOST * median * 1e3:.4g} ms",
                remedy="Log with a real-time thread, or cut the log to a part without gaps.",
            )
        )
    even = steps[~long]
    jitter = float(np.std(even) / np.mean(even))
    if jitter > DOUBTED_JITTER:
        refused = jitter > REFUSED_JITTER
        findings.append(
            Finding(
                code="jitter",
                severity="refusal" if refused else "warning",
                seen=f"the steps of {trajectory.source} vary by {jitter:.2%} rms, from "
                f"{even.min() * 1e3:.4g} to {even.max() * 1e3:.4g} ms; they are taken as equal",
                needed=f"at most {REFUSED_JITTER if refused else DOUBTED_JITTER:.0%}",
                remedy="Log at a constant rate, and write time with enough digits.",
            )
        )
    return tuple(findings)


def _against_hardware(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    if hardware is None or hardware.sample_time is None:
        return ()
    stated, seen = hardware.sample_time, mean_step(trajectory)
    low = stated.low * (1 - SAMPLE_TIME_TOLERANCE)
    high = stated.high * (1 + SAMPLE_TIME_TOLERANCE)
    if low <= seen <= high:
        return ()
    ratio = seen / stated.value
    if ratio > LOST and abs(ratio / round(ratio) - 1) <= SAMPLE_TIME_TOLERANCE:
        return (
            Finding(
                code="dropped-samples",
                severity="refusal",
                seen=f"{trajectory.source} steps by {seen * 1e3:.4g} ms, every "
                f"{round(ratio)}th sample of the {stated.value * 1e3:.4g} ms of the hardware",
                needed="every sample of the control loop, since force is held for each of them",
                remedy="Log every sample, or correct sample_time in the hardware file.",
            ),
        )
    raise InvalidInputError(
        trajectory.source,
        f"steps by {seen:.6g} s, but the hardware states a sample time of {stated.value:.6g} s",
        "Give time in seconds (--time names the column), or correct sample_time",
    )


def mean_step(trajectory: Trajectory) -> float:
    """Sample time in s: the mean of the steps that lost nothing.

    The mean, not the median: stamps printed with few digits have a biased median.
    """
    steps = np.diff(trajectory.time)
    return float(np.mean(steps[steps <= LOST * trajectory.sample_time]))
