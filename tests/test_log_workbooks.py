"""Excel workbooks give what the plain CSV gives; written by openpyxl itself."""

import zipfile
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timedelta
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest

from identification import load_trajectory
from tests.packed_logs import (
    SAMPLES,
    TIME,
    assert_damage_is_refused,
    assert_extra_is_named,
    assert_is_the_plain_log,
    refusal,
)

pytestmark = pytest.mark.usefixtures("read_here")

HEADER = ("time", "force", "position")
SHEET = "xl/worksheets/sheet1.xml"
#: By part of a workbook: the mark before which pieces are put.
Changes = dict[str, tuple[bytes, Iterable[bytes]]]


def workbook(
    folder: Path, *rows: Sequence[Any], sheets: Mapping[str, Sequence[Sequence[Any]]] | None = None
) -> Path:
    """A workbook of one sheet, or of several by name."""
    book: Any = openpyxl.Workbook()
    book.remove(book.active)
    for name, cells in (sheets or {"Log": rows}).items():
        sheet = book.create_sheet(name)
        for row in cells:
            sheet.append(list(row))
    path = folder / "log.xlsx"
    book.save(path)
    return path


def stuffed(folder: Path, changes: Changes, more: Mapping[str, str] | None = None) -> Path:
    """A good workbook with pieces put into its parts, and more parts beside its own."""
    path = workbook(folder, HEADER, *SAMPLES)
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in parts.items():
            mark, pieces = changes.get(name, (b"", ()))
            place = content.index(mark)
            with archive.open(name, "w", force_zip64=True) as stream:
                for piece in chain([content[:place]], pieces, [content[place:]]):
                    stream.write(piece)
        for name, text in (more or {}).items():
            archive.writestr(name, text)
    return path


def test_a_sheet_is_read_as_the_plain_log(tmp_path: Path) -> None:
    assert_is_the_plain_log(tmp_path, workbook(tmp_path, HEADER, *SAMPLES), "")


def test_titles_units_and_empty_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    milli = [[1e3 * cell for cell in row] for row in SAMPLES]
    path = workbook(
        tmp_path,
        ("Rig 7", None, datetime(2026, 3, 1)),
        (),
        ("time", "force", "pos"),
        ("ms", "mN", "mm"),
        *milli,
        (None, None, None),
    )
    words = (
        "2 lines above the header left out, a row of units, time from 'time [ms]' times 0.001, "
        "force from 'force [mN]' times 0.001, position from 'pos [mm]' times 0.001"
    )
    assert_is_the_plain_log(tmp_path, path, words)


def test_the_one_sheet_that_holds_a_log_is_found(tmp_path: Path) -> None:
    sheets = {"Notes": [("Rig", 7), ("by", "hand")], "Run 1": [HEADER, *SAMPLES]}
    assert_is_the_plain_log(tmp_path, workbook(tmp_path, sheets=sheets), "sheet 'Run 1'")
    two = {"Run 1": [HEADER, *SAMPLES], "Run 2": [HEADER, *SAMPLES]}
    assert "several sheets with the columns of a log: 'Run 1', 'Run 2'" in refusal(
        workbook(tmp_path, sheets=two)
    )


def test_dates_become_seconds(tmp_path: Path) -> None:
    start = datetime(2026, 3, 1, 12)
    rows = [(start + timedelta(milliseconds=k), *row[1:]) for k, row in enumerate(SAMPLES)]
    path = workbook(tmp_path, ("time [ms]", *HEADER[1:]), *rows)
    log = load_trajectory(path)
    # A workbook stores days; Excel and openpyxl keep milliseconds.
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)


def test_what_is_no_number_is_named_by_its_row(tmp_path: Path) -> None:
    rows = [*SAMPLES[:8], (0.008, "late", 0.0), *SAMPLES[9:]]
    said = refusal(workbook(tmp_path, HEADER, *rows))
    assert "column 'force' holds 'late' in row 10, which is not a number" in said
    path = workbook(tmp_path, HEADER, *SAMPLES[:8], (0.008, True, 0.0), *SAMPLES[9:])
    assert "'True' in row 10" in refusal(path)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([("when", "force", "where"), *SAMPLES], "has no column 'time', 'position'; it has: when"),
        ([HEADER, ("a", "b", "c"), *SAMPLES], "holds 'a' in row 2, which is not a number"),
        ([], "no table on any sheet"),
        ([("time", "current [A]", "position"), *SAMPLES], 'perhaps --force "current [A]"'),
        ([("time", "force [x]", "position"), *SAMPLES], "Add --force-gain X"),
    ],
)
def test_what_is_no_log_is_named(tmp_path: Path, rows: list[Any], said: str) -> None:
    assert said in refusal(workbook(tmp_path, *rows))


def test_torn_and_damaged_workbooks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    whole = workbook(tmp_path, HEADER, *SAMPLES).read_bytes()
    assert_damage_is_refused(whole, tmp_path / "torn.xlsx", (0, 10, 1000, len(whole) - 10))


@pytest.mark.parametrize(
    ("far", "said"),
    [
        (b'<row r="1048576"><c r="A1048576"><v>1</v></c></row>', "1000 empty rows above a cell"),
        (b'<row r="302"><c r="XFD302"><v>1</v></c></row>', "16384 columns, more than 10000"),
    ],
)
def test_a_cell_far_away_is_refused(tmp_path: Path, far: bytes, said: str) -> None:
    """A sheet that claims a million rows, or sixteen thousand columns, in a kilobyte."""
    assert said in refusal(stuffed(tmp_path, {SHEET: (b"</sheetData>", [far])}))


def test_the_extra_names_itself_where_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    path = workbook(tmp_path, HEADER, *SAMPLES)
    missing = "openpyxl, which reads them, is not installed"
    assert_extra_is_named(monkeypatch, path, "openpyxl", missing, "excel")
