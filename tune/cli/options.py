"""Options that several commands share, each documented once."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal, Optional

import typer

from identification import Method


class MarginChoice(StrEnum):
    """Margins by name."""

    conservative = "conservative"
    balanced = "balanced"
    firm = "firm"


Logs = Annotated[
    list[Path],
    typer.Argument(help="Logs of one axis: CSV or other text, Parquet, MAT, NPZ, Excel or MCAP."),
]
Time = Annotated[str, typer.Option("--time", metavar="COL", help="Column of time, in seconds.")]
TimeGain = Annotated[
    Optional[float],  # noqa: UP045 - typer reads it at run time
    typer.Option("--time-gain", metavar="X", help="s per unit of the time column."),
]
Decimal = Annotated[
    Optional[Literal["comma", "point"]],  # noqa: UP045
    typer.Option("--decimal", help="What stands before decimals in a text file."),
]
Force = Annotated[
    str, typer.Option("--force", metavar="COL", help="Column of the actuator's force.")
]
Position = Annotated[str, typer.Option("--position", metavar="COL", help="Column of position.")]
Reference = Annotated[
    Optional[str],  # noqa: UP045 - typer reads it at run time
    typer.Option("--reference", metavar="COL", help="Column of the set-point, if logged."),
]
ForceGain = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option(
        "--force-gain",
        metavar="X",
        help="N (N·m) per unit of the force column: per ampere torque constant and transmission; 1 "
        "states that it is in N (N·m).",
    ),
]
PositionGain = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option(
        "--position-gain",
        metavar="X",
        help="m (rad) per unit of the position column; 1 states that it is in m (rad).",
    ),
]
Axis = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--axis", metavar="NAME", help="Name of the axis; default from the hardware."),
]
HardwareFile = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option("--hardware", metavar="FILE", help="hardware.yaml: what is known beforehand."),
]
Allow = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option(
        "--allow", metavar="CODE", help="Accept this finding about the log; it is recorded."
    ),
]
MethodOption = Annotated[Method, typer.Option("--method", help="Estimator.")]
MarginOption = Annotated[
    Optional[MarginChoice],  # noqa: UP045
    typer.Option("--margin", help="Margin instead of the scene's."),
]
Candidates = Annotated[
    bool, typer.Option("--candidates", help="Show all three margins side by side.")
]
WhatIf = Annotated[
    bool,
    typer.Option(
        "--what-if",
        help="Also tune with half the delay, twice the sample rate, a finer encoder and so on: "
        "what each fact of the hardware costs in perceived steps.",
    ),
]
Picture = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option("--picture", metavar="FILE", help="Where to draw it (PNG, SVG or PDF)."),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Show what would be written.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Only errors.")]
DeviceOut = Annotated[Path, typer.Option("-o", "--output", help="Where to write the device.")]
ProfileOut = Annotated[Path, typer.Option("-o", "--output", help="Where to write the profile.")]
