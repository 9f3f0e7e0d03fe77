"""Options of every command that reads logs: which columns are what, and in which units."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import wraps
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional, get_type_hints

import typer

if TYPE_CHECKING:
    from identification import LogColumns


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """What a person says of the columns of a log; each field is an option of the command."""

    time: Annotated[
        str, typer.Option("--time", metavar="COL", help="Column of time, in seconds.")
    ] = "time"
    force: Annotated[
        str, typer.Option("--force", metavar="COL", help="Column of the actuator's force.")
    ] = "force"
    position: Annotated[
        str, typer.Option("--position", metavar="COL", help="Column of position.")
    ] = "position"
    reference: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it at run time
        typer.Option("--reference", metavar="COL", help="Column of the set-point, if logged."),
    ] = None
    time_gain: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option("--time-gain", metavar="X", help="s per unit of the time column."),
    ] = None
    force_gain: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            "--force-gain",
            metavar="X",
            help="N (N·m) per unit of the force column: per ampere torque constant and "
            "transmission; 1 states that it is in N (N·m).",
        ),
    ] = None
    position_gain: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            "--position-gain",
            metavar="X",
            help="m (rad) per unit of the position column; 1 states that it is in m (rad).",
        ),
    ] = None
    axis: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option("--axis", metavar="NAME", help="Name of the axis; default from the hardware."),
    ] = None
    decimal: Annotated[
        Optional[Literal["comma", "point"]],  # noqa: UP045
        typer.Option("--decimal", help="What stands before decimals in a text file."),
    ] = None

    def columns(self) -> LogColumns:
        """What the readers of logs take. Raises InvalidInputError for a gain that is none."""
        from identification import LogColumns

        return LogColumns(**asdict(self))


def with_log_options(
    *, without: frozenset[str] = frozenset()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command whose argument ``options``, a LogOptions, is given as one option a field.

    Args:
        without: fields that the command has no use for.
    """
    offered = [field for field in fields(LogOptions) if field.name not in without]
    types = get_type_hints(LogOptions, include_extras=True)
    options = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=field.default,
            annotation=types[field.name],
        )
        for field in offered
    ]

    def offering(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def run(**given: Any) -> None:
            told = {field.name: given.pop(field.name) for field in offered}
            command(options=LogOptions(**told), **given)

        own = inspect.signature(command, eval_str=True)
        parameters = list(own.parameters.values())
        place = list(own.parameters).index("options")
        parameters[place : place + 1] = options
        run.__dict__["__signature__"] = own.replace(parameters=parameters)  # read by typer
        return run

    return offering
