"""``haptune new``: commented templates to fill in."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Optional

import typer

from tune.cli.options import DryRun, Json, Quiet
from tune.cli.session import Session, run_command


class Kind(StrEnum):
    """Files that have a template."""

    hardware = "hardware"
    scene = "scene"
    excitation = "excitation"


def new(
    kind: Annotated[Kind, typer.Argument(help="What to write.")],
    device: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it at run time
        typer.Option("--device", help="Fill in the hardware of a known device, such as homerehab."),
    ] = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("-o", "--output", help="Where to write; default KIND.yaml."),
    ] = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a commented template of hardware.yaml, scene.yaml or excitation.yaml."""

    def action(session: Session) -> None:
        from identification import UsageError, named_devices

        path = output or Path(f"{kind.value}.yaml")
        if device is not None and kind is not Kind.hardware:
            raise UsageError("--device", f"fills in hardware, not a {kind.value}", "Leave it out")
        session.target(path)
        text = template(kind.value) if device is None else hardware_of(device)
        session.write(path, text, dry_run=dry_run)
        if kind is Kind.hardware and device is None:
            session.say(f"known devices for --device: {', '.join(named_devices())}")

    run_command("new", action, as_json=json, quiet=quiet)


def template(kind: str) -> str:
    """Text of a template."""
    from importlib.resources import files

    return (files("tune") / "templates" / f"{kind}.yaml").read_text(encoding="utf-8")


def hardware_of(name: str) -> str:
    """The hardware part of a known device as YAML."""
    from identification import Hardware, load_device, to_mapping, to_yaml

    device = load_device(name)
    hardware = Hardware(
        name=device.name,
        axis=device.axis,
        motion=device.motion,
        sample_time=device.sample_time,
        delay=device.delay,
        encoder_resolution=device.encoder_resolution,
        force_limit=device.force_limit,
        modes=device.modes,
        current_lag=device.current_lag,
    )
    return to_yaml(to_mapping(hardware), f"Hardware of the known device {name}; check it on yours.")
