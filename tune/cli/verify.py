"""``haptune verify``: a closed-loop log of the real device against its profile."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from tune.cli.options import Axis, Force, ForceGain, Json, Position, PositionGain, Quiet, Time
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from rich.table import Table

    from tune.verification import Verification


def verify(
    profile: Annotated[Path, typer.Argument(help="profile.yaml")],
    log: Annotated[
        Path,
        typer.Argument(
            help="Log of an element played at reduced gain: handle displaced or pushed, hand off."
        ),
    ],
    element: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it at run time
        typer.Option(
            "--element", metavar="NAME", help="Element played, A+B for two; default: found out."
        ),
    ] = None,
    gain: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option("--gain", metavar="X", help="Gain it was played at; default: found out."),
    ] = None,
    release: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            "--release",
            metavar="SECONDS",
            help="When the hand let go, in the time of the log; default: largest displacement.",
        ),
    ] = None,
    time: Time = "time",
    force: Force = "force",
    position: Position = "position",
    force_gain: ForceGain = 1.0,
    position_gain: PositionGain = 1.0,
    axis: Axis = None,
    picture: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--picture", help="Where to draw motion and force against them (PNG)."),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Does a low-gain closed-loop log behave as the profile predicts? Ends with 6 if not."""

    def action(session: Session) -> None:
        from identification import LogColumns, load_trajectory
        from tune.documents.errors import CheckFailedError
        from tune.documents.profile import load_profile
        from tune.verification import verification_picture, verify

        if picture is not None:
            session.target(picture, profile, log)
        safe = load_profile(profile)
        columns = LogColumns(
            time=time,
            force=force,
            position=position,
            force_gain=force_gain,
            position_gain=position_gain,
            axis=axis,
        )
        with session.progress() as say:
            say(f"comparing {log.name} with {profile.name}")
            trajectory = load_trajectory(
                log, columns, motion=safe.device.motion, axis=axis or safe.device.axis
            )
            seen = verify(safe, trajectory, element=element, gain=gain, release=release)
            drawing = None if picture is None else verification_picture(safe, seen)
        session.say(_table(seen))
        session.details |= _plain(seen)
        if picture is not None and drawing is not None:
            session.draw(picture, drawing)
        if seen.disagreements:
            raise CheckFailedError(tuple(str(each) for each in seen.disagreements))
        seen.refuse_unassessed()
        session.say(f"{log.name} behaves as {profile.name} predicts, where it was assessed")

    run_command("verify", action, as_json=json, quiet=quiet)


def _table(seen: Verification) -> Table:
    """One row a comparison."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=f"{seen.source}: {'+'.join(seen.elements)}", title_justify="left", box=SIMPLE_HEAD
    )
    for heading in ("check", "verdict", "seen", "predicted", "tolerance"):
        table.add_column(heading, no_wrap=heading in {"check", "verdict"}, overflow="fold")
    for each in seen.outcomes:
        table.add_row(each.check, each.verdict, each.seen, each.predicted, each.tolerance)
    return table


def _plain(seen: Verification) -> dict[str, object]:
    """The comparison for the JSON result."""
    from dataclasses import asdict
    from math import isfinite

    return {
        "log": seen.source,
        "elements": list(seen.elements),
        "gain": seen.gain if isfinite(seen.gain) else None,
        "checks": [asdict(each) for each in seen.outcomes],
    }
