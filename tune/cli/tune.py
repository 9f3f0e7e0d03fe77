"""``haptune tune``: device + scene → profile."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tune.cli.options import DryRun, Json, MarginChoice, MarginOption, ProfileOut, Quiet
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from identification import Device
    from tune.perception import PerceptionTable
    from tune.profile import SafeProfile
    from tune.scene import Scene


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
        profile = tuned(session, load_device(device), wanted(scene, margin))
        session.write(output, profile.to_yaml(), dry_run=dry_run)

    run_command("tune", action, as_json=json, quiet=quiet)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What is to be felt and how finely hands can tell; read before any log is."""

    scene: Scene
    table: PerceptionTable


def wanted(scene_file: Path, margin: MarginChoice | None) -> Wanted:
    """Read a scene and its perception table, the margin replaced where one is given."""
    from tune.scene import load_scene, perception_of

    scene = load_scene(scene_file)
    if margin is not None:
        scene = scene.model_copy(update={"margin": margin.value})
    return Wanted(scene=scene, table=perception_of(scene, scene_file.parent))


def tuned(session: Session, device: Device, wish: Wanted) -> SafeProfile:
    """Tune, show the result and return it; shared with calibrate and demo."""
    from tune.cli.tables import certificate_lines, elements_table
    from tune.optimisation import optimise

    with session.progress() as say:
        profile = optimise(device, wish.scene, table=wish.table, progress=say)
    session.say(elements_table(profile))
    for note in profile.notes:
        session.say(note)
    for line in certificate_lines(profile.certificate):
        session.say(line)
    return profile
