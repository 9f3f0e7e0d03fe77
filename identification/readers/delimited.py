"""Tables of text in other dialects than plain CSV, once it is known which."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import FloatArray, Reading, quoted
from identification.readers.dialect import Dialect
from identification.readers.limits import refuse_long
from identification.readers.recognition import refuse_other_rows

if TYPE_CHECKING:
    import polars


def read_delimited(path: Path, content: bytes, dialect: Dialect) -> Reading:
    """Columns by role; empty cells are NaN. Raises InvalidInputError naming the row at fault.

    Args:
        path: the file, for messages.
        content: UTF-8 text, all of the file.
        dialect: how it is written.
    """
    import polars as pl

    layout = dialect.layout
    body = content[_start_of(content, layout.first) :]
    refuse_long(path, body.count(b"\n"))
    separator = dialect.separator
    if separator == " ":
        body = re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", body)
        body, separator = re.sub(rb"[ \t]+", b"\t", body), "\t"
    places = sorted(set(layout.places.values()))
    try:
        table = pl.read_csv(
            BytesIO(body),
            separator=separator,
            has_header=False,
            infer_schema=False,
            encoding="utf8-lossy",
            columns=places,
            new_columns=[layout.names[place] for place in places],
        )
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        reason = " ".join(str(error).split("\n")[0].split())[:200]
        raise InvalidInputError(
            path,
            f"is not a table of equally long rows below line {layout.header + 1} ({reason})",
            "Export it again as CSV with one header line",
        ) from None
    refuse_other_rows(path, _with_points(table, dialect), layout.first + 1)
    values = {
        role: _numbers(path, table[name], dialect, name) for role, name in layout.wanted.items()
    }
    return Reading(values=values, names=layout.wanted, notes=dialect.notes)


def _start_of(content: bytes, line: int) -> int:
    """Where a line begins, 0 the first."""
    place = 0
    for _ in range(line):
        place = content.index(b"\n", place) + 1
    return place


def _with_points(table: polars.DataFrame, dialect: Dialect) -> polars.DataFrame:
    """Cells with decimal points; those that hold one already are no numbers of this dialect."""
    import polars as pl

    return table.with_columns(_as_pointed(pl.all(), dialect))


def _as_pointed(cells: Any, dialect: Dialect) -> Any:
    text = cells.str.strip_chars()
    if dialect.decimal == "point":
        return text
    return text.str.replace_all(".", "'", literal=True).str.replace(",", ".", literal=True)


def _numbers(path: Path, cells: polars.Series, dialect: Dialect, name: str) -> FloatArray:
    """A column as numbers; an empty cell is NaN, any other text is refused by its row."""
    import polars as pl

    text = _as_pointed(cells, dialect)
    numbers = text.cast(pl.Float64, strict=False)
    wrong = (numbers.is_null() & text.is_not_null() & (text != "")).fill_null(value=False)
    first = wrong.arg_true()
    if first.len():
        row = int(first[0])
        raise InvalidInputError(
            path,
            f"column '{quoted(name)}' holds '{quoted(str(cells[row]))}' in row "
            f"{row + dialect.layout.first + 1}, which is not a number with a decimal "
            f"{dialect.decimal}",
            "Write all numbers alike, and leave missing cells empty",
        )
    return np.asarray(numbers.fill_null(float("nan")).to_numpy(), dtype=np.float64)
