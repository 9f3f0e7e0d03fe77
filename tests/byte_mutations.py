"""Logs and documents with one byte changed, each read in a process of its own.

As a program: ``python -m tests.byte_mutations FIRST LAST KIND...`` prints a line for each case that
goes wrong, and last a line of JSON: cases, faults, and the slowest and largest of them.

A process costs a fork: whatever a reader imports is imported before, and the process in which a
foreign parser works is a fork as well; all else of how it is started, limited and heard is the
reader's own.
"""

from __future__ import annotations

import gc
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from identification import (
    Hardware,
    InvalidInputError,
    LogColumns,
    LogRefusedError,
    load_device,
    load_document,
    load_trajectory,
)
from identification.readers import isolated

#: Samples of a log: few, so that a header is a good part of it.
_ROWS = 60
#: s of the processor and bytes that a case may take.
MOST_SECONDS = 10.0
MOST_BYTES = 1_000_000_000
#: Fields of a bag.
_FIELDS: dict[str, Any] = {"position": "/arm/joints/position[1]", "force": "/arm/joints/effort[1]"}
#: What readers import when they are used, by ending; what is not needed makes a fork slower.
_IMPORTED = {
    "xlsx": ("openpyxl", "identification.readers.excel"),
    "mcap": ("mcap.reader", "mcap_ros2.decoder", "identification.readers.bags"),
    "parquet": ("polars", "identification.readers.binary"),
    "mat": ("scipy.io", "identification.readers.binary"),
    "csv": ("polars", "identification.readers.text"),
    "npz": ("identification.readers.binary",),
    "yaml": ("ruamel.yaml", "identification.device.device", "tune.documents.scene"),
}


def _mat(kind: str) -> bytes:
    import scipy.io

    from tests.packed_logs import FORCE, GOOD

    variables = {name: column[:40] for name, column in GOOD.items()}
    if kind == "others":  # that are no columns, as a workspace holds them
        variables |= {"cells": np.array([1.0, "a"], dtype=object), "record": {"a": 1.0, "b": "x"}}
        variables |= {"words": "text", "complex": 1j * FORCE[:3], "flags": FORCE[:3] > 0}
    save: Any = scipy.io.savemat  # a stream is allowed, its stubs lack it
    stream = io.BytesIO()
    save(stream, variables, do_compression=kind == "packed", format="4" if kind == "old" else "5")
    return stream.getvalue()


def _packed(kind: str, folder: Path) -> bytes:
    from tests import packed_logs

    write: packed_logs.Writer = getattr(packed_logs, kind)
    short = {name: column[:_ROWS] for name, column in packed_logs.GOOD.items()}
    return write(folder, **(short if kind == "npz" else {})).read_bytes()


def _workbook(folder: Path) -> bytes:
    from tests.test_log_workbooks import HEADER, SAMPLES, workbook

    return workbook(folder, HEADER, *SAMPLES[:_ROWS]).read_bytes()


def _bag(folder: Path) -> bytes:
    from tests.test_log_bags import JOINTS, bag, joints

    return bag(folder, arm_joints=(JOINTS, joints, range(_ROWS))).read_bytes()


def _document(name: str) -> bytes:
    from tests.mutations import DOCUMENTS

    return DOCUMENTS[name].encode()


#: Kinds of file: ending, and what writes a good one, perhaps by way of a folder.
KINDS: dict[str, tuple[str, Callable[[Path], bytes]]] = {
    "mat": ("mat", lambda _: _mat("plain")),
    "mat packed": ("mat", lambda _: _mat("packed")),
    "mat level 4": ("mat", lambda _: _mat("old")),
    "mat others": ("mat", lambda _: _mat("others")),
    "csv": ("csv", lambda folder: _packed("csv", folder)),
    "npz": ("npz", lambda folder: _packed("npz", folder)),
    "parquet": ("parquet", lambda folder: _packed("parquet", folder)),
    "xlsx": ("xlsx", _workbook),
    "mcap": ("mcap", _bag),
    "device": ("yaml", lambda _: _document("device")),
    "hardware": ("yaml", lambda _: _document("hardware")),
    "scene": ("yaml", lambda _: _document("scene")),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How one case ended: what is wrong, "" if nothing is; s of the processor; bytes."""

    fault: str
    seconds: float
    size: int


def main() -> None:
    """Run the cases of some seeds as a program."""
    first, last = int(sys.argv[1]), int(sys.argv[2])
    found = {"cases": 0, "faults": 0, "seconds": 0.0, "bytes": 0}
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.object(isolated, "subprocess", _Forked),
    ):
        for kind in sys.argv[3:]:
            content = _good(kind, Path(folder))
            for name in _IMPORTED[KINDS[kind][0]]:
                import_module(name)
            gc.collect()
            gc.freeze()  # which leaves its memory to be shared
            for seed in range(first, last):
                ended = _case(kind, content, seed, Path(folder))
                found["cases"] += 1
                found["faults"] += bool(ended.fault)
                found["seconds"] = max(found["seconds"], ended.seconds)
                found["bytes"] = max(found["bytes"], ended.size)
                if ended.fault:
                    print(f"{kind} {seed}: {ended.fault}", flush=True)
    print(json.dumps(found), flush=True)


def _good(kind: str, folder: Path) -> bytes:
    """A good file, written by another process: what writes it may start threads."""
    path = folder / "good"
    if _fork(lambda: path.write_bytes(KINDS[kind][1](folder)), folder / "said")[0]:
        raise AssertionError(f"no good file of kind {kind}")
    return path.read_bytes()


def _case(kind: str, content: bytes, seed: int, folder: Path) -> Outcome:
    rng = np.random.default_rng((9, seed))
    changed = bytearray(content)
    changed[int(rng.integers(len(content)))] ^= int(rng.integers(1, 256))
    path = folder / f"log.{KINDS[kind][0]}"
    path.write_bytes(changed)
    said = folder / "said"
    code, seconds, size = _fork(lambda: _read(kind, path), said)
    words = said.read_text("utf-8", "replace")[:300]
    faults = (
        (code != 0, f"exit {code}"),
        (bool(words), f"printed {words}"),
        (seconds > MOST_SECONDS, f"took {seconds:.1f} s"),
        (size > MOST_BYTES, f"held {size} bytes"),
    )
    fault = ", ".join(text for wrong, text in faults if wrong)
    return Outcome(fault=fault, seconds=seconds, size=size)


def _read(kind: str, path: Path) -> None:
    try:
        if kind == "hardware":
            load_document(Hardware, path)
        elif kind == "device":
            load_device(path)
        elif kind == "scene":
            from tune import Scene

            load_document(Scene, path)
        else:
            load_trajectory(path, LogColumns(**_FIELDS) if kind == "mcap" else None)
    except (InvalidInputError, LogRefusedError) as refused:
        if not str(refused).replace("\n", "").isprintable():
            raise AssertionError(repr(refused)) from None


def _fork(work: Callable[[], object], said: Path) -> tuple[int, float, int]:
    """Exit code (minus the signal) of work in a process of its own, s of the processor, bytes."""
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            stream = os.open(said, os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
            os.dup2(stream, 1)
            os.dup2(stream, 2)
            work()
            code = 0
        except BaseException as error:  # noqa: BLE001 - what a user would see as a traceback
            os.write(2, f"{type(error).__name__}: {error}".encode())
        finally:
            os._exit(code)
    _, status, used = os.wait4(pid, 0)
    unit = 1 if sys.platform == "darwin" else 1024
    seconds = used.ru_utime + used.ru_stime
    return os.waitstatus_to_exitcode(status), seconds, unit * used.ru_maxrss


class _Forked:
    """What a reader uses of subprocess, with forks in the place of new interpreters."""

    PIPE, DEVNULL = subprocess.PIPE, subprocess.DEVNULL
    TimeoutExpired = subprocess.TimeoutExpired

    @staticmethod
    def run(command: list[str], **options: Any) -> subprocess.CompletedProcess[bytes]:
        with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as taken:
            given.write(options["input"])
            given.seek(0)
            pid = os.fork()
            if pid == 0:
                code = 1
                try:
                    os.dup2(given.fileno(), 0)
                    os.dup2(taken.fileno(), 1)
                    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
                    sys.argv = ["-c", command[-1]]
                    isolated.serve()
                    code = 0
                finally:
                    os._exit(code)
            code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
            taken.seek(0)
            return subprocess.CompletedProcess(command, code, taken.read())


if __name__ == "__main__":
    main()
