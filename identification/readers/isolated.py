"""Foreign parsers in a process of their own, with a deadline and a limit of memory.

A library that reads a damaged or hostile file may end the process by a signal, print, run on or
take all memory: here each of that is a sentence. The system limits memory on Linux, processor time
where it is POSIX; the deadline by the clock holds everywhere.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict
from importlib import import_module
from multiprocessing.spawn import get_executable
from pathlib import Path
from typing import Any

import numpy as np

from identification.errors import InvalidInputError, QuestionError
from identification.readers.columns import FloatArray, LogColumns, Reading

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
    """Columns by role, read by a function of this package (MODULE.FUNCTION) in another process.

    Raises:
        InvalidInputError: as the function does; or it ended by a signal, took too long or too much
            memory.
    """
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
        module, _, function = job["reader"].partition(".")
        read = getattr(import_module(f"{__package__}.{module}"), function)
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
