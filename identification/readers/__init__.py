"""Log files to Trajectory: columns named by the user, units made SI.

Each kind of file has a function read(path, content, columns) -> Reading, which is imported when a
file of its kind is read: columns by role (time, force, position and perhaps reference) with their
names in the file.

A library that reads a damaged or hostile file may end the process by a signal, print, run on or
take all memory. Foreign parsers therefore work in a process of their own, where each of that is a
sentence. The system limits memory on Linux, processor time where it is POSIX; the deadline by the
clock holds everywhere.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from multiprocessing.spawn import get_executable
from os import PathLike
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from identification.errors import (
    InvalidInputError,
    LogRefusedError,
    QuestionError,
    counted,
    printable,
    refusal,
    typed,
)
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    conversion_of,
    quote,
    say_gains_by_axis,
)
from identification.trajectory import Motion, Trajectories, Trajectory, refuse_sizes

__all__ = ["LOG_ENDINGS", "LogColumns", "load_log", "load_trajectory"]

#: Module and function by the ending of the file's name.
_READERS = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".lvm"), "text.read_text"),
    ".parquet": "binary.read_parquet",
    ".mat": "binary.read_mat",
    ".npz": "binary.read_npz",
    ".xlsx": "binary.read_excel",
    ".mcap": "binary.read_mcap",
}
#: What the name of a log may end in.
LOG_ENDINGS = tuple(_READERS)
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


@typed
def load_log(
    path: str | PathLike[str],
    columns: LogColumns | None = None,
    *,
    motion: Motion | None = None,
    axis: str | None = None,
    axes: Sequence[str] | None = None,
) -> Trajectory | Trajectories:
    """Read one log of one axis, or of several where their columns are given with commas.

    ``axes`` are names of several; the other arguments and errors are those of `load_trajectory`.
    """
    found = (columns or LogColumns()).by_axis(axes)
    if len(found) == 1:
        return load_trajectory(path, found[0], motion=motion, axis=axis)
    names = [str(each.axis) for each in found]
    several: list[Trajectory] = []
    for place, each in enumerate(found):
        try:
            several.append(load_trajectory(path, each, motion=motion, may_stand=True))
        except InvalidInputError as error:
            error.advise(say_gains_by_axis(error.remedy, names, place))
            if isinstance(error, QuestionError):
                error.place = place
            raise
    return Trajectories(axes=tuple(several))


@typed
def load_trajectory(
    path: str | PathLike[str],
    columns: LogColumns | None = None,
    *,
    motion: Motion | None = None,
    axis: str | None = None,
    may_stand: bool = False,
) -> Trajectory:
    """Read one log.

    Args:
        path: a .csv, .txt or .tsv file with a header, a .parquet file, a .mat file up to version
            7.2, a .npz file of numpy.savez, a .xlsx workbook or a .mcap bag of ROS 2.
        columns: names and gains; None means LogColumns().
        motion: "linear" (N, m) or "rotary" (N·m, rad); None leaves it to the hardware.
        axis: name of the axis; None takes ``columns.axis``, then "x".
        may_stand: whether the axis may stand still, beside others that are driven.

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
    found, copies = _without_copies(found)
    trajectory = Trajectory(
        time=found["time"],
        force=found["force"],
        position=found["position"],
        reference=found.get("reference"),
        axis=axis or columns.axis or "x",
        motion=motion,
        stated_units=stated,
        read_as=", ".join((*reading.notes, *notes, *copies)),
        source=printable(path.name),
        digest=digest,
        may_stand=may_stand,
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
        return partial(read_isolated, _READERS[ending])
    return resolve_name(f"{__name__}.{_READERS[ending]}")


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


def _without_copies(found: dict[str, FloatArray]) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Columns without rows that were written twice, stamp and all, and what to say of them."""
    again = np.append(False, np.all([np.diff(column) == 0 for column in found.values()], axis=0))
    if not again.any() or not np.all(np.diff(found["time"][~again]) > 0):
        return found, ()
    kept = {role: column[~again] for role, column in found.items()}
    return kept, (f"{counted(np.count_nonzero(again), 'row')} written twice left out",)


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
    finding = refusal(
        "force-unit",
        seen=f"in {trajectory.source} column '{column}' steps by {step:.4g} in the median, no step "
        f"in seconds of a control loop{guess}",
        needed=f"{_SHORTEST_STEP:g} to {_LONGEST_STEP:g} s",
        remedy=f"{remedy}, or name the right column with --time.",
    )
    raise LogRefusedError((finding.of(trajectory.source),))


#: s of the processor, and those for each byte of a larger file: a workbook of a million rows takes
#: two thirds of that.
_SECONDS, _SECONDS_A_BYTE = 8, 1.5e-6
#: s by the clock for each of the processor: others may be at work beside.
_PATIENCE = 2 if sys.platform == "win32" else 15
#: The signal to a process whose time is up, negative; no code of an exit where there is none.
_OVERTIME = -getattr(signal, "SIGXCPU", 1)
#: Bytes of memory, and those for each byte of the file: a table of packed numbers unfolds.
_MEMORY, _MEMORY_A_BYTE = 800_000_000, 8
#: Each thread of a library takes memory before it does anything.
_FEW_THREADS = {"POLARS_MAX_THREADS": "2", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
#: As Python calls it, so that whoever embeds an interpreter states its program in one place.
_PROGRAM = "import sys; sys.path[:] = {path!r}; from {module} import serve; serve()"
_REMEDY = "Save it again, or export it as CSV, which needs no such reader"


def read_isolated(reader: str, path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role, read by MODULE.FUNCTION in another process. Raises InvalidInputError."""
    seconds = max(_SECONDS, round(_SECONDS_A_BYTE * len(content)))
    memory = _MEMORY + _MEMORY_A_BYTE * len(content)
    job: dict[str, Any] = {"reader": reader, "path": os.fspath(path), "columns": asdict(columns)}
    job |= {"seconds": seconds, "memory": memory}
    python = os.fsdecode(get_executable() or sys.executable)
    program = _PROGRAM.format(path=sys.path, module=__name__)
    try:
        done = subprocess.run(  # noqa: S603 - this interpreter, and nothing of the file in it
            [python, "-c", program, json.dumps(job)],
            input=content,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | _FEW_THREADS,
            timeout=_PATIENCE * seconds,
            check=False,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        code, (header, _, numbers) = done.returncode, done.stdout.partition(b"\n")
    except subprocess.TimeoutExpired:
        code, header, numbers = _OVERTIME, b"", b""
    except OSError as error:
        problem = f"cannot be read: no process for its reader ({error.strerror or error})"
        raise InvalidInputError(path, problem, _REMEDY) from None
    if code or not header:
        ended = f"ended the process that read it (exit {code}): it is damaged, or too big"
        late = f"takes longer to read than the {seconds} s that a file of its size may"
        raise InvalidInputError(path, late if code == _OVERTIME else ended, _REMEDY)
    said: dict[str, Any] = json.loads(header)
    if "problem" in said:
        if "question" in said:
            raise QuestionError(path, **said)
        raise InvalidInputError(path, **said)
    rows: dict[str, int] = said.pop("rows")
    found = np.split(np.frombuffer(numbers), np.cumsum(list(rows.values()))[:-1])
    values: dict[str, FloatArray] = dict(zip(rows, found, strict=True))
    return Reading(values=values, notes=tuple(said.pop("notes")), **said)


def serve() -> None:
    """Read what stands on standard input; put out a line of JSON, and the columns behind it."""
    job = json.loads(sys.argv[1])
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what libraries print is for nobody
        _limit(job["seconds"], job["memory"])
        read = resolve_name(f"{__name__}.{job['reader']}")
        columns = LogColumns(**job["columns"])
        try:
            reading: Reading = read(Path(job["path"]), sys.stdin.buffer.read(), columns)
        except InvalidInputError as error:
            said: dict[str, object] = {"problem": error.problem, "remedy": error.remedy}
            if isinstance(error, QuestionError):
                said |= {name: getattr(error, name) for name in ("question", "option", "choices")}
            out.write(json.dumps(said).encode() + b"\n")
            return
        rows = {role: column.size for role, column in reading.values.items()}
        header = {"names": reading.names, "notes": reading.notes, "rows": rows}
        header |= {"in_seconds": reading.in_seconds}
        out.write(json.dumps(header).encode() + b"\n")
        for column in reading.values.values():
            out.write(np.ascontiguousarray(column, np.float64).data)


def _limit(seconds: int, memory: int) -> None:
    """Limit this process, and leave no dump of it behind, as far as the system can."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
