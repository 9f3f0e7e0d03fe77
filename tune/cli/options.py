"""What commands share: the options, each documented once, and how a function becomes a command."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from typer import Argument, Option

from identification import Method
from tune.cli.session import run_command

if TYPE_CHECKING:
    from identification import LogColumns


class MarginChoice(StrEnum):
    """Margins by name."""

    conservative = "conservative"
    balanced = "balanced"
    firm = "firm"


Logs = Annotated[
    list[Path],
    Argument(help="Logs of one axis: CSV or other text, Parquet, MAT, NPZ, Excel or MCAP."),
]
HardwareFile = Annotated[
    Path | None,
    Option("--hardware", metavar="FILE", help="hardware.yaml: what is known beforehand."),
]
Allow = Annotated[
    list[str] | None,
    Option("--allow", metavar="CODE", help="Accept this finding about the log; it is recorded."),
]
MethodOption = Annotated[Method, Option(help="Estimator.")]
MarginOption = Annotated[MarginChoice | None, Option(help="Margin instead of the scene's.")]
Candidates = Annotated[bool, Option("--candidates", help="Show all three margins side by side.")]
WhatIf = Annotated[
    bool,
    Option(
        "--what-if",
        help="Also tune with half the delay, twice the sample rate, a finer encoder and so on: "
        "what each fact of the hardware costs in perceived steps.",
    ),
]
Picture = Annotated[
    Path | None, Option("--picture", metavar="FILE", help="Where to draw it (PNG, SVG or PDF).")
]
DryRun = Annotated[bool, Option("--dry-run", help="Show what would be written.")]
_Json = Annotated[bool, Option("--json", help="One JSON object on standard output.")]
_Quiet = Annotated[bool, Option("--quiet", help="Only errors.")]
DeviceOut = Annotated[Path, Option("-o", "--output", help="Where to write the device.")]
ProfileOut = Annotated[Path, Option("-o", "--output", help="Where to write the profile.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """What a person says of the columns of a log; each field is an option of the command."""

    time: Annotated[str, Option(metavar="COL", help="Column of time, in seconds.")] = "time"
    force: Annotated[str, Option(metavar="COL", help="Column of the actuator's force.")] = "force"
    position: Annotated[str, Option(metavar="COL", help="Column of position.")] = "position"
    reference: Annotated[
        str | None, Option(metavar="COL", help="Column of the set-point, if logged.")
    ] = None
    time_gain: Annotated[
        float | None, Option(metavar="X", help="s per unit of the time column.")
    ] = None
    force_gain: Annotated[
        float | None,
        Option(
            metavar="X",
            help="N (N·m) per unit of the force column: per ampere torque constant and "
            "transmission; 1 states that it is in N (N·m).",
        ),
    ] = None
    position_gain: Annotated[
        float | None,
        Option(
            metavar="X",
            help="m (rad) per unit of the position column; 1 states that it is in m (rad).",
        ),
    ] = None
    axis: Annotated[
        str | None, Option(metavar="NAME", help="Name of the axis; default from the hardware.")
    ] = None
    decimal: Annotated[
        Literal["comma", "point"] | None, Option(help="What stands before decimals in a text file.")
    ] = None

    def columns(self) -> LogColumns:
        """What the readers of logs take. Raises InvalidInputError for a gain that is none."""
        from identification import LogColumns

        return LogColumns(**asdict(self))


def command(
    *, without: Collection[str] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command as typer reads it, made of a function that is given its session.

    It offers ``--json`` and ``--quiet``, and in the place of ``options``, a LogOptions, an option
    for each field but those it goes without.
    """

    def offering(body: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(body, eval_str=True)
        told = [each for each in _log_options() if each.name not in without]
        reads_logs = "options" in own.parameters
        offered: list[inspect.Parameter] = []
        for name, parameter in own.parameters.items():
            if name == "options":
                offered += told
            elif name != "session":
                offered.append(parameter)
        offered += [
            _keyword("json", _Json, default=False),
            _keyword("quiet", _Quiet, default=False),
        ]

        @wraps(body)
        def run(**given: Any) -> None:
            json, quiet = given.pop("json"), given.pop("quiet")
            if reads_logs:
                given["options"] = LogOptions(**{each.name: given.pop(each.name) for each in told})
            run_command(
                body.__name__, lambda session: body(session, **given), as_json=json, quiet=quiet
            )

        run.__dict__["__signature__"] = own.replace(parameters=offered)  # read by typer
        return run

    return offering


@cache
def _log_options() -> list[inspect.Parameter]:
    types = get_type_hints(LogOptions, include_extras=True)
    return [
        _keyword(each.name, types[each.name], default=each.default) for each in fields(LogOptions)
    ]


def _keyword(name: str, annotation: object, *, default: object) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)
