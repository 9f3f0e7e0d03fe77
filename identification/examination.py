"""What one log can and cannot support, before anybody relies on it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification._identify import Identification, identify
from identification.device.device import Quantity
from identification.device.hardware import Hardware
from identification.errors import Finding, InvalidInputError, LogRefusedError
from identification.estimators import Method
from identification.estimators.signals import encoder_count, position_noise
from identification.findings import CODES
from identification.findings.force_balance import ForceBalance, balance_of
from identification.trajectory import Motion, Trajectory

#: The excited band holds the power of the velocity but for this part at either end.
_OUTSIDE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Examination:
    """One log and what identify makes of it; SI units, or the rotary ones of Device.

    Attributes:
        source: where the log comes from.
        motion: "linear" or "rotary"; None where nobody stated it.
        samples: number of rows.
        fitted: rows that mass and damping are told from; None if they are not told.
        duration: s.
        sample_time: usual step, s.
        travel: m, from end to end.
        peak_speed: m/s, as smooth as noise of position asks for.
        peak_force: N.
        count: step of the position, m, if all positions lie on a grid.
        noise: standard deviation of one position reading, m.
        band: Hz, lowest and highest frequency of the motion; 1 % of the squared velocity lies below
            and 1 % above.
        mass: kg, with its 95 % interval; None if none can be had at all.
        damping: N·s/m, with its 95 % interval; None if none can be had at all.
        findings: every one, refusals first; allowed ones are warnings.
        refused: whether identify refuses the log.
        found: what identify makes of it, were every finding accepted; None if nothing.
    """

    source: str
    motion: Motion | None
    samples: int
    fitted: int | None
    duration: float
    sample_time: float
    travel: float
    peak_speed: float
    peak_force: float
    count: float | None
    noise: float
    band: tuple[float, float]
    mass: Quantity | None
    damping: Quantity | None
    findings: tuple[Finding, ...]
    refused: bool
    found: Identification | None


def examine(
    trajectory: Trajectory,
    *,
    hardware: Hardware | None = None,
    method: Method = "auto",
    allow: Collection[str] = (),
) -> Examination:
    """Look at one log as identify would, and refuse nothing.

    Args:
        trajectory: the log.
        hardware: as for identify.
        method: as for identify.
        allow: as for identify.

    Raises:
        UsageError: an unknown method or code, hardware of another axis.
        InvalidInputError: hardware and log contradict each other, or no numbers of a device.
    """
    found: Identification | None
    try:
        found = identify(trajectory, hardware=hardware, method=method, allow=allow)
        findings, refused = found.findings, False
    except LogRefusedError as error:
        findings, refused = error.findings, True
        found = _anyway(trajectory, hardware, method)
    rows = balance_of(trajectory)
    time = trajectory.time
    return Examination(
        source=trajectory.source,
        motion=trajectory.motion or (None if hardware is None else hardware.motion),
        samples=len(trajectory),
        fitted=None if found is None else found.logs[0].fitted,
        duration=float(time[-1] - time[0]),
        sample_time=trajectory.sample_time,
        travel=float(np.ptp(trajectory.position)),
        peak_speed=float(np.max(np.abs(rows.velocity))),
        peak_force=float(np.max(np.abs(trajectory.force))),
        count=encoder_count(trajectory.position),
        noise=position_noise(trajectory.position, trajectory.force),
        band=_band(rows),
        mass=None if found is None else found.device.mass,
        damping=None if found is None else found.device.damping,
        findings=findings,
        refused=refused,
        found=found,
    )


def _anyway(
    trajectory: Trajectory, hardware: Hardware | None, method: Method
) -> Identification | None:
    """What the log would say if every finding were accepted; None if nothing."""
    try:
        return identify(trajectory, hardware=hardware, method=method, allow=CODES)
    except (LogRefusedError, InvalidInputError):
        return None


def _band(rows: ForceBalance) -> tuple[float, float]:
    """Frequencies between which the motion has its velocity, Hz."""
    step = float(np.median(np.diff(rows.time)))
    velocity = (rows.velocity - np.mean(rows.velocity)) * np.hanning(len(rows))
    power: NDArray[np.float64] = np.cumsum(np.abs(np.fft.rfft(velocity)) ** 2)
    frequency = np.fft.rfftfreq(len(rows), step)
    low = int(np.count_nonzero(power < _OUTSIDE * power[-1]))
    high = int(np.count_nonzero(power < (1 - _OUTSIDE) * power[-1]))
    return float(frequency[low]), float(frequency[min(high, frequency.size - 1)])
