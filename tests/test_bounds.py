"""Files that would take minutes or gigabytes are refused before any are spent, in one sentence."""

from __future__ import annotations

import bz2
import gzip
import lzma
import os
import sys
import time
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from io import BytesIO
from itertools import combinations
from pathlib import Path

import pytest

from identification import InvalidInputError, load_mapping, load_trajectory
from tests.thinned import thinned
from tune import load_scene

#: Limits as documented: bytes of a YAML file, its keys and values, columns, letters of a header.
LARGEST_FILE, MOST_EVENTS, MOST_COLUMNS, LONGEST_HEADER = 1_000_000, 20_000, 10_000, 5_000_000
#: Elements of a scene, and sums of them.
MOST_ELEMENTS, MOST_SUMS = 200, 1000
TABLE = b"time,force,position\n" + b"0,0,0\n" * 300


def _refusal(read: Callable[[Path], object], path: Path) -> str:
    started = time.process_time()
    with pytest.raises(InvalidInputError) as caught:
        read(path)
    assert time.process_time() - started < 10
    text = str(caught.value)
    assert len(text) < 500
    return text


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
    assert f"is a packed file ({kind})" in _refusal(load_trajectory, path)


@pytest.mark.parametrize("before", [b"", b"\n\r\n", b"\xef\xbb\xbf\n"])
def test_wide_headers_are_not_parsed(tmp_path: Path, before: bytes) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(before + b"," * MOST_COLUMNS + b"\n" + TABLE)
    assert f"has {MOST_COLUMNS + 1} columns" in _refusal(load_trajectory, path)
    path.write_bytes(before + b"a" * LONGEST_HEADER + b"," + TABLE)
    assert "has a header line of 50000" in _refusal(load_trajectory, path)
    path.write_bytes(before + b'"time\n"' + b"," * MOST_COLUMNS + b"\n" + TABLE)
    assert "quote in its header line" in _refusal(load_trajectory, path)


#: Each as long as a file may be.
YAML = {
    "flat list": "1, ",
    "flow list": "[], ",
    "sexagesimal": "1:1:1, ",
    "words": "b, ",
}


@pytest.mark.parametrize("name", thinned(YAML, 1))
def test_lists_without_end(tmp_path: Path, name: str) -> None:
    path = tmp_path / "list.yaml"
    item = YAML[name]
    path.write_text(f"a: [{item * (LARGEST_FILE // len(item) - 2)}]", encoding="utf-8")
    assert f"holds more than {MOST_EVENTS} keys" in _refusal(load_mapping, path)


@pytest.mark.skipif(sys.platform == "win32", reason="pipes have no names in folders there")
@pytest.mark.parametrize("name", ["scene.yaml", "log.csv"])
def test_a_pipe_nobody_writes_to(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    read = load_mapping if path.suffix == ".yaml" else load_trajectory
    assert "not a file" in _refusal(read, path)


#: 38 · 26 + 3 · 4 = 1000 sums.
_GROUPS = [
    *([f"e{5 * i + k}" for k in range(5)] for i in range(38)),
    *([f"e{190 + 3 * i + k}" for k in range(3)] for i in range(3)),
]


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
    assert told in _refusal(load_scene, path)


def test_the_largest_scene_is_no_offence(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(_scene(MOST_ELEMENTS, _GROUPS), encoding="utf-8")
    assert len(load_scene(path).subsets()) == MOST_ELEMENTS + MOST_SUMS
