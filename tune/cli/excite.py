"""``haptune excite``: plan the force of a calibration within limits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

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
        session.say(excitation_table(plan))
        session.say(prediction_line(plan))
        if dry_run:  # thousands of rows would tell nobody anything
            session.say(f"dry run: {output} would be written, {text.count(chr(10)) - 1} rows")
            return
        session.write(output, text)
        if picture is not None and drawing is not None:
            session.draw(picture, drawing)

    run_command("excite", action, as_json=json, quiet=quiet)


def excitation_table(plan: Excitation) -> Table:
    """One row a family: bound of both intervals, and how much of the limits is used."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    spec = plan.spec
    from tune.cli.tables import UNITS

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


def prediction_line(plan: Excitation) -> str:
    """The interval predicted for both, and what the prediction rests on."""
    spec = plan.spec
    from tune.cli.tables import UNITS

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
