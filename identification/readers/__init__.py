"""Readers of log files, one kind of file each.

read(path, content, columns) -> columns by role: time, force, position and perhaps reference.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from identification.readers.columns import FloatArray
from identification.readers.columns import LogColumns as LogColumns
from identification.readers.comma_separated import read_csv
from identification.readers.matlab import read_mat
from identification.readers.npz import read_npz
from identification.readers.parquet import read_parquet

#: Readers by the ending of the file's name.
READERS: dict[str, Callable[[Path, bytes, LogColumns], dict[str, FloatArray]]] = {
    ".csv": read_csv,
    ".parquet": read_parquet,
    ".mat": read_mat,
    ".npz": read_npz,
}

__all__ = ["READERS", "LogColumns"]
