"""Reading a log of a million rows: time, and memory beyond what Python and libraries take."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.long_log import long_log
from benchmarks.row import Row

_ROWS = 1_000_000
#: Runs in a process of its own, because memory once taken is not given back. The peak is Linux's.
_MEASURE = """
import sys, time
from pathlib import Path
import numpy, polars, scipy.io
from identification import load_trajectory

def peak():
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0)

before, took = peak(), []
for _ in range(3):
    start = time.perf_counter()
    log = load_trajectory(sys.argv[1])
    took.append(time.perf_counter() - start)
    most = peak() if len(took) == 1 else most
print(min(took), most - before, len(log))
"""


def rows() -> Iterator[Row]:
    """One row a kind of file."""
    import polars as pl
    import scipy.io

    log = long_log(_ROWS)
    table = dict(log.columns())
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"log.{kind}" for kind in ("csv", "parquet", "npz", "mat")]
        pl.DataFrame(table).write_csv(paths[0])
        pl.DataFrame(table).write_parquet(paths[1])
        np.savez(paths[2], time=log.time, force=log.force, position=log.position)
        scipy.io.savemat(paths[3], table, do_compression=True)
        for path in paths:
            command = [sys.executable, "-c", _MEASURE, str(path)]
            text = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603
            seconds, kilobytes, samples = (float(word) for word in text.split())
            yield Row(
                what=f"read {samples:.0f} rows of {path.suffix}",
                seconds=seconds,
                error=f"peak {kilobytes / 1024:.0f} MB, {kilobytes * 1024 / samples:.0f} bytes "
                "a row",
                against=f"{path.stat().st_size / 2**20:.0f} MB on disk",
            )
