"""``haptune identify``: logs → device."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tune.cli.options import (
    Allow,
    Axis,
    DeviceOut,
    Force,
    ForceGain,
    HardwareFile,
    Json,
    Logs,
    Method,
    MethodOption,
    Position,
    PositionGain,
    Quiet,
    Reference,
    Time,
)
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from identification import Identification


def identify(
    logs: Logs,
    output: DeviceOut = Path("device.yaml"),
    time: Time = "time",
    force: Force = "force",
    position: Position = "position",
    reference: Reference = None,
    force_gain: ForceGain = 1.0,
    position_gain: PositionGain = 1.0,
    axis: Axis = None,
    hardware: HardwareFile = None,
    allow: Allow = None,
    method: MethodOption = Method.auto,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Mass, damping and friction with 95 % intervals; several logs of one axis give the envelope."""

    def action(session: Session) -> None:
        from identification import LogColumns, to_mapping, to_yaml

        columns = LogColumns(
            time=time,
            force=force,
            position=position,
            reference=reference,
            force_gain=force_gain,
            position_gain=position_gain,
            axis=axis,
        )
        result = identified(session, logs, columns, hardware, method, allow or [])
        session.write(output, device_yaml(to_yaml, to_mapping(result.device)))

    run_command("identify", action, as_json=json, quiet=quiet)
