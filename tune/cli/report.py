"""``haptune report``: a profile as one page to read, print and sign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from tune.cli.identify import identification_details, read_log
from tune.cli.log_options import LogOptions, with_log_options
from tune.cli.options import (
    Json,
    Quiet,
)
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from identification import Device, Hardware, Identification, LogColumns, Trajectory
    from tune.documents.profile import SafeProfile
    from tune.optimisation.alternatives import Alternative


@with_log_options()
def report(
    profile: Annotated[Path, typer.Argument(help="profile.yaml")],
    logs: Annotated[
        Optional[list[Path]],  # noqa: UP045 - typer reads it at run time
        typer.Argument(help="The logs its device was identified from: their fit is shown."),
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Where to write the page.")] = Path(
        "report.html"
    ),
    what_if: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--what-if",
            metavar="SCENE",
            help="The scene of the profile: also tune it with one fact of the hardware changed at "
            "a time, and show what each would bring.",
        ),
    ] = None,
    *,
    options: LogOptions,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """One page to sign, complete in itself, after the check; exit code 6 if that fails."""

    def action(session: Session) -> None:
        from identification import to_mapping
        from tune.certificate.check import check
        from tune.cli.device_table import half_widths
        from tune.cli.report_page import page_of
        from tune.presentation.page import html_of

        given = logs or []
        session.target(output, profile, *given, what_if)
        columns = options.columns()
        with session.progress() as say:
            say("re-computing the certificate")
            safe = check(profile).profile
            say("reading logs")
            trajectories = [_own_log(path, columns, safe, profile) for path in given]
            say("identifying")
            found = _identify_again(safe.device, trajectories)
        if found is not None:
            session.add_findings(found.findings)
        alternatives = None if what_if is None else _alternatives(session, safe, what_if)
        with session.progress() as say:
            say("drawing")
            text = html_of(page_of(safe, found, alternatives))
        session.details |= {} if found is None else identification_details(found)
        session.details |= {
            "profile": to_mapping(safe),
            "half_widths": half_widths(safe.device),
        }
        session.store(output, text.encode())
        session.say(
            f"{profile} passed its check. Open the page in a browser, read it, print it and sign it"
        )

    run_command("report", action, as_json=json, quiet=quiet)


def _own_log(path: Path, columns: LogColumns, safe: SafeProfile, profile: Path) -> Trajectory:
    """A log of the profile's device.

    Raises:
        InvalidInputError: another log than the device was identified from.
    """
    from identification import InvalidInputError

    device = safe.device
    trajectory = read_log(path, columns, _hardware_of(device))
    known = {log.digest: log.source for log in device.logs}
    if trajectory.digest not in known:
        names = ", ".join(known.values()) or "none that is known"
        raise InvalidInputError(
            path,
            f"is not what the device of {profile} was identified from ({names}): its content is "
            "another",
            "Give those logs, or none",
        )
    return trajectory


def _hardware_of(device: Device) -> Hardware:
    """What was known of a device before its logs were read."""
    from identification import Hardware, parse_document, to_mapping

    stated = to_mapping(device)
    kept = (name for name in Hardware.model_fields if name in stated)
    return parse_document(Hardware, {name: stated[name] for name in kept}, device.name)


def _identify_again(device: Device, logs: list[Trajectory]) -> Identification | None:
    """What the logs tell, with what was stated and allowed then; None without logs."""
    from identification import identify

    if not logs:
        return None
    allowed = {code for log in device.logs for code in log.allowed}
    return identify(logs, hardware=_hardware_of(device), allow=allowed)


def _alternatives(session: Session, safe: SafeProfile, scene_file: Path) -> tuple[Alternative, ...]:
    """The scene tuned anew with one fact of the hardware changed at a time.

    Raises:
        UsageError: the scene of another profile.
    """
    from identification import UsageError
    from tune.cli.options import MarginChoice
    from tune.cli.tune import read_request
    from tune.cli.what_if import say_what_would_help

    wish = read_request(scene_file, MarginChoice(safe.margin.name))
    strange = sorted(set(safe.elements) - set(wish.scene.elements))
    if strange:
        raise UsageError(
            "--what-if",
            f"{scene_file} has no element {', '.join(strange)}, which the profile has",
            "Give the scene that the profile was tuned for",
        )
    return say_what_would_help(session, safe, wish.scene, wish.table)
