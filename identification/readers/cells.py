"""Cells of a column of text as numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.errors import InvalidInputError
from identification.readers.columns import FloatArray, quoted

if TYPE_CHECKING:
    import polars

    from identification.readers.dialect import Decimal


def as_pointed(cells: Any, decimal: Decimal) -> Any:
    """Text without spaces around it, and with decimal points, of a polars column or expression."""
    text = cells.str.strip_chars()
    if decimal == "point":
        return text
    return text.str.replace_all(".", "'", literal=True).str.replace(",", ".", literal=True)


def numbers_of(
    path: Path, name: str, cells: polars.Series, *, first: int, decimal: Decimal = "point"
) -> FloatArray:
    """A column as numbers, shape (rows,); an empty cell is NaN.

    Args:
        path: the file, for the message.
        name: of the column, for the message.
        cells: text or numbers.
        first: row of the file that is the first of the column, 1 the file's first.
        decimal: what stands before decimals in text.

    Raises:
        InvalidInputError: a cell that is no number, by its row.
    """
    import polars as pl

    numbers = cells
    if cells.dtype == pl.String:
        text = as_pointed(cells, decimal)
        numbers = text.cast(pl.Float64, strict=False)
        wrong = (numbers.is_null() & text.is_not_null() & (text != "")).fill_null(value=False)
        found = wrong.arg_true()
        if found.len():
            row = int(found[0])
            raise InvalidInputError(
                path,
                f"column '{quoted(name)}' holds '{quoted(str(cells[row]))}' in row {row + first}, "
                f"which is not a number with a decimal {decimal}",
                "Write all numbers alike, and leave missing cells empty",
            )
    return np.asarray(numbers.fill_null(float("nan")).to_numpy(), dtype=np.float64)
