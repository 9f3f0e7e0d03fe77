"""Tables of text in other dialects than plain CSV, once it is known which."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from identification.errors import InvalidInputError
from identification.readers.cells import as_pointed, numbers_of
from identification.readers.columns import FloatArray, Reading
from identification.readers.dialect import Dialect
from identification.readers.limits import refuse_long, refuse_packed
from identification.readers.recognition import refuse_other_rows

if TYPE_CHECKING:
    import polars


#: What lines separated by single spaces do not hold.
_RUNS = (b"  ", b"\t", b"\n ", b" \n", b" \r")


def read_delimited(path: Path, content: bytes, dialect: Dialect) -> Reading:
    """Columns by role; empty cells are NaN. Raises InvalidInputError naming the row at fault.

    Args:
        path: the file, for messages.
        content: UTF-8 text, all of the file.
        dialect: how it is written.
    """
    body = content[_start_of(content, dialect.layout.first) :]
    # Lines above a packed stream do not keep the reader of text from unpacking it.
    refuse_packed(path, body)
    refuse_long(path, body.count(b"\n"))
    separator = dialect.separator
    if separator == " " and (body.startswith((b" ", b"\t")) or any(run in body for run in _RUNS)):
        body = re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", body)
        body, separator = re.sub(rb"[ \t]+", b"\t", body), "\t"
    values = _quickly(path, body, separator, dialect)
    if values is None:
        values = _as_text(path, body, separator, dialect)
    return Reading(values=values, names=dialect.layout.wanted, notes=dialect.notes)


def _quickly(
    path: Path, body: bytes, separator: str, dialect: Dialect
) -> dict[str, FloatArray] | None:
    """Columns by role; None where a cell is no number with a decimal point."""
    import polars as pl

    if dialect.decimal == "comma":
        return None
    try:
        table = _table(body, separator, dialect, pl.Float64())
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError):
        return None
    layout = dialect.layout
    return {
        role: numbers_of(path, name, table[name], first=layout.first + 1)
        for role, name in layout.wanted.items()
    }


def _as_text(path: Path, body: bytes, separator: str, dialect: Dialect) -> dict[str, FloatArray]:
    """Columns by role, cell by cell: slower and larger, but it names what is no number."""
    import polars as pl

    layout = dialect.layout
    try:
        table = _table(body, separator, dialect, pl.String())
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        reason = " ".join(str(error).split("\n")[0].split())[:200]
        raise InvalidInputError(
            path,
            f"is not a table of equally long rows below line {layout.header + 1} ({reason})",
            "Export it again as CSV with one header line",
        ) from None
    refuse_other_rows(
        path, table.with_columns(as_pointed(pl.all(), dialect.decimal)), layout.first + 1
    )
    return {
        role: numbers_of(path, name, table[name], first=layout.first + 1, decimal=dialect.decimal)
        for role, name in layout.wanted.items()
    }


def _table(
    body: bytes, separator: str, dialect: Dialect, kind: polars.DataType
) -> polars.DataFrame:
    """The columns of the log, all of one type."""
    import polars as pl

    layout = dialect.layout
    places = sorted(set(layout.places.values()))
    names = [layout.names[place] for place in places]
    return pl.read_csv(
        BytesIO(body),
        separator=separator,
        has_header=False,
        infer_schema=False,
        encoding="utf8-lossy",
        columns=places,
        new_columns=names,
        schema_overrides=dict.fromkeys(names, kind),
    )


def _start_of(content: bytes, line: int) -> int:
    """Where a line begins, 0 the first."""
    place = 0
    for _ in range(line):
        place = content.index(b"\n", place) + 1
    return place
