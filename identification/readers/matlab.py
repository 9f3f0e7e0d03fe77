"""MATLAB files up to version 7.2: one variable a column."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from identification.errors import InvalidInputError
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    column_names,
    first_words,
    quote,
)
from identification.readers.limits import refuse_shape

#: A MATLAB v7.3 file is HDF5 behind a header of this many bytes, or HDF5 from its first byte.
_HEADER = 512
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Classes of variables that are arrays of numbers, as the file's directory calls them.
_NUMERIC = frozenset(
    [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)] + ["double", "single"]
)


def read_mat(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role. Raises InvalidInputError."""
    import scipy.io

    if content.startswith(_HDF5) or content[_HEADER : _HEADER + len(_HDF5)] == _HDF5:
        raise InvalidInputError(
            path,
            "is a MATLAB file of version 7.3 (HDF5), which is not read",
            "Save it with save(..., '-v7') or as CSV",
        )
    reader: Any = scipy.io
    try:
        present = {str(name): (shape, kind) for name, shape, kind in _directory(content)}
        wanted = column_names(path, columns, list(present), table=False)
        # Before anything is unpacked: shapes and classes stand in the directory.
        for name in wanted.values():
            shape, kind = present[name]
            if kind not in _NUMERIC:
                raise _no_numbers(path, name)
            refuse_shape(path, name, shape)
        stored = reader.loadmat(BytesIO(content), variable_names=list(wanted.values()))
        values = {role: _vector(path, name, stored[name]) for role, name in wanted.items()}
        return Reading(values=values, names=wanted)
    except InvalidInputError:
        raise
    except Exception as error:  # noqa: BLE001  # a damaged file trips the parser anywhere
        raise InvalidInputError(
            path,
            f"is not a readable MATLAB file ({first_words(error)})",
            "Save it again with save(..., '-v7')",
        ) from None


def _directory(content: bytes) -> list[tuple[str, tuple[int, ...], str]]:
    import scipy.io

    reader: Any = scipy.io
    return reader.whosmat(BytesIO(content))


def _vector(path: Path, name: str, stored: Any) -> FloatArray:
    """A variable as a column; its directory entry may have lied."""
    if not isinstance(stored, np.ndarray):
        raise _no_numbers(path, name)
    array = cast("NDArray[Any]", stored)
    if array.dtype.kind not in "iuf":
        raise _no_numbers(path, name)
    refuse_shape(path, name, array.shape)
    return np.asarray(array, dtype=np.float64).ravel()


def _no_numbers(path: Path, name: str) -> InvalidInputError:
    problem = f"variable '{quote(name)}' is not an array of real numbers"
    return InvalidInputError(path, problem, "Save it as double")
