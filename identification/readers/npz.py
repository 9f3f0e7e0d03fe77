"""NumPy archives (numpy.savez): one array a column, nothing unpickled."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

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
from identification.readers.limits import refuse_shape

#: What an array's name ends in inside the archive.
_ENDING = ".npy"
#: Kinds of numpy that are durations and dates.
_MOMENTS = "mM"
#: Readers of an array's header by the version of the format.
_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_npz(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; a time of dates or durations becomes seconds. Raises InvalidInputError."""
    try:
        with ZipFile(BytesIO(content)) as archive:
            members = [name for name in archive.namelist() if name.endswith(_ENDING)]
            names = [name.removesuffix(_ENDING) for name in members]
            wanted = column_names(path, columns, names, table=False)
            for name in wanted.values():
                if names.count(name) > 1:
                    raise InvalidInputError(
                        path,
                        f"has two arrays named '{quote(name)}'",
                        "Rename one of them",
                    )
            kinds = {role: _kind(path, archive, role, name) for role, name in wanted.items()}
            values = {role: _column(archive, name, kinds[role]) for role, name in wanted.items()}
            moments = kinds["time"].kind in _MOMENTS
            return Reading(values=values, names=wanted, in_seconds=moments)
    except InvalidInputError:
        raise
    except Exception as error:  # noqa: BLE001  # a damaged file trips the parser anywhere
        raise InvalidInputError(
            path,
            f"is not a readable NumPy archive ({first_words(error)})",
            "Save it again with numpy.savez(path, time=…, force=…, position=…)",
        ) from None


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
        raise InvalidInputError(
            path,
            f"array '{quote(name)}' is {what}, not of real numbers",
            "Save it as an array of float64",
        )
    refuse_shape(path, name, shape)
    return kind


def _column(archive: ZipFile, name: str, kind: np.dtype[Any]) -> FloatArray:
    """One array of a type that was looked at."""
    with archive.open(name + _ENDING) as stream:
        stored = np.lib.format.read_array(stream, allow_pickle=False).ravel()
    if kind.kind in _MOMENTS:
        return _seconds(stored)
    return np.asarray(stored, dtype=np.float64)


def _seconds(moments: np.ndarray[Any, Any]) -> FloatArray:
    """Seconds since the first of dates or durations; one that is missing is NaN."""
    return np.asarray((moments - moments[0]) / np.timedelta64(1, "s"), dtype=np.float64)
