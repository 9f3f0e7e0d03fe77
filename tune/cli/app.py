"""All commands under one name; usage errors end with exit code 2."""

from __future__ import annotations

import re
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from tune.cli import fleet, judging, logs, preparation, profiles
from tune.cli.process import ignore_signals
from tune.cli.session import Session, finish_interrupted
from tune.documents import Exit

#: What every complaint about options and arguments derives from; typer does not export it.
_USAGE_ERROR: type[Exception] = typer.BadParameter.__bases__[0]

#: An argument in a list of them, and the type that typer shows behind it.
_TYPE = re.compile(r"^(  [A-Z]+)( <[^>|]*>)", re.MULTILINE)

app = typer.Typer(
    name="haptune",
    help="From a logged trajectory to a safe haptic controller profile. Every quantity is in SI "
    "units; a log has the columns time,force,position[,reference], force being what the actuator "
    "applies to the device, positive along +position.",
    epilog="Exit codes: 0 done, 1 internal error, 2 usage, 3 unreadable or invalid input, 4 log "
    "refused, 5 no feasible effect, 6 check failed, 7 not written, 130 interrupted.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class _Command(TyperCommand):
    """A command whose help tells its arguments by words alone, not by types of Python too."""

    def get_help(self, ctx: Any) -> str:
        return _TYPE.sub(lambda found: found[1] + " " * len(found[2]), super().get_help(ctx))


def help_command(
    context: typer.Context,
    command: Annotated[str | None, typer.Argument(metavar="COMMAND", help="Its name.")] = None,
) -> None:
    """The help of a command, or of haptune."""
    parent: Any = context.parent
    if command is None:
        typer.echo(parent.get_help())
        return
    found = parent.command.get_command(parent, command)
    if found is None:
        raise typer.BadParameter(f"there is no command {command!r}")
    with found.make_context(command, [], parent=parent, resilient_parsing=True) as asked:
        typer.echo(found.get_help(asked))


#: What each help gives as an example of its arguments.
_EXAMPLES = {
    "new": "hardware",
    "doctor": "log.csv",
    "identify": "log.csv --hardware hardware.yaml",
    "tune": "device.yaml scene.yaml",
    "calibrate": "log.csv --scene scene.yaml --hardware hardware.yaml",
    "fleet": "manifest.csv --scene scene.yaml -o fleet",
    "audit": "homerehab --stiffness 800",
    "check": "profile.yaml",
    "verify": "profile.yaml played.csv",
    "compare": "old.yaml new.yaml",
    "export": "profile.yaml --to c",
    "report": "profile.yaml log.csv",
    "open": "calibration",
    "excite": "excitation.yaml",
    "simulate": "homerehab",
    "help": "tune",
}
for _name, _command, _summary in (
    ("demo", profiles.demo_command, "Try it: bundled log to profile, with pictures."),
    ("new", preparation.new_command, "Write a template of a file."),
    ("doctor", logs.doctor_command, "What logs can and cannot support."),
    ("identify", logs.identify_command, "Logs to device.yaml."),
    ("tune", profiles.tune_command, "Device and scene to profile.yaml."),
    ("calibrate", profiles.calibrate_command, "Logs and scene to profile.yaml: the main job."),
    ("fleet", fleet.fleet_command, "Many devices: a profile each, a table, a page."),
    ("audit", judging.audit_command, "Are these gains safe on a device, and if not, why."),
    ("check", judging.check_command, "Re-compute a profile by another path."),
    ("verify", judging.verify_command, "A low-gain log of the device against its profile."),
    ("compare", judging.compare_command, "What changed between two devices or two profiles."),
    ("export", profiles.export_command, "A profile as files for a controller."),
    ("report", profiles.report_command, "A profile as one page to read, print and sign."),
    ("open", preparation.open_command, "A page on a folder of yours: see it move."),
    ("excite", preparation.excite_command, "Plan a force that tells mass and damping best."),
    ("simulate", preparation.simulate_command, "Rehearse: a simulated log of a known device."),
    ("help", help_command, "The help of a command, or this."),
):
    _epilog = f"Example: haptune {_name} {_EXAMPLES.get(_name, '')}".rstrip()
    app.command(_name, cls=_Command, short_help=_summary, epilog=_epilog)(_command)


def _version(wanted: bool) -> None:  # noqa: FBT001 - typer calls it with the flag
    if wanted:
        from importlib.metadata import version

        typer.echo(f"haptune {version('haptune')}")
        raise typer.Exit


@app.callback()
def haptune(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """From a logged trajectory to a safe haptic controller profile."""


def run_app() -> None:
    """Run the command line and exit with the code of the contract."""
    try:
        code: object = app(standalone_mode=False, prog_name="haptune")
        ignore_signals()
    except _USAGE_ERROR as error:
        ignore_signals()
        _report_usage(error)
        sys.exit(Exit.USAGE)
    except (typer.Abort, EOFError):
        sys.exit(finish_interrupted())
    ended = code if isinstance(code, int) else 0
    # Help and version are printed outside of a session.
    sys.exit(ended or Session(command="haptune", as_json=False, quiet=False).delivery_exit_code())


def _report_usage(error: Exception) -> None:
    """A usage error in one line, as JSON too where that was asked for."""
    context: Any = getattr(error, "ctx", None)
    command = getattr(context, "info_name", None) or "haptune"
    path = getattr(context, "command_path", "haptune")
    text: str = getattr(error, "format_message", error.__str__)()
    if text.startswith("Usage:"):  # no command was given: the text is the help
        print(text, file=sys.stderr)  # noqa: T201
        return
    sentence = " ".join(text.replace("Value error, ", "").split()).removesuffix(".") + "."
    sentence = sentence.replace("?.", "?")
    Session(command=command, as_json="--json" in sys.argv, quiet=False).finish(
        Exit.USAGE, f"{sentence} See '{path} --help'"
    )
