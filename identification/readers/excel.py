"""Excel workbooks: one sheet with a header and rows of numbers, read row by row."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, time, timedelta
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import (
    LogColumns,
    Reading,
    column_names,
    quote,
    refuse_long,
    refused_as,
)
from identification.readers.tables import (
    MOST_ABOVE,
    MOST_BETWEEN,
    MOST_COLUMNS,
    Layout,
    find_layout,
    named_by,
    roles_of,
)

#: Empty rows in a row; a cell far away makes a million of them.
_MOST_EMPTY = 1000
#: Where workbooks count days from.
_START = datetime(1900, 1, 1)


def read_excel(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; a time of dates or times of day becomes seconds. Raises InvalidInputError.

    Formulas count with the result that was stored; empty cells are NaN.
    """
    try:
        import openpyxl
    except ImportError:
        raise InvalidInputError(
            path,
            "is an Excel workbook, and openpyxl, which reads them, is not installed",
            'Install it with python -m pip install "haptune[excel]", or export the sheet as CSV',
        ) from None
    reader: Any = openpyxl
    with refused_as(path, "Excel workbook", "Save it again as .xlsx, or export the sheet as CSV"):
        book = reader.load_workbook(BytesIO(content), read_only=True, data_only=True)
        layouts = [(sheet.title, _layout(path, sheet, columns)) for sheet in book.worksheets]
        found = [(name, layout) for name, layout in layouts if layout is not None]
        if not found:
            raise _no_table(path, book, columns)
        if len(found) > 1:
            names = ", ".join(f"'{quote(name)}'" for name, _ in found[:10])
            problem = f"has several sheets with the columns of a log: {names}"
            raise InvalidInputError(path, problem, "Keep one of them in the file")
        name, layout = found[0]
        return _reading(path, book[name], layout, alone=len(book.worksheets) == 1)


def _rows(path: Path, sheet: Any) -> Iterator[tuple[Any, ...]]:
    """Rows of values, however far down cells claim to stand."""
    sheet.reset_dimensions()
    empty = 0
    for count, row in enumerate(sheet.iter_rows(values_only=True), 1):
        refuse_long(path, count)
        empty = 0 if any(cell is not None for cell in row) else empty + 1
        if empty > _MOST_EMPTY:
            raise InvalidInputError(
                path,
                f"has more than {_MOST_EMPTY} empty rows above a cell, from row {count - empty} on",
                "Delete what stands far below the log",
            )
        if len(row) > MOST_COLUMNS:
            raise InvalidInputError(
                path, f"has {len(row)} columns, more than {MOST_COLUMNS}", "Keep those of the log"
            )
        yield row


def _text(cell: Any) -> str:
    """A cell as a header and units are looked for in it; moments look like numbers."""
    if cell is None:
        return ""
    if isinstance(cell, (datetime, time, timedelta)):
        return "0"
    return repr(cell) if isinstance(cell, float) else str(cell)


def _layout(path: Path, sheet: Any, columns: LogColumns) -> Layout | None:
    """Where the log stands on a sheet; None if it does not."""
    first = islice(_rows(path, sheet), MOST_ABOVE + MOST_BETWEEN + 1)
    rows = [tuple(map(_text, row)) for row in first]
    for header, row in enumerate(rows[:MOST_ABOVE]):
        if roles_of(path, row, columns) is not None:
            below = rows[header + 1 : header + 2 + MOST_BETWEEN]
            return find_layout(path, rows[: header + 1], below, columns)
    return None


def _no_table(path: Path, book: Any, columns: LogColumns) -> InvalidInputError:
    """Why no sheet holds a log: what the first rows that look like headers name."""
    for sheet in book.worksheets:
        for row in islice(_rows(path, sheet), MOST_ABOVE):
            names = [name for name in named_by(tuple(map(_text, row))) if name]
            if len(names) > 1:
                try:
                    column_names(path, columns, names, table=True)
                except InvalidInputError as error:
                    return error
                return InvalidInputError(
                    path,
                    f"has rows on sheet '{quote(sheet.title)}' between its header and its "
                    "numbers, or above both, that are neither comments nor units",
                    "Delete them",
                )
    return InvalidInputError(path, "has no table on any sheet", "Export the log again")


def _reading(path: Path, sheet: Any, layout: Layout, *, alone: bool) -> Reading:
    """The columns of a log whose place is known."""
    places = layout.places
    cells: dict[str, list[Any]] = {role: [] for role in places}
    for row in islice(_rows(path, sheet), layout.first, None):
        for role, place in places.items():
            cells[role].append(row[place] if place < len(row) else None)
    while cells["time"] and all(column[-1] is None for column in cells.values()):
        for column in cells.values():
            column.pop()
    moments = next((c for c in cells["time"] if c is not None), None)
    in_seconds = isinstance(moments, (datetime, time, timedelta))
    if in_seconds:
        cells["time"] = _seconds(cells["time"])
    values = {
        role: np.array([_number(path, layout, role, k, c) for k, c in enumerate(column)])
        for role, column in cells.items()
    }
    notes = layout.notes if alone else (f"sheet '{quote(sheet.title)}'", *layout.notes)
    return Reading(values=values, names=layout.wanted, notes=notes, in_seconds=in_seconds)


def _seconds(moments: list[Any]) -> list[Any]:
    """Seconds since the first of dates, times of day or durations; other cells stay."""
    elapsed = [_since_start(moment) for moment in moments]
    start = next(each for each in elapsed if isinstance(each, timedelta))
    return [
        (each - start).total_seconds() if isinstance(each, timedelta) else each for each in elapsed
    ]


def _since_start(moment: Any) -> Any:
    if isinstance(moment, datetime):
        return moment - _START
    if isinstance(moment, time):
        return datetime.combine(_START, moment) - _START
    return moment


def _number(path: Path, layout: Layout, role: str, row: int, cell: Any) -> float:
    """A cell as a number, NaN if it is empty; text that is none is refused by its row."""
    if cell is None or cell == "":
        return float("nan")
    if isinstance(cell, (int, float)) and not isinstance(cell, bool):
        return float(cell)
    try:
        return float(cell) if isinstance(cell, str) else float("x")
    except ValueError:
        raise InvalidInputError(
            path,
            f"column '{quote(layout.wanted[role])}' holds '{quote(str(cell))}' in row "
            f"{layout.first + row + 1}, which is not a number",
            "Write numbers as numbers, not as text, and leave missing cells empty",
        ) from None
