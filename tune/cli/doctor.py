"""``haptune doctor``: what logs can and cannot support."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tune.cli.drawing import draw, target_picture
from tune.cli.identify import read_log, tell_reading
from tune.cli.log_options import LogOptions, with_log_options
from tune.cli.options import (
    Allow,
    HardwareFile,
    Json,
    Logs,
    Picture,
    Quiet,
)
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from rich.table import Table

    from identification import Examination, Finding, Quantity, Trajectory
    from tune.documents.results import LogExamined


@with_log_options()
def doctor(
    logs: Logs,
    *,
    options: LogOptions,
    hardware: HardwareFile = None,
    allow: Allow = None,
    picture: Picture = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """What each log can and cannot support; ends with 4 if identify would refuse one."""

    def action(session: Session) -> None:
        from identification import (
            Hardware,
            LogRefusedError,
            examine,
            load_document,
        )
        from tune.cli.details import examination_result

        columns = options.columns()
        if picture is not None:
            for place in range(len(logs)):
                target_picture(session, numbered_picture(picture, place), *logs, hardware)
        known = None if hardware is None else load_document(Hardware, hardware)
        findings: list[Finding] = []
        examined: list[LogExamined] = []
        session.details["logs"] = examined
        refused = False
        for place, path in enumerate(logs):
            try:
                with session.progress() as say:
                    say(f"reading {path.name}")
                    trajectory = read_log(path, columns, known)
                tell_reading(session, trajectory)
                with session.progress() as say:
                    say(f"examining {path.name}")
                    seen = examine(trajectory, hardware=known, allow=allow or [])
            except LogRefusedError as error:  # the columns are no log at all
                findings += error.findings
                refused = True
                continue
            examined.append(examination_result(seen))
            session.say(_table(seen))
            session.say(_verdict(seen))
            if picture is not None:
                _draw(session, numbered_picture(picture, place), trajectory, seen)
            findings += seen.findings
            refused = refused or seen.refused
        if refused:
            raise LogRefusedError(tuple(findings))
        session.add_findings(tuple(findings))

    run_command("doctor", action, as_json=json, quiet=quiet)


def numbered_picture(picture: Path, place: int) -> Path:
    """The file of the picture of one log: as named for the first, with -2 and so on for others."""
    return picture if place == 0 else picture.with_stem(f"{picture.stem}-{place + 1}")


def _draw(session: Session, picture: Path, trajectory: Trajectory, seen: Examination) -> None:
    """Draw what identify makes of one log, or the log alone if it makes nothing of it."""
    from identification import identified_picture, log_picture

    with session.progress() as say:
        say("drawing")
        if seen.found is None:
            drawn = log_picture(trajectory)
        else:
            drawn = identified_picture(seen.found.device, seen.found.logs)
    draw(session, picture, drawn)


def _table(seen: Examination) -> Table:
    """What was measured, one row a quantity."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from tune.cli.tables import units_of

    units = units_of(seen.motion)
    table = Table(title=seen.source, title_justify="left", box=SIMPLE_HEAD)
    table.add_column("seen in the log", overflow="fold")
    table.add_column("value", overflow="fold")
    rate = f"{1 / seen.sample_time:.4g} Hz, usual step {seen.sample_time * 1e3:.4g} ms"
    count = "none seen" if seen.count is None else f"{seen.count:.4g} {units['length']}"
    whole = seen.fitted is None or seen.fitted == seen.samples
    part = "" if whole else f", fitted the {seen.fitted} that move most"
    for name, value in (
        ("length", f"{seen.duration:.4g} s, {seen.samples} samples{part}"),
        ("rate", rate),
        ("travel", f"{seen.travel:.4g} {units['length']}"),
        ("peak speed", f"{seen.peak_speed:.4g} {units['speed']}"),
        ("peak force", f"{seen.peak_force:.4g} {units['force']}"),
        ("encoder count", f"{count}; noise of a reading {seen.noise:.2g} {units['length']} rms"),
        ("excited band", f"{seen.band[0]:.3g} to {seen.band[1]:.3g} Hz"),
        ("mass", _quantity_words(seen.mass, units["mass"])),
        ("damping", _quantity_words(seen.damping, units["damping"])),
    ):
        table.add_row(name, value)
    return table


def _quantity_words(quantity: Quantity | None, unit: str) -> str:
    """A quantity with the half-width of its 95 % interval."""
    if quantity is None:
        return "not told"
    half = (quantity.high - quantity.low) / 2
    share = f" ({100 * half / abs(quantity.value):.2g} %)" if quantity.value else ""
    return f"{quantity.value:.5g} ± {half:.2g} {unit}{share}"


def _verdict(seen: Examination) -> str:
    refusals = list(dict.fromkeys(f.code for f in seen.findings if f.severity == "refusal"))
    warnings = list(dict.fromkeys(f.code for f in seen.findings if f.severity == "warning"))
    if seen.refused:
        return f"not usable: {', '.join(refusals)}; the interval above cannot be relied on"
    return "usable" + (f", with warnings: {', '.join(warnings)}" if warnings else "")
