"""``haptune identify``: logs → device."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tune.cli.drawing import device_in, draw_identified, target_picture
from tune.cli.log_options import LogOptions, with_log_options
from tune.cli.options import (
    Allow,
    DeviceOut,
    DryRun,
    HardwareFile,
    Json,
    Logs,
    MethodOption,
    Picture,
    Quiet,
)
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from identification import (
        Device,
        Hardware,
        Identification,
        LogColumns,
        LogFit,
        Method,
        Trajectory,
    )
    from tune.documents.results import IdentifyDetails, LogIdentified


DEVICE_COMMENT = "Device identified by haptune; intervals are 95 % each, the covariance is joint."


@with_log_options()
def identify(
    logs: Logs,
    output: DeviceOut = Path("device.yaml"),
    *,
    options: LogOptions,
    hardware: HardwareFile = None,
    allow: Allow = None,
    method: MethodOption = "auto",
    picture: Picture = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Mass, damping and friction with 95 % intervals; several logs give their envelope."""

    def action(session: Session) -> None:
        from identification import to_mapping, to_yaml

        session.target(output, *logs, hardware)
        target_picture(session, picture, *logs, hardware, output)
        columns = options.columns()
        result = identify_logs(session, logs, columns, hardware, method, allow or [])
        if result.device.position_stiffness is not None or result.device.gravity is not None:
            _warn_of_refusal(session, result.device)
        before = None if picture is None else device_in(output)
        session.write(output, to_yaml(to_mapping(result.device), DEVICE_COMMENT), dry_run=dry_run)
        if picture is not None:
            draw_identified(session, picture, result, before)

    run_command("identify", action, as_json=json, quiet=quiet)


def _warn_of_refusal(session: Session, device: Device) -> None:
    from tune.certificate.assumptions import refusal_of

    refusal = refusal_of(device)
    if refusal is not None:
        session.warn(f"tune will refuse this device: {refusal}")


def read_log(path: Path, columns: LogColumns, hardware: Hardware | None) -> Trajectory:
    """One log, of the motion and axis of its hardware; shared with doctor."""
    from identification import load_trajectory

    return load_trajectory(
        path,
        columns,
        motion=None if hardware is None else hardware.motion,
        axis=columns.axis or (None if hardware is None else hardware.axis),
    )


def tell_reading(session: Session, *trajectories: Trajectory) -> None:
    """One line a log that is no plain table in SI units: how it was understood."""
    for log in trajectories:
        if log.read_as:
            session.say(f"{log.source}: read with {log.read_as}")
            session.understood[log.source] = log.read_as
            session.details["read_as"] = session.understood


def identify_logs(
    session: Session,
    logs: list[Path],
    columns: LogColumns,
    hardware: Path | None,
    method: Method,
    allow: list[str],
) -> Identification:
    """Read logs, identify and show the result; shared with calibrate and demo."""
    from identification import Hardware, load_document
    from identification import identify as estimate
    from tune.cli.device_table import device_table

    known = None if hardware is None else load_document(Hardware, hardware)
    with session.progress() as say:
        say("reading logs")
        trajectories = [read_log(path, columns, known) for path in logs]
    tell_reading(session, *trajectories)
    with session.progress() as say:
        say("identifying")
        result = estimate(trajectories, hardware=known, method=method, allow=allow)
    session.add_findings(result.findings)
    session.details |= identification_details(result)
    session.say(device_table(result.device))
    session.say(f"method: {result.method}; {result.reason}")
    for fit in result.logs:
        for other in fit.others:
            session.say(
                f"{fit.trajectory.source}, {other.method}: mass {other.value('mass'):.5g}, "
                f"damping {other.value('damping'):.5g}"
            )
        for sentence in fit.structure.sentences if fit.structure else ():
            session.say(f"{fit.trajectory.source}: {sentence}")
    return result


def identification_details(found: Identification) -> IdentifyDetails:
    """The device as its file will hold it, and how each log was identified; shared with report."""
    from identification import to_mapping
    from tune.cli.device_table import half_widths

    return {
        "device": to_mapping(found.device),
        "half_widths": half_widths(found.device),
        "method": found.method,
        "logs": [_log_details(fit) for fit in found.logs],
    }


def _log_details(fit: LogFit) -> LogIdentified:
    return {
        "source": fit.trajectory.source,
        "method": fit.method,
        "reason": fit.reason,
        "fitted": fit.fitted,
        "others": [
            {
                "method": other.method,
                "mass": float(other.value("mass")),
                "damping": float(other.value("damping")),
            }
            for other in fit.others
        ],
        "structure": list(fit.structure.sentences) if fit.structure else [],
    }
