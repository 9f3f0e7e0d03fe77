"""``haptune new``: commented templates to fill in, and a program that plays a planned force."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Optional

import typer

from tune.cli.options import DryRun, Json, Quiet
from tune.cli.session import Session, run_command

#: How far each known device is moved from its middle, m (rad): room that it has by its size.
_ROOM = {"emps": 0.1, "homerehab": 0.1, "knob": 1.0, "stylus": 0.03}


#: Parts of the stiffness that the continuous force allows, of which a soft spring is one.
_SOFT = 20.0


class Kind(StrEnum):
    """Files that have a template."""

    hardware = "hardware"
    scene = "scene"
    excitation = "excitation"
    player = "player"


class Language(StrEnum):
    """Languages of the player."""

    c = "c"
    python = "python"


#: Endings of the player's files.
_ENDINGS = {Language.c: "c", Language.python: "py"}


def new(
    kind: Annotated[Kind, typer.Argument(help="What to write.")],
    device: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it at run time
        typer.Option("--device", help="Fill in what suits a known device, such as homerehab."),
    ] = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "-o", "--output", help="Where to write; default KIND.yaml, player.c or player.py."
        ),
    ] = None,
    language: Annotated[
        Optional[Language],  # noqa: UP045
        typer.Option("--language", help="Of the player; default c."),
    ] = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a commented template of hardware.yaml, scene.yaml or excitation.yaml, or a player."""

    def action(session: Session) -> None:
        from identification import UsageError, named_devices

        if language is not None and kind is not Kind.player:
            raise UsageError("--language", f"is of no {kind.value}", "Leave it out")
        if device is not None and kind is Kind.player:
            raise UsageError("--device", "fills in no player", "Leave it out")
        if kind is Kind.player:
            path = output or Path(f"player.{_ENDINGS[language or Language.c]}")
            session.target(path)
            text = template("player", _ENDINGS[language or Language.c])
            session.write(path, text, dry_run=dry_run)
            session.say("fill in how your device is read and driven; haptune never drives it")
            return
        path = output or Path(f"{kind.value}.yaml")
        session.target(path)
        filled = {Kind.hardware: hardware_of, Kind.scene: scene_of, Kind.excitation: excitation_of}
        text = template(kind.value) if device is None else filled[kind](device)
        session.write(path, text, dry_run=dry_run)
        if kind is not Kind.scene and device is None:
            known = ", ".join(named_devices())
            session.say(f"fill in what is blank; known devices for --device: {known}")

    run_command("new", action, as_json=json, quiet=quiet)


def template(kind: str, ending: str = "yaml") -> str:
    """Text of a template."""
    from importlib.resources import files

    return (files("tune") / "templates" / f"{kind}.{ending}").read_text(encoding="utf-8")


def excitation_of(name: str) -> str:
    """The template of an excitation with what is known of a device filled in.

    Raises:
        UsageError: a device file, of which nobody said how far it may be moved.
    """
    from numpy import format_float_positional

    from identification import UsageError, load_device, named_devices

    if name not in named_devices():
        raise UsageError(
            "--device", f"{name} is no known device", f"Give one of {', '.join(named_devices())}"
        )
    device = load_device(name)
    limit, count = device.force_limit, device.encoder_resolution
    assert limit is not None
    assert count is not None
    guesses = (device.mass, device.damping, device.coulomb_friction)
    numbers = {
        "sample_time": device.sample_time.value,
        "force": limit.continuous,
        "travel": _ROOM[name],
        "encoder_resolution": count.value,
    }
    known = {"name": name, "axis": device.axis, "motion": device.motion}
    known |= {key: format_float_positional(value, trim="0") for key, value in numbers.items()}
    for key, guess in zip(("mass", "damping", "coulomb_friction"), guesses, strict=True):
        ends = (guess.value, guess.low, guess.high)
        value, low, high = (format_float_positional(each, trim="0") for each in ends)
        known[key] = f"{{value: {value}, low: {low}, high: {high}}}"
    lines = [f"# Guesses and limits of the known device {name}; check all of them on yours."]
    assumed = [key for key in device.assumed() if key in known]
    lines += [f"# Assumed, not known: {', '.join(assumed)}."] if assumed else []
    for line in template("excitation").splitlines():
        key, colon, rest = line.partition(":")
        if not colon or key not in known:
            lines.append(line)
            continue
        comment = rest.partition("#")[2]
        kept = f"#{comment}" if comment and "such as" not in comment else ""
        lines.append(f"{key + ': ' + known[key]:<31} {kept}".rstrip())
    return "\n".join(lines) + "\n"


def scene_of(name: str) -> str:
    """The template of a scene with sizes and motions that suit a known device or a device file."""
    from identification import load_device
    from tune.documents.effects import UNITS, format_number
    from tune.documents.perception import SCALE_DEPTH, default_table
    from tune.documents.scene import DEFAULT_MOTION

    device = load_device(name)
    units, motion = UNITS[device.motion], DEFAULT_MOTION[device.motion]
    depth, damping = SCALE_DEPTH[device.motion], device.damping.value
    noticed = f"ripple_limit: {format_number(default_table().threshold(device.motion))}"
    sizes = {
        "(m/s)": f"({units['speed']})",
        "how deep (m)": f"how deep ({units['length']})",
        "penetration: 0.01": f"penetration: {depth:g}",
        "speed: 0.2": f"speed: {motion.speed:.1f}",
        "acceleration: 2.0": f"acceleration: {motion.acceleration:.1f}",
        "ripple_limit: 0.1         # N rms": f"{'# ' + noticed:<25} # {units['force']} rms",
    }
    for factor, written in ((1, "10.0"), (3, "30.0"), (2, "20.0")):
        sizes[f"damping: {written}"] = f"damping: {format_number(factor * damping)}"
    if device.force_limit is not None:
        stiffest = device.force_limit.continuous / depth
        softest = stiffest / _SOFT
        within = f"{{min: {format_number(softest)}, max: {format_number(stiffest)}}}"
        sizes["stiffness: {min: 200.0, max: 1500.0}"] = f"stiffness: {within}"
    above, elements, below = template("scene").partition("ripple_limit:")
    below = elements + below
    for before, after in sizes.items():
        below = below.replace(before, after)
    return f"# Sizes suit {name}; choose your own.\n{above}{below}"


def hardware_of(name: str) -> str:
    """The hardware part of a device as YAML, without what nobody stated of it."""
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
    ).model_copy(update=dict.fromkeys(device.unstated()))
    return to_yaml(to_mapping(hardware), f"Hardware of the known device {name}; check it on yours.")
