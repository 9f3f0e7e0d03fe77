"""Torn and damaged files, archives that claim or unfold to much, and files without end."""

import bz2
import gzip
import io
import lzma
import math
import os
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from io import BytesIO
from itertools import chain, combinations, repeat
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import polars as pl
import pytest

from identification import (
    InvalidInputError,
    LogColumns,
    LogRefusedError,
    load_mapping,
    load_trajectory,
)
from tests.packed_logs import (
    FORCE,
    POSITION,
    ROWS,
    TIME,
    Writer,
    bag_of,
    mat,
    npz,
    parquet,
    refusal,
)
from tests.test_log_workbooks import SHEET, Changes, stuffed
from tests.thinned import thinned
from tune import load_scene

_BOOK = "xl/workbook.xml"
_RELATIONS, _TYPES = "xl/_rels/workbook.xml.rels", "[Content_Types].xml"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_KIND = "application/vnd.openxmlformats-officedocument.spreadsheetml.worksheet+xml"
_SHEETS = 20_000


def _sheet(k: int) -> str:
    return f"xl/worksheets/s{k}.xml"


def _each(text: str, count: int = _SHEETS) -> Iterable[bytes]:
    """A text with every number in the place of its stars."""
    return (text.replace("*", str(k)).encode() for k in range(count))


def cell(folder: Path) -> Path:
    """One cell of 600 MB."""
    start, end = b'<row r="302"><c r="A302" t="inlineStr"><is><t>', b"</t></is></c></row>"
    text = repeat(b"x" * 1_000_000, 600)
    return stuffed(folder, {SHEET: (b"</sheetData>", chain([start], text, [end]))})


def sheets(folder: Path) -> Path:
    """Twenty thousand sheets."""
    listed = f'<sheet xmlns:r="{_OFFICE}" name="s*" sheetId="9*" r:id="x*"/>'
    related = f'<Relationship Id="x*" Type="{_OFFICE}/worksheet" Target="/{_sheet(0)}"/>'
    typed = f'<Override PartName="/{_sheet(0)}" ContentType="{_KIND}"/>'
    changes: Changes = {
        _BOOK: (b"</sheets>", _each(listed)),
        _RELATIONS: (b"</Relationships>", _each(related.replace("s0", "s*"))),
        _TYPES: (b"</Types>", _each(typed.replace("s0", "s*"))),
    }
    empty = f'<worksheet xmlns="{_MAIN}"><sheetData/></worksheet>'
    return stuffed(folder, changes, {_sheet(k): empty for k in range(_SHEETS)})


def elements(folder: Path) -> Path:
    """Messages of a million elements."""
    one = struct.pack("<Ixxxx", 1)
    return bag_of(
        folder, "string[] names\n", struct.pack("<I", 1_000_000) + one * 1_000_000, count=25
    )


BOMBS: dict[str, Callable[[Path], Path]] = {
    each.__name__: each for each in (cell, sheets, elements)
}


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


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("write", [parquet, npz, mat])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.999])
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


@pytest.mark.usefixtures("read_here")
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


#: Limits as documented: bytes of a YAML file, its keys and values, columns, letters of a header.
LARGEST_FILE, MOST_EVENTS, MOST_COLUMNS, LONGEST_HEADER = 1_000_000, 20_000, 10_000, 5_000_000
#: Elements of a scene, and sums of them.
MOST_ELEMENTS, MOST_SUMS = 200, 1013
TABLE = b"time,force,position\n" + b"0,0,0\n" * 300


def _zipped(content: bytes) -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("log.csv", content)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("kind", "pack"),
    [
        ("gzip", gzip.compress),
        ("zlib", zlib.compress),
        ("zlib", lambda content: zlib.compress(content, 1)),
        ("zlib", lambda content: zlib.compress(content, 3)),
        ("zlib", lambda content: zlib.compress(content, 9)),
        ("zstd", lambda content: b"\x28\xb5\x2f\xfd" + content),
        ("zip or spreadsheet", _zipped),
        ("xz", lzma.compress),
        ("bzip2", bz2.compress),
    ],
)
def test_packed_streams_are_not_unpacked(
    tmp_path: Path, kind: str, pack: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(pack(TABLE))
    assert f"is a packed file ({kind})" in refusal(path)


@pytest.mark.parametrize("before", [b"", b"\n\r\n", b"\xef\xbb\xbf\n"])
def test_wide_headers_are_not_parsed(tmp_path: Path, before: bytes) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(before + b"," * MOST_COLUMNS + b"\n" + TABLE)
    assert f"has {MOST_COLUMNS + 1} columns" in refusal(path)
    path.write_bytes(before + b"a" * LONGEST_HEADER + b"," + TABLE)
    assert "has a header line of 50000" in refusal(path)
    path.write_bytes(before + b'"time\n"' + b"," * MOST_COLUMNS + b"\n" + TABLE)
    assert "quote in its header line" in refusal(path)


#: Each as long as a file may be.
YAML = {"flat list": "1, ", "flow list": "[], ", "sexagesimal": "1:1:1, ", "words": "b, "}


@pytest.mark.parametrize("name", thinned(YAML, 1))
def test_lists_without_end(tmp_path: Path, name: str) -> None:
    path = tmp_path / "list.yaml"
    item = YAML[name]
    path.write_text(f"a: [{item * (LARGEST_FILE // len(item) - 2)}]", encoding="utf-8")
    assert f"holds more than {MOST_EVENTS} keys" in refusal(path, read=load_mapping)


@pytest.mark.skipif(sys.platform == "win32", reason="pipes have no names in folders there")
@pytest.mark.parametrize("name", ["scene.yaml", "log.csv"])
def test_a_pipe_nobody_writes_to(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    read = load_mapping if path.suffix == ".yaml" else load_trajectory
    assert "not a file" in refusal(path, read=read)


#: 2^10 - 1 - 10 = 1013 sums.
_GROUPS = [[f"e{k}" for k in range(10)]]


def _scene(elements: int, groups: Iterable[Sequence[str]]) -> str:
    listed = ", ".join(f"e{i}: {{damping: 1.0}}" for i in range(elements))
    together = ", ".join(f"[{', '.join(group)}]" for group in groups)
    return f"elements: {{{listed}}}\ntogether: [{together}]\n"


@pytest.mark.parametrize(
    ("elements", "groups", "told"),
    [
        (12, list(combinations([f"e{i}" for i in range(12)], 5)), "1573 sums"),
        (200, [[f"e{5 * i + k}" for k in range(5)] for i in range(40)], "1040 sums"),
        (500, [[f"e{5 * i + k}" for k in range(5)] for i in range(100)], "are 500 elements"),
        (MOST_ELEMENTS + 1, [], f"are {MOST_ELEMENTS + 1} elements"),
    ],
)
def test_scenes_without_end_are_told_before_work_begins(
    tmp_path: Path, elements: int, groups: list[Sequence[str]], told: str
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(_scene(elements, groups), encoding="utf-8")
    assert told in refusal(path, read=load_scene)


def test_the_largest_scene_is_no_offence(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(_scene(MOST_ELEMENTS, _GROUPS), encoding="utf-8")
    assert len(load_scene(path).combinations()) == MOST_ELEMENTS + MOST_SUMS


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
    # A cell holds sixteen digits.
    np.testing.assert_allclose(log.time, np.arange(1_000_000) * 1e-3, rtol=4e-16)
    assert _used()[1] < 1_000_000_000
