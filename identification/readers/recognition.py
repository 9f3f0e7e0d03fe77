"""What loggers and spreadsheets do to CSV files, recognised and named with the step to take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, quote

if TYPE_CHECKING:
    import polars

#: Bytes and lines from the beginning among which a header is looked for.
_BEGINNING = 100_000
_MOST_LINES = 200
#: Columns of the shortest header: time, force, position.
_FEWEST_COLUMNS = 3
#: Rows that units may take below the header, and a summary at the end.
_MOST_UNITS = 3
_MOST_SUMMARY = 10


def refuse_preamble(path: Path, content: bytes, separator: str, columns: LogColumns) -> None:
    """Refuse lines above the header; call it where the first line lacks a column.

    Args:
        path: the file, for the message.
        content: all of it.
        separator: of the columns.
        columns: what the user asked for; all of them stand in a header.

    Raises:
        InvalidInputError: the header stands further down, or the first line is a comment.
    """
    asked = {columns.time, columns.force, columns.position, columns.reference} - {None}
    lines = content[:_BEGINNING].decode("utf-8-sig", "replace").splitlines()[:_MOST_LINES]
    for above, line in enumerate(lines):
        # Lines above a header tell nothing of its separator.
        names = {cell.strip(" \t\"'#") for cell in line.split(_separator(line, separator))}
        if above and asked <= names:
            raise InvalidInputError(
                path,
                f"has {above} line{'' if above == 1 else 's'} above its header, which stands in "
                f"line {above + 1}; the first is '{quote(lines[0])}'",
                "Delete the lines above the header",
            )
    first = lines[0] if lines else ""
    if first.startswith("#") and len(first.split(separator)) < _FEWEST_COLUMNS:
        raise InvalidInputError(
            path,
            f"begins with a comment, '{quote(first)}', where the names of the columns should be",
            "Delete the lines above the header",
        )


def _separator(line: str, otherwise: str) -> str:
    found = max(",;\t", key=line.count)
    return found if found in line else otherwise


def refuse_other_rows(path: Path, table: polars.DataFrame, first: int = 2) -> None:
    """Refuse rows of units below the header and rows of a summary at the end.

    Args:
        path: the file, for the message.
        table: the columns of the log as text.
        first: row of the file that is the first of the table, 1 the file's first.

    Raises:
        InvalidInputError: naming the rows and what they hold.
    """
    import polars as pl

    cells = pl.all().str.strip_chars()
    is_word = cells.cast(pl.Float64, strict=False).is_null() & cells.str.contains("[[:alpha:]]")
    words = table.select(pl.any_horizontal(is_word.fill_null(value=False))).to_series()
    rows = len(words)
    top = next((row for row in range(min(rows, _MOST_UNITS + 1)) if not words[row]), rows)
    if 0 < top <= _MOST_UNITS:
        raise InvalidInputError(
            path,
            f"holds {_words_of(table.head(top))} in row {first}, below the header: units or "
            "names, no numbers",
            f"Delete {_rows_named(first, top)}; --force-gain and --position-gain convert units to "
            "SI",
        )
    end = next((k for k in range(min(rows, _MOST_SUMMARY + 1)) if not words[rows - 1 - k]), rows)
    if 0 < end <= _MOST_SUMMARY:
        raise InvalidInputError(
            path,
            f"ends with {_words_of(table.tail(end))} in row {rows - end + first}, below the "
            "samples: a summary, no sample",
            f"Delete {_rows_named(rows - end + first, end)}",
        )


def _words_of(rows: polars.DataFrame) -> str:
    """The cells of the first row that hold letters."""
    cells = [(cell or "").strip() for cell in rows.row(0)]
    found = [cell for cell in cells if any(letter.isalpha() for letter in cell)]
    return ", ".join(f"'{quote(cell)}'" for cell in found)


def _rows_named(first: int, count: int) -> str:
    return f"row {first}" if count == 1 else f"rows {first} to {first + count - 1}"
