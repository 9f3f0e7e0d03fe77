"""Archives that claim more than they hold, torn and damaged files, files of another kind."""

from __future__ import annotations

import io
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from identification import InvalidInputError, LogRefusedError, load_trajectory
from tests.packed_logs import FORCE, POSITION, ROWS, TIME, Writer, npz, parquet, refusal


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
        (_header((20_000_000 + 1,)), "more than the 20000000"),
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


def test_a_table_of_too_many_rows_is_refused_unread(tmp_path: Path) -> None:
    """Run lengths make thirty million rows a few kilobytes."""
    path = tmp_path / "log.parquet"
    rows = pl.select(pl.repeat(1, 20_000_000 + 1, dtype=pl.Int8).alias("time")).with_columns(
        force=pl.col("time"), position=pl.col("time")
    )
    rows.write_parquet(path)
    assert path.stat().st_size < 1_000_000
    assert "more than the 20000000" in refusal(path)


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


def test_folders_and_devices_are_no_logs(tmp_path: Path) -> None:
    (tmp_path / "endless.csv").symlink_to("/dev/zero")
    assert "a folder or a device" in refusal(tmp_path / "endless.csv")


def test_a_file_too_large_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    with path.open("wb") as stream:
        stream.truncate(3_000_000_000)
    assert "3000000000 bytes" in refusal(path)
