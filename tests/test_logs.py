"""Log files: what is read, and a sentence for everything that is not."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification import InvalidInputError, LogColumns, LogRefusedError, load_trajectory
from tests.packed_logs import FORCE, POSITION, ROWS, TIME, csv, mat
from tests.plain_table import load


def text(folder: Path) -> str:
    """A good log."""
    return csv(folder).read_text(encoding="utf-8")


def test_reads_csv_exactly_and_digests_the_file(tmp_path: Path) -> None:
    path = csv(tmp_path)
    log = load_trajectory(path)
    np.testing.assert_array_equal(log.time, TIME)
    np.testing.assert_array_equal(log.force, FORCE)
    np.testing.assert_array_equal(log.position, POSITION)
    assert log.reference is None
    assert (log.source, log.axis, log.motion) == ("log.csv", "x", None)
    assert log.digest == "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("name", ["time", '"time"'])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_numbers_are_read_to_the_last_bit(tmp_path: Path, name: str, end: str) -> None:
    """Every way to write one; a quote sends the file the longer way, through a table library."""
    ways = ["1", "+2", "-3.", ".5", "-.25", "1e-3", "6.02E+23", "4.9e-324", "0.1", "00012"]
    texts = [ways[k % len(ways)] if k % 2 else repr(np.pi * 10.0 ** -(k % 40)) for k in range(ROWS)]
    rows = [f"{k}e-3,{text},{1 / (k + 3)!r}" for k, text in enumerate(texts)]
    log = load(tmp_path, end.join([f"{name},force,position", *rows, ""]))
    np.testing.assert_array_equal(log.force, [float(text) for text in texts])
    np.testing.assert_array_equal(log.position, [1 / (k + 3) for k in range(ROWS)])


def test_rows_written_twice_are_left_out_where_that_mends_the_clock(tmp_path: Path) -> None:
    lines = text(tmp_path).splitlines(keepends=True)
    log = load(tmp_path, "".join([*lines[:5], lines[4], *lines[5:], lines[-1]]))
    np.testing.assert_array_equal(log.time, TIME)
    assert log.read_as == "2 rows written twice left out"
    with pytest.raises(LogRefusedError, match="does not increase at 2 of"):
        load(tmp_path, "".join([*lines[:5], *lines[3:5], *lines[4:]]))


def test_windows_line_ends_and_spaces(tmp_path: Path) -> None:
    spaced = text(tmp_path).replace(",", " , ").replace("\n", "\r\n")
    np.testing.assert_array_equal(load(tmp_path, spaced).force, FORCE)


@pytest.mark.parametrize("gain", [0.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["force_gain", "position_gain"])
def test_impossible_gains(name: str, gain: float) -> None:
    with pytest.raises(InvalidInputError, match="--" + name.replace("_", "-")):
        replace(LogColumns(), **{name: gain})


def test_a_hostile_header_is_quoted_short_and_printable(tmp_path: Path) -> None:
    header = ",".join("\x1b[31m" + "x" * 5000 + str(i) for i in range(500))
    with pytest.raises(InvalidInputError) as caught:
        load(tmp_path, header + "\n" + ",".join("1" for _ in range(500)))
    assert "\x1b" not in str(caught.value)
    assert "480 more" in str(caught.value)
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize("cell", ["abc", "1,5", "0x10", "1 2", "--", "1e"])
def test_cells_that_are_no_numbers_are_named_by_row(tmp_path: Path, cell: str) -> None:
    lines = text(tmp_path).replace(",", ";").splitlines()
    lines[10] = f"0.009;{cell};0.0"
    with pytest.raises(InvalidInputError, match=r"'force'.*row 11") as caught:
        load(tmp_path, "\n".join(lines))
    assert cell in str(caught.value)


@pytest.mark.parametrize("row", ["0.299,0.5", "0.299", "0.299,,", "0.299,nan,0", "0.299,inf,0"])
def test_torn_or_missing_cells_are_refused_as_such(tmp_path: Path, row: str) -> None:
    with pytest.raises(LogRefusedError) as caught:
        load(tmp_path, text(tmp_path) + row)
    assert {finding.code for finding in caught.value.findings} == {"non-finite"}
    assert "sample 300" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "empty"),
        (b"\n\n  \n", "empty"),
        (b"time,force,position\n1,2,3,4,5\n", "equally long rows"),
        (b'time,force,position\n1,"2,3\n', "equally long rows|not a number"),
        (b"time,force,force,position\n" + b"1,2,3,4\n" * 300, "two columns named 'force'"),
    ],
)
def test_files_that_are_no_tables(tmp_path: Path, content: bytes, part: str) -> None:
    with pytest.raises(InvalidInputError, match=part):
        load(tmp_path, content)


def test_header_only_is_too_short(tmp_path: Path) -> None:
    with pytest.raises(LogRefusedError) as caught:
        load(tmp_path, "time,force,position\n")
    assert caught.value.findings[0].code == "too-short"


def test_missing_files_folders_and_other_endings(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="No such file"):
        load_trajectory(tmp_path / "nothing.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InvalidInputError, match="cannot be read"):
        load_trajectory(tmp_path / "folder.csv")
    with pytest.raises(
        InvalidInputError, match=r"\.csv, \.txt, \.tsv, .*\.parquet, \.mat, \.npz, \.xlsx or \.mcap"
    ):
        load(tmp_path, text(tmp_path), "log.foo")


@pytest.mark.parametrize("shape", [(ROWS, 1), (1, ROWS)])
def test_reads_matlab(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = mat(tmp_path, force=FORCE.reshape(shape), reference=POSITION)
    log = load_trajectory(path, LogColumns(force_gain=2.0))
    np.testing.assert_array_equal(log.force, 2 * FORCE)
    assert log.reference is None


@pytest.mark.parametrize("head", [b"", b"MATLAB 7.3 MAT-file".ljust(512)])
def test_matlab_73_says_so(tmp_path: Path, head: bytes) -> None:
    content = head + b"\x89HDF\r\n\x1a\n" + bytes(1000)
    with pytest.raises(InvalidInputError, match=r"7\.3"):
        load(tmp_path, content, "log.mat")
