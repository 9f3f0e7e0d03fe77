"""``haptune check``: re-compute a profile by the independent path."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from tune.cli.drawing import draw_profile, target_picture
from tune.cli.options import Json, Picture, Quiet
from tune.cli.session import Session, run_command


def check(
    profile: Annotated[Path, typer.Argument(help="profile.yaml")],
    device: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it at run time
        typer.Option(
            "--device",
            metavar="DEVICE",
            help="device.yaml, or the name of a known device: it must be the profile's, and the "
            "rehearsal is repeated.",
        ),
    ] = None,
    picture: Picture = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Re-compute all that a profile says; exit code 6 if anything differs."""

    def action(session: Session) -> None:
        from identification import as_stored, load_device, to_mapping
        from tune.certificate.check import OPINIONS, TAKEN_ON_TRUST
        from tune.certificate.check import check as recheck
        from tune.cli.rehearse import refuse_restless
        from tune.cli.tables import certificate_lines, elements_table

        target_picture(session, picture, profile, None if device is None else Path(device))
        known = None if device is None else as_stored(load_device(device))
        with session.progress() as say:
            say("re-computing the certificate")
            report = recheck(profile, known)
            if known is not None:
                refuse_restless(report.profile, say)
        session.details["profile"] = to_mapping(report.profile)
        session.details["certificate"] = to_mapping(report.certificate)
        session.say(elements_table(report.profile))
        for line in certificate_lines(report.certificate):
            session.say(line)
        trusted = {
            each.key: each.reason
            for each in TAKEN_ON_TRUST
            if known is None or each.key != "device"
        }
        session.details["taken_on_trust"] = trusted
        for key, reason in trusted.items():
            session.say(f"taken on trust: {key}: {reason}")
        session.details["not_checked"] = {each.key: each.reason for each in OPINIONS}
        for each in OPINIONS:
            session.say(f"not checked: {each.key}: {each.reason}")
        if known is not None:
            session.details["rehearsed"] = "settles"
            session.say(f"the device is {device}; rehearsed in simulation: settles")
        if picture is not None:
            draw_profile(session, picture, report.profile)
        session.say(f"{profile} passed: all else that it says is what was found anew")

    run_command("check", action, as_json=json, quiet=quiet)
