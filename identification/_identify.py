"""Mass, damping, friction and delay of an axis from its logs, and what one log can support."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.device.device import Device, LogRecord
from identification.device.hardware import Hardware
from identification.device.quantities import Quantity
from identification.documents import as_stored
from identification.errors import Finding, InvalidInputError, LogRefusedError, UsageError
from identification.estimators import METHODS, Method
from identification.estimators.estimate import Estimate
from identification.estimators.signals import encoder_count, position_noise
from identification.findings import CODES, inspect
from identification.findings.force_balance import ForceBalance, balance_of
from identification.fitting.one_log import LogFit, fit_log
from identification.trajectory import Motion, Trajectory, refuse_sizes

#: The excited band holds the power of the velocity but for this part at either end.
_OUTSIDE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
    """What identify found.

    Attributes:
        device: hardware plus what was identified, numbers rounded as they will be stored.
        logs: one fit for each log, in the order given.
        findings: warnings about the logs, those allowed among them.
    """

    device: Device
    logs: tuple[LogFit, ...]
    findings: tuple[Finding, ...]

    def __repr__(self) -> str:
        mass, damping = self.device.mass, self.device.damping
        return (
            f"Identification(mass {mass.value:.4g} ({mass.low:.4g} to {mass.high:.4g}), "
            f"damping {damping.value:.4g} ({damping.low:.4g} to {damping.high:.4g}), "
            f"by {self.method} from {len(self.logs)} log(s), {len(self.findings)} finding(s))"
        )

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The estimate believed of each log."""
        return tuple(fit.estimate for fit in self.logs)

    @property
    def method(self) -> str:
        """Method of the estimates believed; several are joined by "+"."""
        return "+".join(dict.fromkeys(fit.method for fit in self.logs))

    @property
    def reason(self) -> str:
        """Why this method, a sentence for each log."""
        return "; ".join(f"{fit.trajectory.source}: {fit.reason}" for fit in self.logs)


def identify(
    trajectory: Trajectory | Sequence[Trajectory],
    *,
    hardware: Hardware | None = None,
    method: Method = "auto",
    allow: Collection[str] = (),
) -> Identification:
    """Identify one axis from one log or several.

    Args:
        trajectory: a log, or several of one axis; several give the envelope. A log of which nobody
            said whether it is linear or rotary has the motion of the hardware.
        hardware: what is known of the device. A delay it states is honoured, 0 included. What it
            does not state is ``missing`` in the device, which holds what the logs suggest of it
            with ``source: log``; only a delay that they tell within a sample counts as known.
        method: "auto" believes output error where position noise explains its residual, else the
            most efficient method that a more robust one does not contradict; or one of METHODS.
        allow: codes of findings that are not to refuse a log; recorded with the device.

    Raises:
        UsageError: no log, logs of different axes, an unknown method or code.
        InvalidInputError: hardware and log contradict each other.
        LogRefusedError: mass and damping cannot honestly be told; carries every finding.
    """
    trajectories = (trajectory,) if isinstance(trajectory, Trajectory) else tuple(trajectory)
    _check_request(trajectories, hardware, method, allow)
    trajectories = tuple(_moving(log, trajectories, hardware) for log in trajectories)
    for log in trajectories:
        refuse_sizes(log)
    noticed = [
        tuple(each.of(log.source) for each in inspect(log, hardware)) for log in trajectories
    ]
    _refuse(noticed, allow)
    fits = [fit_log(_clocked(log, hardware), hardware, method) for log in trajectories]
    noticed = [
        found + tuple(each.of(fit.trajectory.source) for each in fit.findings)
        for found, fit in zip(noticed, fits, strict=True)
    ]
    _refuse(noticed, allow)
    if any(fit.estimate.value("mass") <= 0 for fit in fits):  # no permission makes a device of it
        raise LogRefusedError(tuple(finding for found in noticed for finding in found))

    from identification.fitting.several_logs import unstated_warnings

    sources = ", ".join(log.source for log in trajectories)
    missing = tuple(each.of(sources) for each in unstated_warnings(fits, hardware))
    records = [
        LogRecord(
            source=fit.trajectory.source,
            digest=fit.trajectory.digest,
            samples=len(fit.trajectory),
            method=fit.method,
            findings=tuple(dict.fromkeys(finding.code for finding in (*found, *missing))),
            allowed=tuple(dict.fromkeys(f.code for f in found if f.severity == "refusal")),
            unmodelled_forces=() if fit.curve is None else fit.curve.found,
            read_as=fit.trajectory.read_as,
        )
        for fit, found in zip(fits, noticed, strict=True)
    ]
    logs = tuple(  # what was let through warns
        replace(fit, findings=tuple(replace(each, severity="warning") for each in found))
        for fit, found in zip(fits, noticed, strict=True)
    )
    return Identification(
        device=_stored(fits, hardware, records),
        logs=logs,
        findings=(*(each for log in logs for each in log.findings), *missing),
    )


def _check_request(
    trajectories: Sequence[Trajectory],
    hardware: Hardware | None,
    method: str,
    allow: Collection[str],
) -> None:
    if not trajectories:
        raise UsageError("logs", "none given", "Give at least one log")
    if method not in METHODS:
        problem = f"'{method}' is not available"
        raise UsageError("--method", problem, "Choose from " + ", ".join(METHODS))
    unknown = sorted(set(allow) - set(CODES))
    if unknown:
        problem = f"{', '.join(unknown)} is no finding"
        raise UsageError("--allow", problem, "Choose from " + ", ".join(CODES))
    for name in ("axis", "motion"):
        said = (getattr(log, name) for log in trajectories)
        seen = list(dict.fromkeys(item for item in said if item is not None))
        if len(seen) > 1:
            remedy = f"Give logs of one {name} at a time; each has its own device"
            raise UsageError(f"--{name}", f"the logs are of {' and '.join(seen)}", remedy)
        known = None if hardware is None else getattr(hardware, name)
        if seen and known is not None and known != seen[0]:
            problem = f"the logs are of {seen[0]}, the hardware of {known}"
            remedy = f"Give the logs and the hardware of one {name}"
            raise UsageError(f"--{name}", problem, remedy)


def _refuse(noticed: Sequence[Sequence[Finding]], allow: Collection[str]) -> None:
    findings = tuple(finding for found in noticed for finding in found)
    if any(each.severity == "refusal" and each.code not in allow for each in findings):
        raise LogRefusedError(findings)


def _stored(
    fits: Sequence[LogFit], hardware: Hardware | None, records: Sequence[LogRecord]
) -> Device:
    """The device as its file will hold it."""
    from pydantic import ValidationError

    from identification.fitting.several_logs import device_from

    try:
        return as_stored(device_from(fits, hardware, records))
    except ValidationError as error:
        problems = "; ".join(str(each["msg"]) for each in error.errors(include_url=False))
        raise InvalidInputError(
            ", ".join(fit.trajectory.source for fit in fits),
            f"gives numbers that no device has ({problems[:200]})",
            "Name the right columns, and give gains that make them SI",
        ) from None


def _moving(log: Trajectory, logs: Sequence[Trajectory], hardware: Hardware | None) -> Trajectory:
    """The log with the motion that the hardware, or else another of the logs, states."""
    stated = [None if hardware is None else hardware.motion, *(each.motion for each in logs)]
    motion = next((each for each in stated if each is not None), None)
    return log if log.motion == motion else replace(log, motion=motion)


def _clocked(trajectory: Trajectory, hardware: Hardware | None) -> Trajectory:
    """An even log on the sample time stated; an uneven one with its own stamps."""
    stated = None if hardware is None else hardware.sample_time
    if stated is None or isinstance(trajectory.steps, np.ndarray):
        return trajectory
    return replace(trajectory, time=np.arange(len(trajectory)) * stated.value)


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
    found: Identification | None = None
    try:
        found = identify(trajectory, hardware=hardware, method=method, allow=allow)
        findings, refused = found.findings, False
    except LogRefusedError as error:
        findings, refused = error.findings, True
        with suppress(LogRefusedError, InvalidInputError):  # then it tells nothing at all
            found = identify(trajectory, hardware=hardware, method=method, allow=CODES)
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


def _band(rows: ForceBalance) -> tuple[float, float]:
    """Frequencies between which the motion has its velocity, Hz."""
    step = float(np.median(np.diff(rows.time)))
    velocity = (rows.velocity - np.mean(rows.velocity)) * np.hanning(len(rows))
    power: NDArray[np.float64] = np.cumsum(np.abs(np.fft.rfft(velocity)) ** 2)
    frequency = np.fft.rfftfreq(len(rows), step)
    low = int(np.count_nonzero(power < _OUTSIDE * power[-1]))
    high = int(np.count_nonzero(power < (1 - _OUTSIDE) * power[-1]))
    return float(frequency[low]), float(frequency[min(high, frequency.size - 1)])
