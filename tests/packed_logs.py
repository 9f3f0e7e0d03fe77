"""Small good logs in every packed kind, and what reading a bad one says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import scipy.io

from identification import InvalidInputError, LogColumns, load_trajectory

ROWS = 300
TIME = np.arange(ROWS) * 1e-3
FORCE = np.sin(40 * TIME)
POSITION = 0.01 * np.cos(40 * TIME)
GOOD: dict[str, Any] = {"time": TIME, "force": FORCE, "position": POSITION}


def parquet(folder: Path, **columns: Any) -> Path:
    path = folder / "log.parquet"
    pl.DataFrame(GOOD | columns).write_parquet(path)
    return path


def npz(folder: Path, **columns: Any) -> Path:
    path = folder / "log.npz"
    np.savez_compressed(path, **(GOOD | columns))
    return path


def mat(folder: Path, **columns: Any) -> Path:
    path = folder / "log.mat"
    scipy.io.savemat(path, GOOD | columns, do_compression=True)
    return path


def csv(folder: Path, **columns: Any) -> Path:
    path = folder / "log.csv"
    pl.DataFrame(GOOD | columns).write_csv(path)
    return path


WRITERS = (parquet, npz, mat, csv)
Writer = Callable[..., Path]


def refusal(
    path: Path,
    columns: LogColumns | None = None,
    kind: type[Exception] = InvalidInputError,
) -> str:
    with pytest.raises(kind) as caught:
        load_trajectory(path, columns)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 600
    return text
