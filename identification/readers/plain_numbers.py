"""Plain CSV of numbers alone, read without the table library, which takes longer to load."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, Reading, wanted_columns

#: Bytes. Beyond it the time to load the table library is earned back.
_LARGEST = 8_000_000
#: Anything but numbers, separators and line ends.
_OTHER = re.compile(rb"[^0-9.eE+\-,;\t\n]")


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
        wanted = wanted_columns(path, columns, names, table=True)
        cells = {line.count(separator.encode()) + 1 for line in body.split(b"\n")}
        if len(set(names)) < len(names) or cells != {len(names)}:
            return None
        places = [names.index(name) for name in wanted.values()]
        table = np.loadtxt(BytesIO(body), delimiter=separator, usecols=places, ndmin=2)
    except (InvalidInputError, ValueError):
        return None
    values = {role: column.copy() for role, column in zip(wanted, table.T, strict=True)}
    return Reading(values=values, names=wanted)
