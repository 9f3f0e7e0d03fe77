"""``haptune check``: re-compute a profile by the independent path."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tune.cli.options import Json, Quiet
from tune.cli.session import Session, run_command


def check(
    profile: Annotated[Path, typer.Argument(help="profile.yaml")],
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Re-compute digest, certificate, margins and what is felt; exit code 6 if anything differs."""

    def action(session: Session) -> None:
        from tune.certificate.check import check as recheck
        from tune.cli.tables import certificate_lines, elements_table

        with session.progress() as say:
            say("re-computing the certificate")
            report = recheck(profile)
        session.say(elements_table(report.profile))
        for line in certificate_lines(report.certificate):
            session.say(line)
        session.say(f"{profile} passed: digest, certificate, margins and what is felt hold")

    run_command("check", action, as_json=json, quiet=quiet)
