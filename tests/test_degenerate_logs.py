"""Logs that no motion of a device could be: an answer or a refusal, never an internal error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import LogRefusedError, Trajectory
from tests.commands import haptune
from tests.thinned import thinned

FloatArray = NDArray[np.float64]


def _pushed(rows: int = 400) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, force and position of 3 kg and 10 N·s/m at 1 kHz."""
    step = 1e-3
    time: FloatArray = np.arange(rows, dtype=np.float64) * step
    force: FloatArray = 5 * np.sign(np.sin(2 * np.pi * 3 * time)) + 2 * np.sin(
        2 * np.pi * 11 * time
    )
    speed, position = np.zeros(rows), np.zeros(rows)
    for row in range(rows - 1):
        speed[row + 1] = speed[row] + (force[row] - 10 * speed[row]) / 3 * step
        position[row + 1] = position[row] + speed[row + 1] * step
    counts = np.rint(position / 6e-6)
    return time, force, np.asarray(counts * 6e-6, dtype=np.float64)


def _doctor(folder: Path, time: FloatArray, force: FloatArray, position: FloatArray) -> int:
    path = folder / "log.npz"
    np.savez(path, time=time, force=force, position=position)
    ended = haptune("doctor", str(path))
    assert "internal error" not in ended.err
    return ended.code


@pytest.mark.parametrize(("rows", "span"), [(200, 0.059), (300, 0.01), (400, 1e-9)])
def test_a_log_shorter_than_the_windows_of_a_tremor_is_judged(
    tmp_path: Path, rows: int, span: float
) -> None:
    time, force, position = _pushed(rows)
    assert _doctor(tmp_path, time / time[-1] * span, force, position) in {0, 3, 4}


@pytest.mark.parametrize("sign", thinned([1.0, -1.0], 1))
def test_a_force_that_is_the_position_is_refused(tmp_path: Path, sign: float) -> None:
    """Least squares then finds next to no mass, and a rate b/m that no exponential holds."""
    time, _, position = _pushed(2000)
    assert _doctor(tmp_path, time, sign * position, position) == 4


@pytest.mark.parametrize("scale", [1e300, 1e150, 1e-150, 1e-310])
@pytest.mark.parametrize("column", ["time", "force", "position"])
def test_columns_out_of_all_proportion_end_in_a_sentence(
    tmp_path: Path, column: str, scale: float
) -> None:
    time, force, position = _pushed()
    columns = {"time": time, "force": force, "position": position}
    columns[column] = columns[column] * scale
    assert _doctor(tmp_path, **columns) in {0, 3, 4}


def test_a_position_that_rounds_to_minus_nothing_is_called_zero() -> None:
    time, force, _ = _pushed(200)
    with pytest.raises(LogRefusedError, match=r"position in trajectory is 0 in every row"):
        Trajectory(time=time, force=force, position=np.full(200, -0.0))
