"""A file that unfolds to much ends within 10 s of the processor and 1 GB; a long log is read."""

from __future__ import annotations

import math
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest

from identification import InvalidInputError, LogColumns, LogRefusedError, load_trajectory
from tests.bombs import BOMBS
from tests.thinned import thinned

resource = pytest.importorskip("resource")
_UNIT = 1 if sys.platform == "darwin" else 1024


def _used() -> tuple[float, int]:
    """Processor time of all processes that ended, s, and the memory of the largest, bytes."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime, _UNIT * used.ru_maxrss


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit memory")
@pytest.mark.parametrize("name", thinned(BOMBS, 1))
def test_what_unfolds_ends_in_time(tmp_path: Path, name: str) -> None:
    """Most are refused; half a million names may be read, where that takes no longer."""
    path = BOMBS[name](tmp_path)
    fields: dict[str, Any] = {"position": "/axis/position", "force": "/axis/force"}
    asked = LogColumns(time="publish_time", **fields) if path.suffix == ".mcap" else None
    began, _ = _used()
    with suppress(InvalidInputError, LogRefusedError):
        load_trajectory(path, asked)
    ended, size = _used()
    assert ended - began < 10
    assert size < 1_000_000_000


@pytest.mark.long
def test_a_million_honest_rows_of_a_workbook_are_read(tmp_path: Path) -> None:
    path = tmp_path / "log.xlsx"
    book: Any = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("Log")
    sheet.append(("time", "force", "position"))
    for k in range(1_000_000):
        sheet.append((k * 1e-3, math.sin(0.04 * k), 0.01 * math.cos(0.04 * k)))
    book.save(path)
    log = load_trajectory(path)
    np.testing.assert_array_equal(log.time, np.arange(1_000_000) * 1e-3)
    assert _used()[1] < 1_000_000_000
