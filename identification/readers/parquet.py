"""Parquet files: one table of typed columns."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    column_names,
    first_words,
    quote,
)
from identification.readers.limits import refuse_long

if TYPE_CHECKING:
    import polars


def read_parquet(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; a time of dates or durations becomes seconds. Raises InvalidInputError."""
    import polars as pl

    try:
        types = pl.read_parquet_schema(BytesIO(content))
        wanted = column_names(path, columns, list(types), table=True)
        for role, name in wanted.items():
            _refuse_type(path, role, name, types[name])
        rows = pl.scan_parquet(BytesIO(content)).select(pl.len()).collect().item()
        refuse_long(path, rows)
        table = pl.read_parquet(BytesIO(content), columns=list(dict.fromkeys(wanted.values())))
        return Reading(
            values={role: _numbers(table[name]) for role, name in wanted.items()},
            names=wanted,
            in_seconds=_is_moment(types[wanted["time"]]),
        )
    except InvalidInputError:
        raise
    except (Exception, pl.exceptions.PanicException) as error:  # noqa: BLE001  # damaged anywhere
        raise InvalidInputError(
            path,
            f"is not a readable Parquet file ({first_words(error)})",
            "Export it again, or as CSV",
        ) from None


def _refuse_type(path: Path, role: str, name: str, kind: polars.DataType) -> None:
    if kind.is_numeric() or (role == "time" and _is_moment(kind)):
        return
    remedy = "Store it as Float64, one number in each row"
    if role == "time":
        remedy += ", in seconds"
    raise InvalidInputError(
        path,
        f"column '{quote(name)}' is of type {quote(str(kind))}, no real numbers",
        remedy,
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
