"""Parquet, NPZ and MAT logs, clocks that are not in seconds, and files larger than they look."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from contextlib import suppress
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import scipy.io

from identification import InvalidInputError, LogColumns, LogRefusedError, load_trajectory
from identification.readers.columns import MOST_SAMPLES

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


def refusal(path: Path, columns: LogColumns | None = None) -> str:
    with pytest.raises(InvalidInputError) as caught:
        load_trajectory(path, columns)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 600
    return text


@pytest.mark.parametrize("write", WRITERS)
def test_every_kind_reads_the_same_numbers(tmp_path: Path, write: Writer) -> None:
    columns = LogColumns(position="q", reference="r", force_gain=-2.0, position_gain=1e-3)
    log = load_trajectory(write(tmp_path, q=POSITION, r=POSITION + 1), columns, axis="y")
    np.testing.assert_array_equal(log.time, TIME)
    np.testing.assert_array_equal(log.force, -2.0 * FORCE)
    np.testing.assert_array_equal(log.position, 1e-3 * POSITION)
    assert log.reference is not None
    np.testing.assert_array_equal(log.reference, 1e-3 * (POSITION + 1))
    assert log.axis == "y"


@pytest.mark.parametrize(("write", "unasked"), [(parquet, True), (csv, True), (npz, False)])
def test_a_reference_is_taken_unasked_from_tables_only(
    tmp_path: Path, write: Writer, unasked: bool
) -> None:
    log = load_trajectory(write(tmp_path, reference=POSITION))
    assert (log.reference is not None) is unasked


@pytest.mark.parametrize("write", WRITERS)
def test_missing_columns_say_the_same(tmp_path: Path, write: Writer) -> None:
    text = refusal(write(tmp_path), LogColumns(force="current"))
    assert "has no column 'current'; it has: time, force, position" in text
    assert "--force" in text


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


def test_a_missing_moment_is_a_missing_value(tmp_path: Path) -> None:
    stamps = np.arange(ROWS).astype("datetime64[ms]")
    stamps[5] = np.datetime64("NaT")
    for path in (npz(tmp_path, time=stamps), parquet(tmp_path, time=stamps)):
        with pytest.raises(LogRefusedError, match=r"1 of 300 values of time.*sample 5"):
            load_trajectory(path)


def test_decimals_are_numbers(tmp_path: Path) -> None:
    exact = pl.Series(np.rint(FORCE * 1000).tolist()).cast(pl.Decimal(12, 3)) / 1000
    log = load_trajectory(parquet(tmp_path, force=exact.cast(pl.Decimal(12, 3))))
    np.testing.assert_allclose(log.force, np.round(FORCE, 3), atol=1e-12)


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


def test_a_pickle_is_never_opened(tmp_path: Path) -> None:
    """The object would write a file if it were unpickled."""
    mark = tmp_path / "opened"

    class Trap:
        def __reduce__(self) -> Any:
            return (Path.touch, (mark,))

    path = npz(tmp_path, force=np.array([Trap()] * ROWS, dtype=object))
    assert "pickled" in refusal(path)
    assert not mark.exists()


def _archive(path: Path, members: list[tuple[str, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


def _header(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": kind, "fortran_order": False, "shape": shape}
    )
    return stream.getvalue()


def _column(values: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("force", "part"),
    [
        (_header((10**12,)), "claims 1000000000000 samples"),
        (_header((10**6, 10**6)), "claims 1000000000000 samples"),
        (_header((MOST_SAMPLES + 1,)), "more than the 20000000"),
        (_header((ROWS,)), "not a readable NumPy archive"),
        (_header((ROWS,)) + bytes(80), "not a readable NumPy archive"),
        (b"\x93NUMPY\x03\x00" + bytes(50), "format 3.0"),
        (b"\x93NUMPY\x01\x00\xff\xff" + b"{" * 70_000, "not a readable NumPy archive"),
        (b"not an array", "not a readable NumPy archive"),
        (b"", "not a readable NumPy archive"),
    ],
)
def test_archives_that_claim_more_than_they_hold(tmp_path: Path, force: bytes, part: str) -> None:
    whole = [("time.npy", _column(TIME)), ("position.npy", _column(POSITION))]
    assert part in refusal(_archive(tmp_path / "log.npz", [*whole, ("force.npy", force)]))


def test_what_is_packed_behind_an_array_is_not_unpacked(tmp_path: Path) -> None:
    """A gigabyte of zeros in a megabyte, behind 300 honest samples."""
    import tracemalloc

    path = tmp_path / "log.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("time.npy", _column(TIME))
        archive.writestr("position.npy", _column(POSITION))
        with archive.open("force.npy", "w", force_zip64=True) as member:
            member.write(_column(FORCE))
            for _ in range(250):
                member.write(bytes(1_000_000))
    tracemalloc.start()
    try:
        np.testing.assert_array_equal(load_trajectory(path).force, FORCE)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_two_arrays_of_one_name(tmp_path: Path) -> None:
    members = [(f"{name}.npy", _column(values)) for name, values in GOOD.items()]
    path = _archive(tmp_path / "log.npz", [*members, ("force.npy", _column(FORCE))])
    assert "two arrays named 'force'" in refusal(path)


def test_a_table_of_too_many_rows_is_refused_unread(tmp_path: Path) -> None:
    """Run lengths make thirty million rows a few kilobytes."""
    path = tmp_path / "log.parquet"
    rows = pl.select(pl.repeat(1, MOST_SAMPLES + 1, dtype=pl.Int8).alias("time")).with_columns(
        force=pl.col("time"), position=pl.col("time")
    )
    rows.write_parquet(path)
    assert path.stat().st_size < 1_000_000
    assert "more than the 20000000" in refusal(path)


def test_a_variable_of_too_many_samples_is_refused_unread(tmp_path: Path) -> None:
    whole = mat(tmp_path)
    scipy.io.savemat(whole, GOOD)
    content = whole.read_bytes()
    # The shape of the first variable, (1, 300) as two int32, made (70000, 70000).
    shape = np.array([1, ROWS], dtype="<i4").tobytes()
    assert shape in content
    huge = np.array([70_000, 70_000], dtype="<i4").tobytes()
    whole.write_bytes(content.replace(shape, huge, 1))
    assert "claims 4900000000 samples" in refusal(whole)


@pytest.mark.parametrize("write", [parquet, npz])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.9, 0.999])
def test_torn_files(tmp_path: Path, write: Writer, share: float) -> None:
    path = write(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refusal(path)


@pytest.mark.parametrize("seed", range(20))
def test_damaged_archives_never_show_a_traceback(tmp_path: Path, seed: int) -> None:
    path = npz(tmp_path)
    whole = bytearray(path.read_bytes())
    generator = np.random.default_rng(seed)
    for place in generator.integers(0, len(whole), 4):
        whole[place] ^= int(generator.integers(1, 256))
    path.write_bytes(bytes(whole))
    with suppress(InvalidInputError, LogRefusedError):
        load_trajectory(path)


@pytest.mark.parametrize("name", ["log.parquet", "log.npz", "log.mat"])
def test_text_under_another_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("time,force,position\n" + "0,0,0\n" * 300, encoding="utf-8")
    assert "not a readable" in refusal(path)


@pytest.mark.parametrize(
    ("tick", "unit"),
    [
        (1, "as milliseconds it would be 0.001 s"),
        (10, "as milliseconds it would be 0.01 s"),
        (1_000, "as microseconds it would be 0.001 s"),
        (1_000_000, "as nanoseconds it would be 0.001 s"),
    ],
)
@pytest.mark.parametrize("write", WRITERS)
def test_stamps_in_other_units_are_told_by_their_step(
    tmp_path: Path, write: Writer, tick: int, unit: str
) -> None:
    text = refusal(write(tmp_path, time=np.arange(ROWS) * tick))
    assert f"'time' steps by {tick:.4g} in the median" in text
    assert unit in text
    assert ("count rows" in text) is (tick == 1)


def test_impossibly_fast_and_slow_clocks(tmp_path: Path) -> None:
    assert "1e-07 to 0.1 s" in refusal(csv(tmp_path, time=TIME * 1e-6))
    assert "steps by 1e+10" in refusal(csv(tmp_path, time=TIME * 1e13))
    assert load_trajectory(csv(tmp_path, time=TIME * 99)).sample_time == pytest.approx(0.099)
    assert load_trajectory(csv(tmp_path, time=TIME * 2e-4)).sample_time == pytest.approx(2e-7)


def test_folders_and_devices_are_no_logs(tmp_path: Path) -> None:
    (tmp_path / "endless.csv").symlink_to("/dev/zero")
    assert "a folder or a device" in refusal(tmp_path / "endless.csv")


def test_a_file_too_large_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    with path.open("wb") as stream:
        stream.truncate(3_000_000_000)
    assert "3000000000 bytes" in refusal(path)
