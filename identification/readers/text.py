"""Text files: plain CSV at once, any other way to write a table once it is recognised."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from pathlib import Path

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, Reading, column_names
from identification.readers.comma_separated import read_csv
from identification.readers.encoding import as_utf8, refuse_zeros
from identification.readers.limits import refuse_packed

#: Bytes of the first two lines that are looked at before a file is read as plain.
_BEGINNING = 100_000


def read_text(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; empty cells are NaN. Raises InvalidInputError."""
    # Before letters of another encoding are made of the bytes that tell a packed file.
    refuse_packed(path, content)
    content, notes = as_utf8(path, content)
    refuse_zeros(path, content)
    if columns.decimal != "comma" and _is_plain(path, content, columns):
        try:
            reading = read_csv(path, content, columns)
        except InvalidInputError:
            other = _read_recognised(path, content, columns)
            if other is None:
                raise
            reading = other
    else:
        reading = _read_recognised(path, content, columns) or read_csv(path, content, columns)
    return replace(reading, notes=(*notes, *reading.notes)) if notes else reading


def _is_plain(path: Path, content: bytes, columns: LogColumns) -> bool:
    """Whether the first line names the columns and the next holds numbers with decimal points."""
    lines = [line for line in BytesIO(content[:_BEGINNING]).readlines() if line.strip()][:2]
    try:
        header, *others = (line.decode("utf-8-sig").strip("\r\n") for line in lines)
        separator = max(",;\t", key=header.count)
        names = [name.strip(' \t"#') for name in header.split(separator)]
        wanted = column_names(path, columns, names, table=True)
        places = [names.index(name) for name in wanted.values()]
        for line in others:
            cells = line.split(separator)
            if len(cells) > len(names):
                return False
            for cell in (cells[place].strip(' \t"') for place in places if place < len(cells)):
                float(cell or 0)
    except (ValueError, InvalidInputError):
        return False
    return True


def _read_recognised(path: Path, content: bytes, columns: LogColumns) -> Reading | None:
    """The file in the dialect it is seen to be in; None where that is plain or not seen."""
    from identification.readers.delimited import read_delimited
    from identification.readers.dialect import recognise

    dialect = recognise(path, content, columns)
    plain = dialect is None or (dialect.decimal == "point" and not dialect.layout.notes)
    if dialect is None or (plain and dialect.separator != " " and dialect.layout.header == 0):
        return None
    return read_delimited(path, content, dialect)
