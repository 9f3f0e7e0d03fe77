"""Cells of text as columns of numbers, by the table library."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    column_names,
    quote,
)

if TYPE_CHECKING:
    import polars

    from identification.readers.dialect import Decimal


def read_cells(
    path: Path, content: bytes, header: bytes, separator: str, columns: LogColumns
) -> Reading:
    """Columns by role of plain CSV whose cells may be quoted, empty or no numbers.

    Args:
        path: the file, for messages.
        content: UTF-8 text, all of the file.
        header: its first line that holds anything.
        separator: of the columns.
        columns: what the user asked for.

    Raises:
        InvalidInputError: no table, a column that is missing or there twice, a cell that is no
            number.
    """
    import polars as pl

    stored = _table(path, header, separator, n_rows=0).columns
    # A header line that begins with # comes from loggers that mark it as a comment.
    shown = [name.strip("# ") for name in stored]
    if not {columns.time, columns.force, columns.position} <= set(shown):
        from identification.readers.recognition import refuse_preamble

        refuse_preamble(path, content, separator, columns)
    wanted = column_names(path, columns, shown, table=True)
    for name in wanted.values():
        # The second is the reader's own name for another column of one name.
        if shown.count(name) > 1 or f"{name}_duplicated_0" in shown:
            raise InvalidInputError(
                path, f"has two columns named '{quote(name)}'", "Rename one of them"
            )
    stored_as = dict(zip(shown, stored, strict=True))
    names = list(dict.fromkeys(stored_as[name] for name in wanted.values()))
    numbers: dict[str, Any] = dict.fromkeys(names, pl.Float64)
    try:
        table = _parsed(content, separator, columns=names, schema_overrides=numbers)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError):
        from identification.readers.recognition import refuse_other_rows

        # Ten times slower and larger, but it tells spaces from words and names the cell.
        table = _table(path, content, separator, columns=names)
        refuse_other_rows(path, table)
    values = {
        role: numbers_of(path, name, table[stored_as[name]], first=2)
        for role, name in wanted.items()
    }
    return Reading(values=values, names=wanted)


def _parsed(content: bytes, separator: str, **options: Any) -> polars.DataFrame:
    import polars as pl

    return pl.read_csv(
        BytesIO(content),
        separator=separator,
        infer_schema=False,
        encoding="utf8-lossy",
        **options,
    )


def _table(path: Path, content: bytes, separator: str, **options: Any) -> polars.DataFrame:
    """The table as text. Raises InvalidInputError where it is none."""
    import polars as pl

    try:
        return _parsed(content, separator, **options)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        reason = " ".join(str(error).split("\n")[0].split())[:200]
        raise InvalidInputError(
            path,
            f"is not a table of equally long rows ({reason})",
            "Export it again as CSV with one header line",
        ) from None


def as_pointed(cells: Any, decimal: Decimal) -> Any:
    """Text without spaces around it, and with decimal points, of a polars column or expression."""
    text = cells.str.strip_chars()
    if decimal == "point":
        return text
    return text.str.replace_all(".", "'", literal=True).str.replace(",", ".", literal=True)


def numbers_of(
    path: Path, name: str, cells: polars.Series, *, first: int, decimal: Decimal = "point"
) -> FloatArray:
    """A column as numbers, shape (rows,); an empty cell is NaN.

    Args:
        path: the file, for the message.
        name: of the column, for the message.
        cells: text or numbers.
        first: row of the file that is the first of the column, 1 the file's first.
        decimal: what stands before decimals in text.

    Raises:
        InvalidInputError: a cell that is no number, by its row.
    """
    import polars as pl

    numbers = cells
    if cells.dtype == pl.String:
        text = as_pointed(cells, decimal)
        numbers = text.cast(pl.Float64, strict=False)
        wrong = (numbers.is_null() & text.is_not_null() & (text != "")).fill_null(value=False)
        found = wrong.arg_true()
        if found.len():
            row = int(found[0])
            raise InvalidInputError(
                path,
                f"column '{quote(name)}' holds '{quote(str(cells[row]))}' in row {row + first}, "
                f"which is not a number with a decimal {decimal}",
                "Write all numbers alike, and leave missing cells empty",
            )
    return np.asarray(numbers.fill_null(float("nan")).to_numpy(), dtype=np.float64)
