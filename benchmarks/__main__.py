"""Run the benchmarks, print one table, write benchmarks/results.json.

``python -m benchmarks`` runs all of them, ``python -m benchmarks solver scene`` only those parts,
and then writes nothing.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from importlib import import_module
from pathlib import Path

# One thread: what is measured is the algorithm, not the number of cores.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

#: In the order of the table; each has ``rows`` in a module of the name with ``_rows``.
PARTS = (
    "stability",
    "identification",
    "servo",
    "speed",
    "reading",
    "tuning",
    "solver",
    "scene",
)


def main() -> None:
    """Collect the rows of every module, show them and store them."""
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    chosen = sys.argv[1:] or PARTS
    unknown = [part for part in chosen if part not in PARTS]
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no such part, choose from {', '.join(PARTS)}")
    table = Table(title=f"haptune benchmarks, one thread, {_machine()}")
    for heading in ("what", "time", "error", "against"):
        table.add_column(heading)
    rows: list[dict[str, object]] = []
    start = time.perf_counter()
    for part in chosen:
        for row in import_module(f"benchmarks.{part}_rows").rows():
            print(f"{time.perf_counter() - start:6.0f} s  {row.what}", file=sys.stderr, flush=True)
            rows.append(row.as_json())
            table.add_row(row.what, row.time_text(), row.error, row.against)
    Console(width=160).print(table)
    if tuple(chosen) != PARTS:
        return
    result = {
        "schema": "haptune/benchmarks/1",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": _machine(),
        "rows": rows,
    }
    target = Path(__file__).parent / "results.json"
    target.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(f"{target} written")


def _machine() -> str:
    """Processor, where the system tells it, architecture and number of cores."""
    about = Path("/proc/cpuinfo")
    lines = about.read_text(encoding="utf-8").splitlines() if about.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    name = names[0] if names else platform.processor() or "unnamed processor"
    return f"{name}, {platform.machine()}, {os.cpu_count()} cores"


if __name__ == "__main__":
    main()
