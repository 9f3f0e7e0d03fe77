"""The one verb: mass, damping, friction and delay of an axis from its logs, with intervals.

One file: the steps of one verb, in their order.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.device.device import Device, Hardware
from identification.device.evidence import LogRecord
from identification.documents.document import as_stored
from identification.errors import Finding, InvalidInputError, LogRefusedError, UsageError
from identification.estimators import METHODS, Method
from identification.estimators.model import Estimate
from identification.findings import CODES, inspect
from identification.fitting.one_log import LogFit, fit_log
from identification.readers.sizes import refuse_sizes
from identification.trajectory import Trajectory


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
    _refuse([finding for found in noticed for finding in found], allow)
    fits = [fit_log(_clocked(log, hardware), hardware, method) for log in trajectories]
    noticed = [
        found + tuple(each.of(fit.trajectory.source) for each in fit.findings)
        for found, fit in zip(noticed, fits, strict=True)
    ]
    _refuse([finding for found in noticed for finding in found], allow)
    _refuse_negative_mass(fits, noticed)

    from identification.fitting.several_logs import unstated_warnings

    sources = ", ".join(log.source for log in trajectories)
    missing = tuple(each.of(sources) for each in unstated_warnings(fits, hardware))
    findings = (*(_lenient(finding) for found in noticed for finding in found), *missing)
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
    return Identification(
        device=_stored(fits, hardware, records),
        logs=tuple(
            replace(fit, findings=tuple(_lenient(finding) for finding in found))
            for fit, found in zip(fits, noticed, strict=True)
        ),
        findings=findings,
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
        raise UsageError(
            "--method", f"'{method}' is not available", "Choose from " + ", ".join(METHODS)
        )
    unknown = sorted(set(allow) - set(CODES))
    if unknown:
        raise UsageError(
            "--allow", f"{', '.join(unknown)} is no finding", "Choose from " + ", ".join(CODES)
        )
    for name in ("axis", "motion"):
        said = (getattr(log, name) for log in trajectories)
        seen = list(dict.fromkeys(item for item in said if item is not None))
        if len(seen) > 1:
            raise UsageError(
                f"--{name}",
                f"the logs are of {' and '.join(seen)}",
                f"Give logs of one {name} at a time; each has its own device",
            )
        known = None if hardware is None else getattr(hardware, name)
        if seen and known is not None and known != seen[0]:
            raise UsageError(
                f"--{name}",
                f"the logs are of {seen[0]}, the hardware of {known}",
                f"Give the logs and the hardware of one {name}",
            )


def _refuse(findings: Sequence[Finding], allow: Collection[str]) -> None:
    if any(each.severity == "refusal" and each.code not in allow for each in findings):
        raise LogRefusedError(tuple(findings))


def _refuse_negative_mass(fits: Sequence[LogFit], noticed: Sequence[Sequence[Finding]]) -> None:
    """No permission makes a device out of a mass that is not positive."""
    if any(fit.estimate.value("mass") <= 0 for fit in fits):
        raise LogRefusedError(tuple(finding for found in noticed for finding in found))


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


def _lenient(finding: Finding) -> Finding:
    """A finding that was let through."""
    return replace(finding, severity="warning")


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
