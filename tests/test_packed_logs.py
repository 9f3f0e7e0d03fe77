"""Parquet, NPZ and MAT logs, and clocks that are not in seconds."""

from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from identification import LogColumns, LogRefusedError, load_trajectory
from tests.packed_logs import (
    FORCE,
    POSITION,
    ROWS,
    TIME,
    WRITERS,
    Writer,
    csv,
    mat,
    npz,
    parquet,
    refusal,
)

pytestmark = pytest.mark.usefixtures("read_here")


@pytest.mark.parametrize("write", WRITERS)
def test_every_kind_reads_the_same_numbers(
    tmp_path: Path, write: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    columns = LogColumns(
        position="q", reference="r", axis="elbow", force_gain=-2.0, position_gain=1e-3
    )
    path = write(tmp_path, q=POSITION, r=POSITION + 1)
    log = load_trajectory(path, columns, motion="rotary")
    np.testing.assert_array_equal(log.time, TIME)
    np.testing.assert_array_equal(log.force, -2.0 * FORCE)
    np.testing.assert_array_equal(log.position, 1e-3 * POSITION)
    assert log.reference is not None
    np.testing.assert_array_equal(log.reference, 1e-3 * (POSITION + 1))
    assert (log.axis, log.motion) == ("elbow", "rotary")
    assert load_trajectory(path, columns, axis="knee").axis == "knee"


@pytest.mark.parametrize(("write", "unasked"), [(parquet, True), (csv, True), (npz, False)])
def test_a_reference_is_taken_unasked_from_tables_only(
    tmp_path: Path, write: Writer, unasked: bool
) -> None:
    log = load_trajectory(write(tmp_path, reference=POSITION))
    assert (log.reference is not None) is unasked


@pytest.mark.parametrize("write", WRITERS)
def test_missing_columns_say_the_same(
    tmp_path: Path, write: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    text = refusal(write(tmp_path), LogColumns(time="when", force="current"))
    assert "has no column 'when', 'current'; it has: time, force, position" in text
    assert ("--time" in text, "--force" in text, "--position" in text) == (True, True, False)


@pytest.mark.parametrize("write", [parquet, npz, mat])
def test_counts_are_integers_and_numbers(tmp_path: Path, write: Writer) -> None:
    counts = np.rint(POSITION * 1e6).astype(np.int32)
    single = FORCE.astype(np.float32)
    log = load_trajectory(
        write(tmp_path, position=counts, force=single), LogColumns(position_gain=1e-6)
    )
    np.testing.assert_array_equal(log.position, counts * 1e-6)
    np.testing.assert_array_equal(log.force, single.astype(float))


@pytest.mark.parametrize(("write", "empty"), [(parquet, None), (npz, np.nan), (parquet, np.nan)])
def test_missing_values_are_refused_with_their_place(
    tmp_path: Path, write: Writer, empty: float | None
) -> None:
    force: list[float | None] = FORCE.tolist()
    force[7] = empty
    with pytest.raises(LogRefusedError, match="sample 7"):
        load_trajectory(write(tmp_path, force=force))


@pytest.mark.parametrize("role", ["time", "force"])
def test_a_column_of_words_is_refused_with_what_to_store(tmp_path: Path, role: str) -> None:
    told = refusal(parquet(tmp_path, **{role: ["one"] * len(TIME)}))
    assert f"column '{role}' is of type String, no real numbers" in told
    assert ("one number in each row, in seconds" in told) == (role == "time")


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("kind", ["Datetime", "Duration"])
def test_moments_carry_their_unit(tmp_path: Path, unit: str, kind: str) -> None:
    ticks = np.arange(ROWS) * {"ms": 1, "us": 1_000, "ns": 1_000_000}[unit]
    typed = getattr(pl, kind)
    # Half a century in nanoseconds: as float64 its steps would be wrong by 1e-4 of a millisecond.
    start = {"ms": 10**12, "us": 10**15, "ns": 10**18}[unit] if kind == "Datetime" else 0
    moments = pl.Series((ticks + start).tolist(), dtype=pl.Int64).cast(typed(unit))
    np.testing.assert_allclose(
        load_trajectory(parquet(tmp_path, time=moments)).time, TIME, rtol=1e-15
    )
    code = "datetime64" if kind == "Datetime" else "timedelta64"
    stamps = (ticks + start).astype(f"{code}[{unit}]")
    np.testing.assert_allclose(load_trajectory(npz(tmp_path, time=stamps)).time, TIME, rtol=1e-15)


@pytest.mark.parametrize(
    ("column", "values", "kind"),
    [
        ("force", ["1.5"] * ROWS, "String"),
        ("force", [date(2024, 1, 1)] * ROWS, "Date"),
        ("time", [date(2024, 1, 1)] * ROWS, "Date"),
        ("position", [datetime(2024, 1, 1)] * ROWS, "Datetime"),
        ("position", [timedelta(seconds=1)] * ROWS, "Duration"),
        ("force", [[1.0, 2.0]] * ROWS, "List"),
        ("force", [{"x": 1.0}] * ROWS, "Struct"),
        ("force", [b"x"] * ROWS, "Binary"),
        ("force", [None] * ROWS, "Null"),
        ("force", [True] * ROWS, "Boolean"),
    ],
)
def test_other_parquet_types_are_refused_by_name(
    tmp_path: Path, column: str, values: list[Any], kind: str
) -> None:
    text = refusal(parquet(tmp_path, **{column: values}))
    assert f"column '{column}' is of type {kind}" in text


@pytest.mark.parametrize(
    ("write", "value", "part"),
    [
        (npz, np.ones((ROWS, 2)), "300 x 2, not a single column"),
        (npz, np.float64(1.0), "a single number"),
        (npz, np.ones(ROWS) * 1j, "complex128, not of real numbers"),
        (npz, np.array(["1"] * ROWS), "not of real numbers"),
        (npz, np.array([1.0, "a"] * (ROWS // 2), dtype=object), "pickled Python objects"),
        (npz, np.zeros(ROWS, dtype=[("a", float)]), "not of real numbers"),
        (npz, np.arange(ROWS).astype("datetime64[s]"), "datetime64[s], not of real numbers"),
        (npz, np.ones(ROWS, dtype=bool), "bool, not of real numbers"),
        (npz, np.ones(ROWS - 1), "different lengths"),
        (mat, np.ones(ROWS, dtype=bool), "real numbers"),
        (mat, np.array([1.0, "a"], dtype=object), "real numbers"),
    ],
)
def test_arrays_that_are_no_columns(tmp_path: Path, write: Writer, value: Any, part: str) -> None:
    assert part in refusal(write(tmp_path, force=value))


def test_a_struct_of_columns_is_refused_with_what_saves_them(tmp_path: Path) -> None:
    columns: Any = {"force": {"measured": np.ones(ROWS)}, "time": 1.0, "position": 1.0}
    text = refusal(mat(tmp_path, **columns))
    assert text.endswith("Save its fields: save('log.mat', '-struct', 'force', '-v7')")


def test_a_pickle_is_never_opened(tmp_path: Path) -> None:
    """The object would write a file if it were unpickled."""
    mark = tmp_path / "opened"

    class Trap:
        def __reduce__(self) -> Any:
            return (Path.touch, (mark,))

    path = npz(tmp_path, force=np.array([Trap()] * ROWS, dtype=object))
    assert "pickled" in refusal(path)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("tick", "unit"),
    [
        (1, "as milliseconds it would be 0.001 s"),
        (10, "as milliseconds it would be 0.01 s"),
        (1_000, "as microseconds it would be 0.001 s"),
        (1_000_000, "as nanoseconds it would be 0.001 s"),
    ],
)
@pytest.mark.parametrize("write", [csv, parquet])
def test_stamps_in_other_units_are_told_by_their_step(
    tmp_path: Path, write: Writer, tick: int, unit: str
) -> None:
    path = write(tmp_path, time=np.arange(ROWS) * tick)
    text = refusal(path, kind=LogRefusedError)
    assert f"'time' steps by {tick:.4g} in the median" in text
    assert unit in text
    # The gain it names is the one that mends it.
    gain = float(text.rpartition("--time-gain ")[2].partition(")")[0])
    mended = load_trajectory(path, LogColumns(time_gain=gain))
    assert mended.sample_time == pytest.approx(tick * gain)
    assert f"it would be {mended.sample_time:.4g} s" in text
    assert ("count rows" in text) is (tick == 1)


def test_impossibly_fast_and_slow_clocks(tmp_path: Path) -> None:
    fast = refusal(csv(tmp_path, time=TIME * 1e-6), kind=LogRefusedError)
    assert "1e-07 to 0.1 s" in fast
    assert "steps by 1e+10" in refusal(csv(tmp_path, time=TIME * 1e13), kind=LogRefusedError)
    assert load_trajectory(csv(tmp_path, time=TIME * 99)).sample_time == pytest.approx(0.099)
    assert load_trajectory(csv(tmp_path, time=TIME * 2e-4)).sample_time == pytest.approx(2e-7)
