"""A log as loggers, spreadsheets and people write it: the same numbers in twenty other forms."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import openpyxl

from identification import Trajectory

#: N (N·m) per ampere of the motor whose current was logged.
TORQUE_CONSTANT = 0.05
PLAIN = ("time", "force", "position")
Sizes = tuple[float, float, float]
ONE: Sizes = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mangled:
    """One form of a log.

    Attributes:
        ending: of its file.
        content: of a log, and whether its axis turns.
    """

    ending: str
    content: Callable[[Trajectory, bool], bytes]


def table(
    log: Trajectory,
    rotary: bool,
    *,
    header: Sequence[str] = PLAIN,
    rotary_header: Sequence[str] | None = None,
    sizes: Sizes = ONE,
    rotary_sizes: Sizes | None = None,
    between: str = ",",
    decimal: str = ".",
    above: str = "",
    below: str = "",
    rotary_below: str | None = None,
    quote: str = "",
    line: str = "\n",
    digits: int = 12,
    encoding: str = "utf-8",
) -> bytes:
    """The rows as text: every column divided by the size of its unit."""
    names = (rotary_header or header) if rotary else header
    by = (rotary_sizes or sizes) if rotary else sizes
    under = (rotary_below or below) if rotary else below
    rows = zip(log.time / by[0], log.force / by[1], log.position / by[2], strict=True)
    texts = [[f"{value:.{digits}g}".replace(".", decimal) for value in row] for row in rows]
    cells = [list(names), *texts]
    lines = [between.join(f"{quote}{cell}{quote}" for cell in row) for row in cells]
    text = above + "\n".join([lines[0], *([under] if under else []), *lines[1:]]) + "\n"
    return text.replace("\n", line).encode(encoding)


def workbook(log: Trajectory, rotary: bool) -> bytes:
    """A sheet of an Excel workbook with a title above and milliseconds."""
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(["Rig 7"])
    sheet.append(["time [ms]", "force", "position"])
    rows = zip(log.time.tolist(), log.force.tolist(), log.position.tolist(), strict=True)
    for time, force, position in rows:
        sheet.append([1000 * time, force, position])
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


MILLI: Sizes = (1e-3, 1e-3, 1e-3)
TURNED: Sizes = (1e-3, 1e-3, math.pi / 180)
CURRENT: Sizes = (1.0, TORQUE_CONSTANT, 1.0)

MANGLED: dict[str, Mangled] = {
    name: Mangled(ending=ending, content=content)
    for name, ending, content in (
        ("semicolons and decimal commas", "csv", partial(table, between=";", decimal=",")),
        ("tabs in a text", "txt", partial(table, between="\t")),
        ("spaces", "txt", partial(table, between="   ")),
        ("comments above", "csv", partial(table, above="# rig 7\n% calibrated in spring\n")),
        (
            "a title above",
            "csv",
            partial(table, above="Rig 7;recorded by hand;\n\n", between=";", decimal=","),
        ),
        ("a comment below", "csv", partial(table, below="# start")),
        (
            "units below",
            "csv",
            partial(
                table,
                below="ms,mN,mm",
                rotary_below="ms,mN·m,°",
                sizes=MILLI,
                rotary_sizes=TURNED,
            ),
        ),
        ("units above", "csv", partial(table, above="ms,,\n", sizes=(1e-3, 1.0, 1.0))),
        (
            "units in the header",
            "csv",
            partial(
                table,
                header=("time [ms]", "force_mN", "pos (mm)"),
                rotary_header=("t [ms]", "Torque [mN·m]", "Angle [°]"),
                sizes=MILLI,
                rotary_sizes=TURNED,
            ),
        ),
        ("milliseconds that nobody named", "csv", partial(table, sizes=(1e-3, 1.0, 1.0))),
        ("millinewtons that nobody named", "csv", partial(table, sizes=(1.0, 1e-3, 1.0))),
        (
            "millimetres or degrees that nobody named",
            "csv",
            partial(table, sizes=(1.0, 1.0, 1e-3), rotary_sizes=(1.0, 1.0, math.pi / 180)),
        ),
        (
            "a motor current",
            "csv",
            partial(table, header=("time", "current [A]", "position"), sizes=CURRENT),
        ),
        ("UTF-16", "csv", partial(table, encoding="utf-16")),
        ("a byte order mark", "csv", partial(table, encoding="utf-8-sig")),
        (
            "quoted cells with decimal commas",
            "csv",
            partial(table, quote='"', decimal=","),
        ),
        ("lines of Windows", "csv", partial(table, line="\r\n")),
        ("other words", "csv", partial(table, header=("t", "force", "pos"))),
        (
            "words that nobody knows",
            "csv",
            partial(table, header=("zeit", "kraft", "weg")),
        ),
        ("a workbook", "xlsx", workbook),
    )
}
