"""What loggers and spreadsheets do to CSV files, recognised and named with the step to take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, quoted

if TYPE_CHECKING:
    import polars

#: Marks that UTF-32 and UTF-16 text begins with, the longer first.
_WIDE_MARKS = {
    b"\xff\xfe\x00\x00": "UTF-32",
    b"\x00\x00\xfe\xff": "UTF-32",
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
}
#: Bytes looked at for text of two bytes a letter without a mark.
_SAMPLE = 1000
#: Bytes and lines from the beginning among which a header is looked for.
_BEGINNING = 100_000
_MOST_LINES = 200
#: Columns of the shortest header: time, force, position.
_FEWEST_COLUMNS = 3
#: Rows that units may take below the header, and a summary at the end.
_MOST_UNITS = 3
_MOST_SUMMARY = 10


def refuse_encoding(path: Path, content: bytes) -> None:
    """Refuse bytes that are no lines of UTF-8 or ASCII text.

    Args:
        path: the file, for the message.
        content: all of it.

    Raises:
        InvalidInputError: UTF-16 or UTF-32, NUL bytes, or lines ended by carriage returns alone.
    """
    mark = next((name for mark, name in _WIDE_MARKS.items() if content.startswith(mark)), None)
    if mark is None and _two_bytes_a_letter(content[:_SAMPLE]):
        mark = "UTF-16"
    if mark is not None:
        raise InvalidInputError(
            path, f"is {mark} text, which is not read", "Save it as UTF-8 (CSV UTF-8 in Excel)"
        )
    first = content.find(b"\0")
    if first >= 0:
        count = content.count(b"\0")
        line = content.count(b"\n", 0, first) + 1
        raise InvalidInputError(
            path,
            f"holds {count} NUL byte{'' if count == 1 else 's'}, the first in line {line}: it is "
            "no text, or was cut off while it was written",
            "Log or export it again" + (f", or keep the lines before line {line}" * (line > 1)),
        )
    if b"\r" in content and b"\n" not in content:
        raise InvalidInputError(
            path,
            "ends its lines with carriage returns (CR) alone, as old Macintosh programs do",
            "Save it with line ends LF or CR LF (CSV UTF-8 in Excel)",
        )


def _two_bytes_a_letter(start: bytes) -> bool:
    """Whether every other byte is NUL, as in UTF-16 of plain letters."""
    pairs = len(start) // 2
    return pairs > 0 and any(
        start[side : 2 * pairs : 2].count(0) == pairs
        and start[1 - side : 2 * pairs : 2].count(0) == 0
        for side in (0, 1)
    )


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
                f"line {above + 1}; the first is '{quoted(lines[0])}'",
                "Delete the lines above the header",
            )
    first = lines[0] if lines else ""
    if first.startswith("#") and len(first.split(separator)) < _FEWEST_COLUMNS:
        raise InvalidInputError(
            path,
            f"begins with a comment, '{quoted(first)}', where the names of the columns should be",
            "Delete the lines above the header",
        )


def _separator(line: str, otherwise: str) -> str:
    found = max(",;\t", key=line.count)
    return found if found in line else otherwise


def refuse_other_rows(path: Path, table: polars.DataFrame) -> None:
    """Refuse rows of units below the header and rows of a summary at the end.

    Args:
        path: the file, for the message.
        table: the columns of the log as text; row 1 of the file is the header, row 2 its first.

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
            f"holds {_words_of(table.head(top))} in row 2, below the header: units or names, "
            "no numbers",
            f"Delete {_rows_named(2, top)}; --force-gain and --position-gain convert units to SI",
        )
    end = next((k for k in range(min(rows, _MOST_SUMMARY + 1)) if not words[rows - 1 - k]), rows)
    if 0 < end <= _MOST_SUMMARY:
        raise InvalidInputError(
            path,
            f"ends with {_words_of(table.tail(end))} in row {rows - end + 2}, below the samples: "
            "a summary, no sample",
            f"Delete {_rows_named(rows - end + 2, end)}",
        )


def _words_of(rows: polars.DataFrame) -> str:
    """The cells of the first row that hold letters."""
    cells = [(cell or "").strip() for cell in rows.row(0)]
    found = [cell for cell in cells if any(letter.isalpha() for letter in cell)]
    return ", ".join(f"'{quoted(cell)}'" for cell in found)


def _rows_named(first: int, count: int) -> str:
    return f"row {first}" if count == 1 else f"rows {first} to {first + count - 1}"
