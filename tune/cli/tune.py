"""``haptune tune``: device + scene → profile."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tune.cli.options import DryRun, Json, MarginChoice, MarginOption, ProfileOut, Quiet
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from identification import Device
    from tune.profile import SafeProfile


def tune(
    device: Annotated[str, typer.Argument(help="device.yaml, or the name of a known device.")],
    scene: Annotated[Path, typer.Argument(help="scene.yaml")],
    output: ProfileOut = Path("profile.yaml"),
    margin: MarginOption = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """The largest perceivable effects of a scene that are safe on a device."""

    def action(session: Session) -> None:
        from identification import load_device

        session.target(output, scene, Path(device))
        profile = tuned(session, load_device(device), scene, margin)
        session.write(output, profile.to_yaml(), dry_run=dry_run)

    run_command("tune", action, as_json=json, quiet=quiet)


def tuned(
    session: Session, device: Device, scene_file: Path, margin: MarginChoice | None
) -> SafeProfile:
    """Tune, show the result and return it; shared with calibrate and demo."""
    from tune.cli.tables import certificate_lines, elements_table
    from tune.optimisation import optimise
    from tune.scene import load_scene, perception_of

    scene = load_scene(scene_file)
    if margin is not None:
        scene = scene.model_copy(update={"margin": margin.value})
    table = perception_of(scene, scene_file.parent)
    with session.progress() as say:
        profile = optimise(device, scene, table=table, progress=say)
    session.say(elements_table(profile))
    for note in profile.notes:
        session.say(note)
    for line in certificate_lines(profile.certificate):
        session.say(line)
    return profile
