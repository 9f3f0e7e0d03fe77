"""``haptune excite``: plan the force of a calibration within limits.

One file: one command: its options, tables and exit codes.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from tune.cli.drawing import draw
from tune.cli.options import DryRun, Json, Quiet
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from rich.table import Table

    from identification import Excitation


def excite(
    spec: Annotated[Path, typer.Argument(help="Limits and guesses; see 'haptune new excitation'.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Where to write the force (CSV).")
    ] = Path("force.csv"),
    picture: Annotated[
        Optional[Path],  # noqa: UP045 - typer reads it at run time
        typer.Option("--picture", help="Where to draw force and predicted motion (PNG)."),
    ] = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Plan a force that tells mass and damping best within limits. Drives no hardware."""

    def action(session: Session) -> None:
        from identification import (
            excitation_picture,
            force_text,
            load_excitation,
            plan_excitation,
        )

        session.target(output, spec)
        if picture is not None:
            session.target(picture, spec, output)
        wanted = load_excitation(spec)
        with session.progress() as say:
            plan = plan_excitation(wanted, progress=say)
            text = force_text(plan)
            drawing = None if picture is None else excitation_picture(plan)
        session.details |= plan_details(plan) | {"rows": text.count("\n") - 1}
        session.say(excitation_table(plan))
        session.say(prediction_line(plan))
        session.say(worst_table(plan))
        if plan.beyond and wanted.device is None:
            session.warn(beyond_limits(plan))
        if wanted.gentle:
            session.say(next_step(plan))
        if dry_run:  # thousands of rows would tell nobody anything
            session.say(f"dry run: {output} would be written, {text.count(chr(10)) - 1} rows")
            return
        session.write(output, text)
        if picture is not None and drawing is not None:
            draw(session, picture, drawing)

    run_command("excite", action, as_json=json, quiet=quiet)


def excitation_table(plan: Excitation) -> Table:
    """One row a family: bound of both intervals, and how much of the limits is used."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    spec = plan.spec
    from tune.documents.effects import UNITS

    units = UNITS[spec.motion]
    mass, damping = units["mass"], units["damping"]
    table = Table(
        title=f"{spec.name}, axis {spec.axis}: {spec.duration:g} s, least 95 % intervals "
        "any estimator can reach; the first is played",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    headings = ("signal", "frequencies", f"mass, {mass}", f"damping, {damping}")
    for heading in (*headings, "force", "travel", "speed"):
        side = "left" if heading in headings[:2] else "right"
        table.add_column(heading, justify=side, overflow="fold")
    for each in plan.candidates:
        used = each.used
        table.add_row(
            each.family,
            each.description,
            f"± {each.prediction.mass:.3g}",
            f"± {each.prediction.damping:.3g}",
            f"{used.force:.0%}",
            f"{used.travel:.0%}",
            "-" if spec.speed is None else f"{used.speed:.0%}",
        )
    return table


def worst_table(plan: Excitation) -> Table:
    """One row a set of devices: how far and how fast the played force moves the worst of them."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    spec = plan.spec
    from tune.documents.effects import UNITS

    units = UNITS[spec.motion]
    table = Table(
        title="the played force on a device that is not as guessed: farthest and fastest",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for heading in ("device", f"travel, {units['length']}", "of it", units["speed"], "of it"):
        side = "left" if heading == "device" else "right"
        table.add_column(heading, justify=side, overflow="fold")
    for each in plan.worst:
        table.add_row(
            each.words,
            f"{each.travel:.3g}",
            f"{each.travel / spec.travel:.0%}",
            f"{each.speed:.3g}",
            "-" if spec.speed is None else f"{each.speed / spec.speed:.0%}",
        )
    return table


def beyond_limits(plan: Excitation) -> str:
    """What would leave the limits, by how much, and what to do about it."""
    spec = plan.spec
    from tune.documents.effects import UNITS

    units = UNITS[spec.motion]
    allowed = f"travel {spec.travel:g} {units['length']}"
    if spec.speed is not None:
        allowed += f", speed {spec.speed:g} {units['speed']}"
    seen = "; ".join(
        f"{each.words}: {each.travel:.2g} {units['length']}, {each.speed:.2g} {units['speed']}"
        for each in plan.beyond
    )
    return (
        f"this force may drive a device that is not as guessed against its end stops: {seen}; "
        f"allowed: {allowed}. Plan a gentle first play with gentle: true and name the device "
        "identified from its log with device: FILE; or widen the guesses to what they may be, "
        "shorten the duration (a constant force makes a device without a spring drift all along), "
        "lower the force or allow more travel"
    )


def next_step(plan: Excitation) -> str:
    """What a gentle play is for."""
    spec = plan.spec
    from tune.documents.effects import UNITS

    return (
        f"gentle first play, at most {spec.force:.3g} {UNITS[spec.motion]['force']} for "
        f"{spec.duration:g} s: identify its log (haptune identify LOG --force-gain 1 -o "
        "first.yaml; so small a force looks like amperes), then put device: first.yaml in the "
        "place of gentle: true and plan the full force for the device identified"
    )


def plan_details(plan: Excitation) -> dict[str, object]:
    """Every number of the tables, SI."""
    spec = plan.spec
    mass, damping = plan.best.prediction.stated
    return {
        "duration": spec.duration,
        "limits": {"force": spec.force, "travel": spec.travel, "speed": spec.speed},
        "candidates": [
            {
                "signal": each.family,
                "frequencies": each.description,
                "band_hz": each.band,
                "lines": each.lines,
                "mass": each.prediction.mass,
                "damping": each.prediction.damping,
                "force_used": each.used.force,
                "travel_used": each.used.travel,
                "speed_used": None if spec.speed is None else each.used.speed,
            }
            for each in plan.candidates
        ],
        "guesses": {"mass": spec.mass.value, "damping": spec.damping.value},
        "predicted": {"mass": plan.mass, "damping": plan.damping},
        "stated": {"mass": mass, "damping": damping},
        "worst": [
            {
                "device": each.name,
                "words": each.words,
                "travel": each.travel,
                "speed": each.speed,
                "travel_used": each.travel / spec.travel,
                "speed_used": None if spec.speed is None else each.speed / spec.speed,
                "beyond": each in plan.beyond,
            }
            for each in plan.worst
        ],
    }


def prediction_line(plan: Excitation) -> str:
    """The interval predicted for both, and what the prediction rests on."""
    spec = plan.spec
    from tune.documents.effects import UNITS

    units = UNITS[spec.motion]
    mass, damping = units["mass"], units["damping"]
    stated = plan.best.prediction.stated
    parts = [
        f"{name} {guess:g} ± {half:.3g} {unit} (stated as ± {whole:.3g})"
        for name, guess, half, whole, unit in (
            ("mass", spec.mass.value, plan.mass, stated[0], mass),
            ("damping", spec.damping.value, plan.damping, stated[1], damping),
        )
    ]
    method = "output error" if spec.force_noise == 0 else "the innovations method"
    return (
        f"predicted 95 % intervals: {', '.join(parts)}; noise alone lets {method} reach the first, "
        "identify states the second, as it trusts no force beyond 2e-5 of it"
    )
