"""Options that several commands share, each documented once."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Optional

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
HardwareFile = Annotated[
    Optional[Path],  # noqa: UP045 - typer reads it at run time
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
