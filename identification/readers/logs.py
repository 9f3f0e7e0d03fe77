"""Log files to Trajectory: columns named by the user, units made SI."""

from __future__ import annotations

import hashlib
from os import PathLike
from pathlib import Path

import numpy as np

from identification.errors import Finding, InvalidInputError, LogRefusedError
from identification.readers import reader_for
from identification.readers.columns import LogColumns
from identification.readers.conversion import conversion_of
from identification.readers.limits import LARGEST_FILE
from identification.readers.sizes import refuse_sizes
from identification.trajectory import Motion, Trajectory

__all__ = ["LogColumns", "load_trajectory"]

#: s. A loop slower than 10 Hz renders nothing, and stamps of a loop up to 10 kHz that count
#: milliseconds, microseconds or nanoseconds step by at least this.
LONGEST_STEP = 0.1
#: s. A loop of 10 MHz; no device file takes less either.
SHORTEST_STEP = 1e-7

#: Units stamps come in, and s in each; the first that makes a control loop is guessed.
_UNITS = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))


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
    reader = reader_for(path)
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
    conversion = conversion_of(path, reading, columns, motion)
    for role, gain in conversion.gains.items():
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
        stated_units=conversion.stated,
        read_as=", ".join((*reading.notes, *conversion.notes)),
        source=path.name,
        digest=digest,
    )
    refuse_clock(trajectory, reading.names["time"])
    refuse_sizes(trajectory)
    return trajectory


def _content(path: Path) -> bytes:
    """The file, read once, so that its digest is of what was read. Raises InvalidInputError."""
    try:
        if path.exists() and not path.is_file():
            problem = "cannot be read (it is a folder or a device, not a file)"
            raise InvalidInputError(path, problem, "Give the name of a file")
        if path.stat().st_size > LARGEST_FILE:
            problem = f"has {path.stat().st_size} bytes, more than the {LARGEST_FILE} that are read"
            raise InvalidInputError(path, problem, "Cut the log to a shorter part")
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        problem = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise InvalidInputError(path, problem, "Check the name and the permissions") from None
    if not content or content.isspace():
        raise InvalidInputError(path, "is empty", "Log or export it again")
    return content


def refuse_clock(trajectory: Trajectory, column: str) -> None:
    """Refuse time that cannot be in seconds.

    Args:
        trajectory: the log as read.
        column: name of its column of time, for the message.

    Raises:
        LogRefusedError: a median step of LONGEST_STEP or more, or below SHORTEST_STEP.
    """
    step = trajectory.sample_time
    if SHORTEST_STEP <= step < LONGEST_STEP:
        return
    fitting = [name for name, size in _UNITS if SHORTEST_STEP <= step * size < LONGEST_STEP]
    guess = ""
    remedy = "Give the seconds in one unit of the column with --time-gain"
    if step >= LONGEST_STEP and fitting:
        size = dict(_UNITS)[fitting[0]]
        guess = f"; as {fitting[0]} it would be {step * size:.4g} s"
        remedy += f" (in {fitting[0]}: --time-gain {size:g})"
        if np.array_equal(np.diff(trajectory.time), np.ones(len(trajectory) - 1)):
            guess = "; it may count rows" + guess.replace(";", ",")
    finding = Finding(
        code="force-unit",
        severity="refusal",
        seen=f"in {trajectory.source} column '{column}' steps by {step:.4g} in the median, no step "
        f"in seconds of a control loop{guess}",
        needed=f"{SHORTEST_STEP:g} to {LONGEST_STEP:g} s",
        remedy=f"{remedy}, or name the right column with --time.",
    )
    raise LogRefusedError((finding.of(trajectory.source),))
