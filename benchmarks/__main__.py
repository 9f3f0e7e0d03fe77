"""Run all benchmarks, print one table, write benchmarks/results.json."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path

# One thread: what is measured is the algorithm, not the number of cores.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"


def main() -> None:
    """Collect the rows of every module, show them and store them."""
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from benchmarks import (
        identification_rows,
        reading_rows,
        speed_rows,
        stability_rows,
        tuning_rows,
    )

    table = Table(title="haptune benchmarks, one thread")
    for heading in ("what", "time", "error", "against"):
        table.add_column(heading)
    rows: list[dict[str, object]] = []
    modules = (stability_rows, identification_rows, speed_rows, reading_rows, tuning_rows)
    for module in modules:
        for row in module.rows():
            rows.append(row.as_json())
            table.add_row(row.what, row.time_text(), row.error, row.against)
    Console(width=150).print(table)
    result = {
        "schema": "haptune/benchmarks/1",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": platform.machine(),
        "rows": rows,
    }
    target = Path(__file__).parent / "results.json"
    target.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(f"{target} written")


main()
