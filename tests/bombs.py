"""Small logs that unfold to much, one for each part of a format that can."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable, Iterable
from itertools import chain, repeat
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from tests.packed_logs import SAMPLES
from tests.test_log_workbooks import HEADER, workbook

_SHEET, _BOOK = "xl/worksheets/sheet1.xml", "xl/workbook.xml"
_STYLES, _RELATIONS, _TYPES = "xl/styles.xml", "xl/_rels/workbook.xml.rels", "[Content_Types].xml"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_KIND = "application/vnd.openxmlformats-officedocument.spreadsheetml.worksheet+xml"
_SHEETS = 20_000

#: By part of a workbook: the mark before which pieces are put.
Changes = dict[str, tuple[bytes, Iterable[bytes]]]


def _workbook(folder: Path, changes: Changes, *, sheets: int = 0) -> Path:
    """A good workbook with pieces put into its parts, and empty sheets beside its own."""
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
        for k in range(sheets):
            archive.writestr(_sheet(k), f'<worksheet xmlns="{_MAIN}"><sheetData/></worksheet>')
    return path


def _sheet(k: int) -> str:
    return f"xl/worksheets/s{k}.xml"


def _each(text: str, count: int = _SHEETS) -> Iterable[bytes]:
    """A text with every number in the place of its stars."""
    return (text.replace("*", str(k)).encode() for k in range(count))


def cell(folder: Path) -> Path:
    """One cell of 800 MB."""
    start, end = b'<row r="302"><c r="A302" t="inlineStr"><is><t>', b"</t></is></c></row>"
    text = repeat(b"x" * 1_000_000, 800)
    return _workbook(folder, {_SHEET: (b"</sheetData>", chain([start], text, [end]))})


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
    return _workbook(folder, changes, sheets=_SHEETS)


def _bag(folder: Path, definition: str, rest: bytes) -> Path:
    """Twenty-five messages of two numbers and what follows them."""
    path = folder / "log.mcap"
    with path.open("wb") as stream:
        writer: Any = Writer(stream)
        writer.start("ros2", "")
        text = f"float64 position\nfloat64 force\n{definition}"
        schema = writer.register_schema("rig_msgs/msg/Axis", "ros2msg", text.encode())
        channel = writer.register_channel("/axis", "cdr", schema)
        for k in range(25):
            data = b"\0\1\0\0" + struct.pack("<dd", 0.01 * k, 1.0) + rest
            writer.add_message(channel, log_time=10**6 * k, data=data, publish_time=10**6 * k)
        writer.finish()
    return path


def elements(folder: Path) -> Path:
    """Messages of a million elements."""
    one = struct.pack("<Ixxxx", 1)
    return _bag(folder, "string[] names\n", struct.pack("<I", 1_000_000) + one * 1_000_000)


BOMBS: dict[str, Callable[[Path], Path]] = {
    each.__name__: each for each in (elements, sheets, cell)
}
