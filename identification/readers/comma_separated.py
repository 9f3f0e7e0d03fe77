"""CSV files: one header line, then rows of numbers."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.errors import InvalidInputError
from identification.readers.cells import numbers_of
from identification.readers.columns import (
    LogColumns,
    Reading,
    quoted,
    wanted_columns,
)
from identification.readers.limits import (
    refuse_long,
    refuse_open_quote,
    refuse_packed,
    refuse_wide,
)
from identification.readers.plain_numbers import read_plain_numbers

if TYPE_CHECKING:
    import polars

#: Separators tried; the one most frequent in the header wins, the first of equals.
_SEPARATORS = ",;\t"
#: What a line without a name consists of: its end, and the mark of a file in UTF-8.
_NOTHING = b"\xef\xbb\xbf\r\n"


def read_csv(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; empty cells are NaN. Raises InvalidInputError."""
    refuse_packed(path, content)
    refuse_long(path, content.count(b"\n") - 1)
    header = _header(path, content)
    separator = max(_SEPARATORS, key=lambda mark: header.count(mark.encode()))
    refuse_wide(path, header, header.count(separator.encode()) + 1)
    return read_plain_numbers(path, content, separator, columns) or _read_cells(
        path, content, header, separator, columns
    )


def _read_cells(
    path: Path, content: bytes, header: bytes, separator: str, columns: LogColumns
) -> Reading:
    """Columns by role of a table whose cells may be quoted, empty or no numbers."""
    import polars as pl

    stored = _table(path, header, separator, n_rows=0).columns
    # A header line that begins with # comes from loggers that mark it as a comment.
    shown = [name.strip("# ") for name in stored]
    if not {columns.time, columns.force, columns.position} <= set(shown):
        from identification.readers.recognition import refuse_preamble

        refuse_preamble(path, content, separator, columns)
    wanted = wanted_columns(path, columns, shown, table=True)
    for name in wanted.values():
        # The second is the reader's own name for another column of one name.
        if shown.count(name) > 1 or f"{name}_duplicated_0" in shown:
            raise InvalidInputError(
                path, f"has two columns named '{quoted(name)}'", "Rename one of them"
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


def _header(path: Path, content: bytes) -> bytes:
    """The first line that holds anything. Raises InvalidInputError where it does not end there."""
    header = next((line for line in BytesIO(content) if line.strip(_NOTHING)), b"")
    refuse_open_quote(path, header)
    return header


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
