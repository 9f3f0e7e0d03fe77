"""CSV files: one header line, then rows of numbers.

Numbers alone are read here, without the table library, which takes longer to load.
"""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, Reading, column_names
from identification.readers.limits import (
    refuse_long,
    refuse_open_quote,
    refuse_packed,
    refuse_wide,
)

#: Separators tried; the one most frequent in the header wins, the first of equals.
_SEPARATORS = ",;\t"
#: What a line without a name consists of: its end, and the mark of a file in UTF-8.
_NOTHING = b"\xef\xbb\xbf\r\n"
#: Bytes. Beyond it the time to load the table library is earned back.
_LARGEST = 8_000_000
#: Anything but numbers, separators and line ends.
_OTHER = re.compile(rb"[^0-9.eE+\-,;\t\n]")


def read_csv(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; empty cells are NaN. Raises InvalidInputError."""
    refuse_packed(path, content)
    refuse_long(path, content.count(b"\n") - 1)
    header = _header(path, content)
    separator = max(_SEPARATORS, key=lambda mark: header.count(mark.encode()))
    refuse_wide(path, header, header.count(separator.encode()) + 1)
    reading = read_plain_numbers(path, content, separator, columns)
    if reading is None:
        from identification.readers.cells import read_cells

        reading = read_cells(path, content, header, separator, columns)
    return reading


def read_plain_numbers(
    path: Path, content: bytes, separator: str, columns: LogColumns
) -> Reading | None:
    """Columns by role of a table whose every cell is a number with a decimal point.

    Args:
        path: the file, for messages.
        content: UTF-8 text, all of the file.
        separator: of the columns.
        columns: what the user asked for.

    Returns:
        None for a table that is larger or not as plain: quotes, repeated or missing names, rows of
        other lengths, empty cells or cells that are no number.
    """
    if len(content) > _LARGEST:
        return None
    header, _, body = content.removeprefix(b"\xef\xbb\xbf").partition(b"\n")
    body = body.replace(b"\r\n", b"\n").removesuffix(b"\n")
    if not body or b'"' in header or _OTHER.search(body):
        return None
    try:
        names = [name.strip("# ") for name in header.decode().strip("\r").split(separator)]
        wanted = column_names(path, columns, names, table=True)
        cells = {line.count(separator.encode()) + 1 for line in body.split(b"\n")}
        if len(set(names)) < len(names) or cells != {len(names)}:
            return None
        places = [names.index(name) for name in wanted.values()]
        table = np.loadtxt(BytesIO(body), delimiter=separator, usecols=places, ndmin=2)
    except (InvalidInputError, ValueError):
        return None
    values = {role: column.copy() for role, column in zip(wanted, table.T, strict=True)}
    return Reading(values=values, names=wanted)


def _header(path: Path, content: bytes) -> bytes:
    """The first line that holds anything. Raises InvalidInputError where it does not end there."""
    header = next((line for line in BytesIO(content) if line.strip(_NOTHING)), b"")
    refuse_open_quote(path, header)
    return header
