"""Log files to Trajectory: columns named by the user, units made SI.

Each kind of file has a function read(path, content, columns) -> Reading, which is imported when a
file of its kind is read: columns by role (time, force, position and perhaps reference) with their
names in the file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from identification.errors import Finding, InvalidInputError, LogRefusedError, printable
from identification.readers.columns import LogColumns, Reading, conversion_of, quote
from identification.trajectory import Motion, Trajectory, refuse_sizes

__all__ = ["LogColumns", "load_trajectory"]

#: Module and function by the ending of the file's name.
_READERS = {
    ".csv": "text.read_text",
    ".txt": "text.read_text",
    ".tsv": "text.read_text",
    ".dat": "text.read_text",
    ".asc": "text.read_text",
    ".log": "text.read_text",
    ".lvm": "text.read_text",
    ".parquet": "binary.read_parquet",
    ".mat": "binary.read_mat",
    ".npz": "binary.read_npz",
    ".xlsx": "binary.read_excel",
    ".mcap": "bags.read_mcap",
}
#: Those read by foreign parsers, which a damaged file may bring down.
_ISOLATED = frozenset({".parquet", ".mat", ".xlsx", ".mcap"})
#: Endings of logs that are not read, and how to make one of them that is.
_INSTEAD = {
    ".xls": "Save it as .xlsx, or export the sheet as CSV",
    ".ods": "Save it as .xlsx, or export the sheet as CSV",
    ".db3": "Convert the bag: ros2 bag convert with output storage_id: mcap",
    ".bag": "Convert the bag of ROS 1 to MCAP of ROS 2",
}
#: Bytes. A CSV log of 20 million rows of three full-precision numbers is about 1.2 GB.
_LARGEST_FILE = 2_000_000_000
#: s. A loop slower than 10 Hz renders nothing, and stamps of a loop up to 10 kHz that count
#: milliseconds, microseconds or nanoseconds step by at least this.
_LONGEST_STEP = 0.1
#: s. A loop of 10 MHz; no device file takes less either.
_SHORTEST_STEP = 1e-7
#: Units stamps come in, and s in each; the first that makes a control loop is guessed.
_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}


def load_trajectory(
    path: str | PathLike[str],
    columns: LogColumns | None = None,
    *,
    motion: Motion | None = None,
    axis: str | None = None,
) -> Trajectory:
    """Read one log.

    Args:
        path: a .csv, .txt or .tsv file with a header, a .parquet file, a .mat file up to version
            7.2, a .npz file of numpy.savez, a .xlsx workbook or a .mcap bag of ROS 2.
        columns: names and gains; None means LogColumns().
        motion: "linear" (N, m) or "rotary" (N·m, rad); None leaves it to the hardware.
        axis: name of the axis; None takes ``columns.axis``, then "x".

    Returns:
        Trajectory in SI units with the digest of the file. Empty cells become NaN, which
        Trajectory refuses with their number.

    Raises:
        InvalidInputError: a file that cannot be read, or not as asked, names what there is; or
            numbers no device has.
        LogRefusedError: columns that cannot be a log (see Trajectory), or time that cannot be in
            seconds.
    """
    path = Path(path)
    columns = columns or LogColumns()
    reader = _reader_for(path)
    content = _content(path)
    reading = reader(path, content, columns)
    found = reading.values
    digest = "sha256:" + hashlib.sha256(content).hexdigest()
    del content
    lengths = {name: column.size for name, column in found.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in lengths.items())
        raise InvalidInputError(
            path, f"has columns of different lengths ({listed})", "Export columns of one length"
        )
    gains, stated, notes = conversion_of(path, reading, columns, motion)
    for role, gain in gains.items():
        if gain != 1:
            found[role] = found[role] * gain
            found[role].setflags(write=False)  # then it is not copied once more
    trajectory = Trajectory(
        time=found["time"],
        force=found["force"],
        position=found["position"],
        reference=found.get("reference"),
        axis=axis or columns.axis or "x",
        motion=motion,
        stated_units=stated,
        read_as=", ".join((*reading.notes, *notes)),
        source=printable(path.name),
        digest=digest,
    )
    _refuse_clock(trajectory, reading.names["time"])
    refuse_sizes(trajectory)
    return trajectory


def _reader_for(path: Path) -> Callable[[Path, bytes, LogColumns], Reading]:
    """The reader for the ending of a file's name. Raises InvalidInputError for another ending."""
    ending = path.suffix.lower()
    if ending not in _READERS:
        *some, last = _READERS
        problem = f"has the ending '{quote(path.suffix)}', which is not read"
        remedy = _INSTEAD.get(ending, f"Give a log that ends in {', '.join(some)} or {last}")
        raise InvalidInputError(path, problem, remedy)
    if ending in _ISOLATED:
        from identification.readers.isolated import read_isolated

        return partial(read_isolated, _READERS[ending])
    module, _, function = _READERS[ending].partition(".")
    reader: Any = getattr(import_module(f"{__name__}.{module}"), function)
    return reader


def _content(path: Path) -> bytes:
    """The file, read once, so that its digest is of what was read. Raises InvalidInputError."""
    try:
        if path.exists() and not path.is_file():
            problem = "cannot be read (it is a folder or a device, not a file)"
            raise InvalidInputError(path, problem, "Give the name of a file")
        size = path.stat().st_size
        if size > _LARGEST_FILE:
            problem = f"has {size} bytes, more than the {_LARGEST_FILE} that are read"
            raise InvalidInputError(path, problem, "Cut the log to a shorter part")
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        problem = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise InvalidInputError(path, problem, "Check the name and the permissions") from None
    if not content or content.isspace():
        raise InvalidInputError(path, "is empty", "Log or export it again")
    return content


def _refuse_clock(trajectory: Trajectory, column: str) -> None:
    """Refuse time that cannot be in seconds, naming its column."""
    step = trajectory.sample_time
    if _SHORTEST_STEP <= step < _LONGEST_STEP:
        return
    fitting = [
        name for name, unit in _UNITS.items() if _SHORTEST_STEP <= step * unit < _LONGEST_STEP
    ]
    guess = ""
    remedy = "Give the seconds in one unit of the column with --time-gain"
    if step >= _LONGEST_STEP and fitting:
        size = _UNITS[fitting[0]]
        guess = f"; as {fitting[0]} it would be {step * size:.4g} s"
        remedy += f" (in {fitting[0]}: --time-gain {size:g})"
        if np.array_equal(np.diff(trajectory.time), np.ones(len(trajectory) - 1)):
            guess = "; it may count rows" + guess.replace(";", ",")
    finding = Finding(
        code="force-unit",
        severity="refusal",
        seen=f"in {trajectory.source} column '{column}' steps by {step:.4g} in the median, no step "
        f"in seconds of a control loop{guess}",
        needed=f"{_SHORTEST_STEP:g} to {_LONGEST_STEP:g} s",
        remedy=f"{remedy}, or name the right column with --time.",
    )
    raise LogRefusedError((finding.of(trajectory.source),))
