"""``haptune verify``: a closed-loop log of the real device against its profile.

One file: one command: its options, tables and exit codes.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from tune.cli.drawing import draw
from tune.cli.identify import tell_reading
from tune.cli.log_options import LogOptions, with_log_options
from tune.cli.options import (
    Json,
    Picture,
    Quiet,
)
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from rich.table import Table

    from tune.documents.profile import SafeProfile
    from tune.verification import Advice, Kept, Verification

#: Advice at less than this many times the gain that was played is no other advice.
_MORE = 1.02


@with_log_options(without=frozenset({"reference"}))
def verify(
    profile: Annotated[Path, typer.Argument(help="profile.yaml")],
    log: Annotated[
        Optional[Path],  # noqa: UP045 - typer reads it at run time
        typer.Argument(
            help="Log of an element played at reduced gain: handle displaced or pushed, hand off. "
            "Without one: says what to play."
        ),
    ] = None,
    element: Annotated[
        Optional[str],  # noqa: UP045
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
    *,
    options: LogOptions,
    picture: Picture = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Does a low-gain closed-loop log behave as the profile predicts? Ends with 6 if not."""

    def action(session: Session) -> None:
        from identification import UsageError, load_trajectory
        from tune.documents.errors import CheckFailedError
        from tune.documents.profile import load_profile
        from tune.verification import margins_of_others, verification_picture, verify

        if log is None:
            if picture is not None:
                raise UsageError("--picture", "there is no log to draw", "Give a LOG")
            _plan(session, load_profile(profile), element)
            return
        if picture is not None:
            session.target(picture, profile, log)
        safe = load_profile(profile)
        columns = options.columns()
        trajectory = load_trajectory(
            log, columns, motion=safe.device.motion, axis=columns.axis or safe.device.axis
        )
        tell_reading(session, trajectory)
        with session.progress() as say:
            say(f"comparing {log.name} with {profile.name}")
            seen = verify(safe, trajectory, element=element, gain=gain, release=release)
            others = margins_of_others(safe, seen.delay, say)
            drawing = None if picture is None else verification_picture(safe, seen)
        session.say(_table(seen))
        session.details |= _plain(seen, others)
        if picture is not None and drawing is not None:
            draw(session, picture, drawing)
        if seen.disagreements:
            raise CheckFailedError((_disagreements(seen),))
        if not seen.assessed:
            seen.refuse_unassessed(_advice(session, safe, seen))
        session.say(
            f"{log.name} behaves as {profile.name} predicts, where it was assessed: "
            f"{'+'.join(seen.elements)} keeps its margin at every delay that the log allows"
        )
        for each in others:
            if each.lost_at is not None:
                session.say(
                    f"it does not tell this of {'+'.join(each.moment)}: were the delay "
                    f"{each.lost_at:.3g} samples, the margin would be lost"
                )

    run_command("verify", action, as_json=json, quiet=quiet)


def _plan(session: Session, safe: SafeProfile, element: str | None) -> None:
    """What to play for every element, or for the one named."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from tune.verification import advise
    from tune.verification.outcome import moments_of

    targets = None if element is None else moments_of(safe, element)
    with session.progress() as say:
        advice = advise(safe, targets, say)
    table = Table(title="what to play", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("to verify", no_wrap=True)
    table.add_column("play", overflow="fold")
    for each in advice:
        table.add_row("+".join(each.moment), each.words(safe.device.motion))
    session.say(table)
    session.details["play"] = [_plain_advice(each) for each in advice]


def _advice(session: Session, safe: SafeProfile, seen: Verification) -> str:
    """What to do where the log of a moment cannot tell."""
    from tune.verification import advise

    with session.progress() as say:
        (advice,) = advise(safe, (seen.elements,), say)
    session.details["play"] = [_plain_advice(advice)]
    allowed = seen.delay.allowed
    play = advice.play
    more = play is not None and (play.moment != seen.elements or play.gain > _MORE * seen.gain)
    if more or allowed is None or allowed.delays is None:
        return f"Instead: {advice.words(safe.device.motion)}."
    low, high = allowed.delays
    return (
        f"No gain tells more; state the delay of the device as {low:.3g} to {high:.3g} samples "
        "(value, low and high, in s) and tune again."
    )


def _disagreements(seen: Verification) -> str:
    """Each disagreement on a line of its own, its remedy below."""
    lines = [f"{seen.source} is not as the profile predicts"]
    for each in seen.disagreements:
        lines += [f"  {each.told}", *([f"    {each.remedy}"] if each.remedy else [])]
    return "\n".join(lines)


def _plain_advice(advice: Advice) -> dict[str, object]:
    from dataclasses import asdict

    return {
        "to_verify": list(advice.moment),
        "play": None if advice.play is None else asdict(advice.play),
        "why": advice.why,
    }


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


def _plain(seen: Verification, others: tuple[Kept, ...]) -> dict[str, object]:
    """The comparison for the JSON result."""
    from dataclasses import asdict
    from math import isfinite

    allowed = seen.delay.allowed
    return {
        "log": seen.source,
        "elements": list(seen.elements),
        "gain": seen.gain if isfinite(seen.gain) else None,
        "checks": [asdict(each) for each in seen.outcomes],
        "filters": [asdict(each) for each in seen.cutoffs],
        "delay": None if allowed is None or allowed.delays is None else list(allowed.delays),
        "longer_delays_not_looked_at": allowed is not None and allowed.open_ended,
        "margins": [asdict(each) for each in (seen.delay.played, *others) if each is not None],
    }
