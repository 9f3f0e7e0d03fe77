"""``haptune calibrate``: logs + scene → profile, the main job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tune.cli.drawing import (
    device_in,
    draw_identified,
    draw_profile,
    further_picture,
    target_picture,
)
from tune.cli.identify import identify_logs
from tune.cli.log_options import LogOptions, with_log_options
from tune.cli.options import (
    Allow,
    Candidates,
    DryRun,
    HardwareFile,
    Json,
    Logs,
    MarginOption,
    MethodOption,
    Picture,
    ProfileOut,
    Quiet,
)
from tune.cli.session import Session, run_command
from tune.cli.tune import read_request, tune_device

if TYPE_CHECKING:
    from identification import Device, Identification
    from tune.documents.profile import SafeProfile

_IN_HARDWARE = (
    "State them in a hardware file and give it with --hardware ('haptune new hardware' writes the "
    "form):"
)


@with_log_options()
def calibrate(
    logs: Logs,
    scene: Annotated[Path, typer.Option("--scene", metavar="SCENE", help="scene.yaml")],
    output: ProfileOut = Path("profile.yaml"),
    *,
    options: LogOptions,
    hardware: HardwareFile = None,
    allow: Allow = None,
    method: MethodOption = "auto",
    margin: MarginOption = None,
    candidates: Candidates = False,
    picture: Picture = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Identify the device and tune the scene in one go; the device is kept inside the profile."""

    def action(session: Session) -> None:
        session.target(output, *logs, scene, hardware)
        inputs = (*logs, scene, hardware, output)
        target_picture(session, picture, *inputs)
        target_picture(session, picture and further_picture(picture, "profile"), *inputs)
        sheet = picture and further_picture(picture, "candidates") if candidates else None
        target_picture(session, sheet, *inputs)
        columns = options.columns()
        wish = read_request(scene, margin)
        found = identify_logs(session, logs, columns, hardware, method, allow or [])
        found.device.require_stated(
            subject=hardware or f"the device of {logs[0].name}", where=_IN_HARDWARE
        )
        profile = tune_device(session, found.device, wish, compare=candidates, sheet=sheet)
        before = None if picture is None else device_in(output)
        session.write(output, profile.to_yaml(), dry_run=dry_run)
        if picture is not None:
            _draw(session, picture, found, profile, before)

    run_command("calibrate", action, as_json=json, quiet=quiet)


def _draw(
    session: Session,
    picture: Path,
    found: Identification,
    profile: SafeProfile,
    before: Device | None,
) -> None:
    """Draw what was identified, and beside it (-profile) what was tuned."""
    draw_identified(session, picture, found, before)
    draw_profile(session, further_picture(picture, "profile"), profile)
