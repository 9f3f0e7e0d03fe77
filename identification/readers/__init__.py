"""Readers of log files, one kind of file each.

read(path, content, columns) -> Reading: columns by role (time, force, position and perhaps
reference) with their names in the file. A reader is imported when a file of its kind is read.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns as LogColumns
from identification.readers.columns import Reading, quote

Reader = Callable[[Path, bytes, LogColumns], Reading]

#: Module and function by the ending of the file's name.
_READERS = {
    ".csv": "text.read_text",
    ".txt": "text.read_text",
    ".tsv": "text.read_text",
    ".parquet": "parquet.read_parquet",
    ".mat": "matlab.read_mat",
    ".npz": "npz.read_npz",
    ".xlsx": "excel.read_excel",
    ".mcap": "mcap_.read_mcap",
}
#: Endings of logs that are not read, and how to make one of them that is.
_INSTEAD = {
    ".xls": "Save it as .xlsx, or export the sheet as CSV",
    ".ods": "Save it as .xlsx, or export the sheet as CSV",
    ".db3": "Convert the bag: ros2 bag convert with output storage_id: mcap",
    ".bag": "Convert the bag of ROS 1 to MCAP of ROS 2",
}

__all__ = ["LogColumns", "Reader", "reader_for"]


def reader_for(path: Path) -> Reader:
    """The reader for the ending of a file's name. Raises InvalidInputError for another ending."""
    ending = path.suffix.lower()
    if ending not in _READERS:
        *some, last = _READERS
        raise InvalidInputError(
            path,
            f"has the ending '{quote(path.suffix)}', which is not read",
            _INSTEAD.get(ending, f"Give a log that ends in {', '.join(some)} or {last}"),
        )
    module, _, function = _READERS[ending].partition(".")
    reader: Any = getattr(import_module(f"{__name__}.{module}"), function)
    return reader
