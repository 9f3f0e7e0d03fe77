"""Did the actuator give the force that was logged?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Force counts as at its limit within this part of it (printed digits, one count of a converter).
AT_LIMIT = 1e-4
#: Consecutive samples at the limit that a smooth signal does not reach by chance.
RUN = 5
#: Part of the log in such runs that is tolerated.
TOLERATED = 0.01
#: A force with at most this many distinct sizes is a switching signal, whose plateaus are meant.
SWITCHING_LEVELS = 16


def saturation(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """``force-saturated``: long runs at the exact maximum, or more than the hardware can give."""
    size = np.abs(trajectory.force)
    peak = float(size.max())
    findings: list[Finding] = []
    limit = None if hardware is None or hardware.force_limit is None else hardware.force_limit.peak
    if limit is not None and peak > limit * (1 + AT_LIMIT):
        share = float(np.mean(size > limit * (1 + AT_LIMIT)))
        findings.append(
            Finding(
                code="force-saturated",
                severity="refusal",
                seen=f"{trajectory.source} asks for up to {peak:.4g}, more than the peak force "
                f"{limit:.4g} of the hardware in {share:.2%} of its samples",
                needed="force that the actuator can give",
                remedy="Give N (N·m) per unit of the force column with --force-gain if it is in "
                "volts, amperes or another unit; only if it is in N (N·m), excite more gently. The "
                "limit is that of the data sheet.",
            )
        )
    share = _share_in_runs(size, peak * (1 - AT_LIMIT))
    levels = np.unique(np.round(size / peak / AT_LIMIT)).size
    if share > TOLERATED and levels > SWITCHING_LEVELS:
        findings.append(
            Finding(
                code="force-saturated",
                severity="refusal",
                seen=f"{share:.1%} of {trajectory.source} stays at the largest force {peak:.4g} "
                f"for {RUN} samples or more",
                needed=f"at most {TOLERATED:.0%}",
                remedy="Excite more gently, so that the actuator gives what the log says.",
            )
        )
    return tuple(findings)


def _share_in_runs(size: FloatArray, limit: float) -> float:
    """Part of all samples that lie in runs of at least RUN at the limit, smooth tops left out."""
    edges = np.diff(np.concatenate(([0], (size >= limit).astype(np.int8), [0])))
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    long = ends - starts >= RUN
    runs = zip(starts[long].tolist(), ends[long].tolist(), strict=True)
    flat = [end - start for start, end in runs if not _smooth_top(size[start:end])]
    return sum(flat) / size.size


def _smooth_top(part: FloatArray) -> bool:
    """Whether it rises and then falls, as no force does that is cut off."""
    steps = np.sign(np.diff(part))
    return bool(
        np.count_nonzero(steps) > steps.size / 2 and np.all(np.diff(steps[steps != 0]) <= 0)
    )
