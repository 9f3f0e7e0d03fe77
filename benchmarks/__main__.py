"""Measure run time against error, show it, write pages, compare with the last run.

``python -m benchmarks`` measures all parts and prints them; names of parts measure only those.
``--write docs/benchmarks`` writes pages, pictures, results.json and a line of history a part.
``--compare`` ends with exit code 1 where a ratio of times grew by more than half.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

# One thread: what is measured is the algorithm, not the number of cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

_KEPT = Path(__file__).parents[1] / "docs" / "benchmarks"


def main() -> None:
    """Measure the parts asked for."""
    from benchmarks.history import last_ratios, slower
    from benchmarks.sections import PARTS, measured

    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; all by default")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write pages there")
    parser.add_argument("--compare", action="store_true", help="with the last ratios kept")
    chosen = parser.parse_args()
    unknown = [part for part in chosen.parts if part not in PARTS]
    if unknown:
        parser.error(f"{', '.join(unknown)}: no such part, choose from {', '.join(PARTS)}")
    before = last_ratios(_KEPT / "history.jsonl")
    worse: list[str] = []
    for part in chosen.parts or PARTS:
        begun, started = _worked(), time.perf_counter()
        section = measured(part)
        seconds = _worked() - begun
        print(
            f"{part}: {seconds:.0f} s, {time.perf_counter() - started:.0f} s by the clock",
            file=sys.stderr,
        )
        _show(section, seconds)
        worse += slower(before, section.ratios)
        if chosen.write:
            write(section, chosen.write, seconds)
    if chosen.compare:
        for sentence in worse:
            print(sentence, file=sys.stderr)
        sys.exit(1 if worse else 0)


def _worked() -> float:
    """Time of the processor, children that ended included, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def write(section: Any, folder: Path, seconds: float) -> None:
    """Page, picture, numbers and history of a section; other sections stay."""
    from benchmarks.history import append
    from benchmarks.machine import machine, today, versions
    from benchmarks.page import index, page
    from benchmarks.picture import draw
    from benchmarks.sections import PARTS

    folder.mkdir(parents=True, exist_ok=True)
    about = {
        "title": section.title,
        "date": today(),
        "machine": machine(),
        "versions": versions(),
        "seconds": round(seconds, 1),
    }
    results = folder / "results.json"
    kept: dict[str, Any] = {"schema": "haptune/benchmarks/2", "parts": {}}
    if results.exists():
        kept = json.loads(results.read_text(encoding="utf-8"))
    kept["parts"][section.name] = {
        **about,
        "cells": [asdict(cell) for cell in section.cells],
        "rows": [asdict(row) for row in section.rows],
        "ratios": section.ratios,
    }
    results.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if section.cells:
        draw(section, folder / f"{section.name}.png")
    if section.shown:
        draw(section, folder / f"{section.name}-shown.png", list(section.shown))
    (folder / f"{section.name}.md").write_text(page(section, about), encoding="utf-8")
    (folder / "index.md").write_text(index(kept["parts"], PARTS), encoding="utf-8")
    if section.ratios:
        append(folder / "history.jsonl", today(), machine(), section.name, section.ratios)


def _show(section: Any, seconds: float) -> None:
    from rich.console import Console
    from rich.table import Table

    from benchmarks.section import time_words

    table = Table(title=f"{section.title} ({seconds:.0f} s)")
    for heading in ("what", "time", section.error if section.cells else "result", "note"):
        table.add_column(heading)
    for cell in section.cells:
        error = "–" if cell.error is None else f"{cell.error:.3g}"
        table.add_row(f"{cell.case}: {cell.method}", time_words(cell), error, cell.note)
    for row in section.rows:
        table.add_row(row.what, row.time_text(), row.error, row.against)
    Console(width=180).print(table)


if __name__ == "__main__":
    main()
