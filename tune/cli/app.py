"""All commands under one name; usage errors end with exit code 2."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from tune.cli import calibrate, check, demo, identify, new, simulate, tune
from tune.cli.session import EXIT_INTERRUPTED, EXIT_USAGE, report_usage

#: What every complaint about options and arguments derives from; typer does not export it.
_USAGE_ERROR: type[Exception] = typer.BadParameter.__bases__[0]

app = typer.Typer(
    name="haptune",
    help="From a logged trajectory to a safe haptic controller profile. Every quantity is in SI "
    "units; a log has the columns time,force,position[,reference], force being what the actuator "
    "applies to the device, positive along +position.",
    epilog="Exit codes: 0 done, 1 internal error, 2 usage, 3 unreadable or invalid input, 4 log "
    "refused, 5 no feasible effect, 6 check failed, 7 not written, 130 interrupted.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("demo")(demo.demo)
app.command("new")(new.new)
app.command("identify")(identify.identify)
app.command("tune")(tune.tune)
app.command("calibrate")(calibrate.calibrate)
app.command("check")(check.check)
app.command("simulate")(simulate.simulate)


def _version(wanted: bool) -> None:  # noqa: FBT001 - typer calls it with the flag
    if wanted:
        from importlib.metadata import version

        typer.echo(f"haptune {version('haptune')}")
        raise typer.Exit


@app.callback()
def haptune(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """From a logged trajectory to a safe haptic controller profile."""


def run() -> None:
    """Run the command line and exit with the code of the contract."""
    try:
        code: object = app(standalone_mode=False)
    except _USAGE_ERROR as error:
        report_usage(error)
        sys.exit(EXIT_USAGE)
    except (typer.Abort, KeyboardInterrupt, EOFError):
        sys.exit(EXIT_INTERRUPTED)
    sys.exit(code if isinstance(code, int) else 0)
