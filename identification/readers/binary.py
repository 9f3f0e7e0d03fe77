"""Binary files of columns: Parquet, MATLAB up to version 7.2, NumPy archives."""

from __future__ import annotations

from io import BytesIO
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
