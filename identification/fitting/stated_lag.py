"""A lag of the drive that the hardware states, held against the log.

A log is fitted twice: behind the lag stated, and with what lag it shows itself. Where the second
leaves far less of the force and is another lag, log and hardware contradict each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.device.hardware import Hardware
from identification.device.quantities import Quantity, quantity, widest
from identification.errors import Finding
from identification.findings import WRONG_DELAY
from identification.fitting.dynamics import lagged
from identification.fitting.log_fit import Dynamics, LogFit
from identification.trajectory import Trajectory

#: The lag of the log leaves at most this part of the mean square that the one stated leaves.
_LEFT = 0.4
#: A lag of this part of a sample is none.
_NONE = 1e-3


def behind(
    trajectory: Trajectory, hardware: Hardware, stated: Quantity
) -> tuple[Trajectory, Hardware]:
    """The log with the force behind the lag, and a delay as doubtful as the lag."""
    force = lagged(trajectory.force, stated.value, trajectory.sample_time)
    log, delay = replace(trajectory, force=force), hardware.delay
    if delay is None:
        return log, hardware
    ends = (delay.low + stated.low - stated.value, delay.high + stated.high - stated.value)
    doubtful = delay.model_copy(update=dict(zip(("low", "high"), ends, strict=True)))
    return log, hardware.model_copy(update={"delay": doubtful})


def believed(free: LogFit, given: LogFit, stated: Quantity) -> LogFit:
    """The fit behind the lag stated, or the free one where that contradicts it."""
    log, step = free.trajectory, free.trajectory.sample_time
    seen = None if free.dynamics is None else free.dynamics.current_lag
    shown = 0.0 if seen is None else seen.value
    apart = max(shown - stated.high, stated.low - shown)
    before, after = _left(given), _left(free)
    if apart <= WRONG_DELAY * step or after >= _LEFT * before:
        return replace(
            given, trajectory=log, dynamics=_with(given.dynamics, given.trajectory, stated)
        )
    if seen is None:
        seen = quantity(_NONE * step, source="log")
        told, right = "no lag of the force", "leave it out"
    else:
        told = f"a force that lags {shown * 1e3:.3g} ± {(seen.high - seen.low) * 500:.1g} ms"
        ends = f"low: {seen.low:.4g}, high: {seen.high:.4g}"
        right = f"state {{value: {shown:.4g}, {ends}}}"
    both = widest(stated, [seen]) or stated
    finding = Finding(
        code="drive-lag",
        seen=f"{log.source} shows {told}, the hardware states {stated.value * 1e3:.4g} ms: with "
        f"that {np.sqrt(before):.2%} of the force are left unexplained, rms, as the log shows it "
        f"{np.sqrt(after):.2%}",
        needed=f"the same within {WRONG_DELAY:g} samples ({WRONG_DELAY * step * 1e3:.4g} ms)",
        remedy=f"Correct current_lag in the hardware file, or {right} if the log is right. The "
        f"device holds both, {both.low * 1e3:.3g} to {both.high * 1e3:.3g} ms, and all of it is "
        "certified. Mass and damping were told with the lag of the log.",
    )
    kept = [
        each for each in free.findings if each.code != finding.code or each.severity == "refusal"
    ]
    findings = (*kept, finding)
    return replace(free, dynamics=_with(free.dynamics, log, seen), findings=findings)


def _left(fit: LogFit) -> float:
    """Mean square over that of the force of what mass, damping and every friction leave."""
    every = (fit.estimate, *fit.others)
    plain = min(1 - each.explained for each in every if each.method == "least-squares")
    return max(plain if fit.curve is None else min(plain, fit.curve.left**2), 0.0)


def _with(dynamics: Dynamics | None, log: Trajectory, lag: Quantity) -> Dynamics:
    """What a log shows beside a rigid device, behind this lag."""
    return replace(dynamics or Dynamics(log=log, doubt=np.zeros((0, 0))), current_lag=lag)
