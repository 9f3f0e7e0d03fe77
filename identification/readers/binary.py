"""Files of columns that are no text: Parquet, MATLAB up to version 7.2, NumPy archives, Excel."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, time, timedelta
from io import BytesIO
from itertools import islice
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    column_names,
    quote,
    refuse_long,
    refused_as,
)
from identification.readers.tables import (
    FEWEST_COLUMNS,
    MOST_ABOVE,
    MOST_BETWEEN,
    MOST_COLUMNS,
    Layout,
    find_layout,
    named_by,
    roles_of,
)

if TYPE_CHECKING:
    import polars

#: A MATLAB v7.3 file is HDF5 behind a header of this many bytes, or HDF5 from its first byte.
_HEADER = 512
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Classes of variables that are arrays of numbers, as the file's directory calls them.
_NUMERIC = frozenset(
    [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)] + ["double", "single"]
)
#: What an array's name ends in inside a NumPy archive.
_ENDING = ".npy"
#: Kinds of numpy that are durations and dates.
_MOMENTS = "mM"
#: Readers of an array's header by the version of the format.
_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_parquet(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; a time of dates or durations becomes seconds. Raises InvalidInputError."""
    import polars as pl

    remedy = "Export it again, or as CSV"
    with refused_as(path, "Parquet file", remedy, pl.exceptions.PanicException):
        types = pl.read_parquet_schema(BytesIO(content))
        wanted = column_names(path, columns, list(types), table=True)
        for role, name in wanted.items():
            kind = types[name]
            if not kind.is_numeric() and not (role == "time" and _is_moment(kind)):
                remedy = "Store it as Float64, one number in each row"
                problem = f"column '{quote(name)}' is of type {quote(str(kind))}, no real numbers"
                remedy = remedy + (", in seconds" if role == "time" else "")
                raise InvalidInputError(path, problem, remedy)
        rows = pl.scan_parquet(BytesIO(content)).select(pl.len()).collect().item()
        refuse_long(path, rows)
        table = pl.read_parquet(BytesIO(content), columns=list(dict.fromkeys(wanted.values())))
        return Reading(
            values={role: _numbers(table[name]) for role, name in wanted.items()},
            names=wanted,
            in_seconds=_is_moment(types[wanted["time"]]),
        )


def _is_moment(kind: polars.DataType) -> bool:
    """Date with time of day, or duration: types that carry their own unit of time."""
    import polars as pl

    return isinstance(kind, pl.Datetime | pl.Duration)


def _numbers(column: polars.Series) -> FloatArray:
    """A column as numbers, a missing one NaN; moments as seconds since the first."""
    import polars as pl

    if _is_moment(column.dtype):
        elapsed = column - column[0]
        # Counted in the unit of the type, which nothing rounds.
        unit = {"ms": 1e3, "us": 1e6, "ns": 1e9}[str(getattr(elapsed.dtype, "time_unit", "us"))]
        column = elapsed.to_physical().cast(pl.Float64) / unit
    return np.asarray(column.cast(pl.Float64).fill_null(float("nan")).to_numpy(), dtype=np.float64)


def read_mat(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role, one variable a column. Raises InvalidInputError."""
    import scipy.io

    if content.startswith(_HDF5) or content[_HEADER : _HEADER + len(_HDF5)] == _HDF5:
        problem = "is a MATLAB file of version 7.3 (HDF5), which is not read"
        raise InvalidInputError(path, problem, "Save it with save(..., '-v7') or as CSV")
    reader: Any = scipy.io
    with refused_as(path, "MATLAB file", "Save it again with save(..., '-v7')"):
        directory: list[tuple[str, tuple[int, ...], str]] = reader.whosmat(BytesIO(content))
        present = {str(name): (shape, kind) for name, shape, kind in directory}
        structs = [quote(name) for name, (_, kind) in present.items() if kind == "struct"]
        if structs and len(present) - len(structs) < FEWEST_COLUMNS:
            problem = f"holds its columns in the struct '{structs[0]}', which is not read"
            remedy = f"Save its fields: save('{path.name}', '-struct', '{structs[0]}', '-v7')"
            raise InvalidInputError(path, problem, remedy)
        wanted = column_names(path, columns, list(present), table=False)
        # Before anything is unpacked: shapes and classes stand in the directory, ...
        for name in wanted.values():
            shape, kind = present[name]
            _refuse_variable(path, name, shape if kind in _NUMERIC else None)
        stored = reader.loadmat(BytesIO(content), variable_names=list(wanted.values()))
        values: dict[str, FloatArray] = {}
        for role, name in wanted.items():
            array: Any = stored[name]  # ... which may have lied
            is_numeric = isinstance(stored[name], np.ndarray) and array.dtype.kind in "iuf"
            _refuse_variable(path, name, array.shape if is_numeric else None)
            values[role] = np.asarray(array, dtype=np.float64).ravel()
        return Reading(values=values, names=wanted)


def _refuse_variable(path: Path, name: str, shape: tuple[int, ...] | None) -> None:
    """Refuse a variable whose shape is no single column, or None: it is no array of numbers."""
    if shape is None:
        problem = f"variable '{quote(name)}' is not an array of real numbers"
        raise InvalidInputError(path, problem, "Save it as double")
    _refuse_shape(path, name, shape)


def _refuse_shape(path: Path, name: str, shape: tuple[int, ...]) -> None:
    """Refuse a stored array that is no single column, or too long."""
    refuse_long(path, prod(shape))
    if len([size for size in shape if size != 1]) != 1:
        size = " x ".join(str(size) for size in shape) or "a single number"
        problem = f"variable '{quote(name)}' is {size}, not a single column"
        raise InvalidInputError(path, problem, "Name a variable with one value for each sample")


def read_npz(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role, one array a column, nothing unpickled; raises InvalidInputError.

    A time of dates or durations becomes seconds.
    """
    remedy = "Save it again with numpy.savez(path, time=…, force=…, position=…)"
    with refused_as(path, "NumPy archive", remedy), ZipFile(BytesIO(content)) as archive:
        members = [name for name in archive.namelist() if name.endswith(_ENDING)]
        names = [name.removesuffix(_ENDING) for name in members]
        wanted = column_names(path, columns, names, table=False)
        for name in wanted.values():
            if names.count(name) > 1:
                problem = f"has two arrays named '{quote(name)}'"
                raise InvalidInputError(path, problem, "Rename one of them")
        kinds = {role: _kind(path, archive, role, name) for role, name in wanted.items()}
        values = {role: _array(archive, name, kinds[role]) for role, name in wanted.items()}
        moments = kinds["time"].kind in _MOMENTS
        return Reading(values=values, names=wanted, in_seconds=moments)


def _kind(path: Path, archive: ZipFile, role: str, name: str) -> np.dtype[Any]:
    """Type of an array, its header read before memory is spent on it."""
    with archive.open(name + _ENDING) as stream:
        version = np.lib.format.read_magic(stream)
        if version not in _HEADERS:
            raise InvalidInputError(
                path,
                f"array '{quote(name)}' has format {version[0]}.{version[1]}, made for records",
                "Save a plain array of float64",
            )
        shape, _, kind = _HEADERS[version](stream)
    allowed = "iuf" + _MOMENTS if role == "time" else "iuf"
    if kind.kind not in allowed:
        what = "pickled Python objects" if kind.hasobject else f"of type {quote(str(kind))}"
        problem = f"array '{quote(name)}' is {what}, not of real numbers"
        raise InvalidInputError(path, problem, "Save it as an array of float64")
    _refuse_shape(path, name, shape)
    return kind


def _array(archive: ZipFile, name: str, kind: np.dtype[Any]) -> FloatArray:
    """One array of a type that was looked at; moments as seconds, one that is missing NaN."""
    with archive.open(name + _ENDING) as stream:
        stored = np.lib.format.read_array(stream, allow_pickle=False).ravel()
    if kind.kind in _MOMENTS:
        stored = (stored - stored[0]) / np.timedelta64(1, "s")
    return np.asarray(stored, dtype=np.float64)


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
