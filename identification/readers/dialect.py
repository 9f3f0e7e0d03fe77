"""How a text file writes its table: separators, decimal mark, lines around the header."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Literal

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, quote
from identification.readers.layout import COMMENT, MOST_BETWEEN, Layout, find_layout, roles_of
from identification.readers.limits import refuse_open_quote, refuse_wide

#: Lines above and below the header that are looked at, and bytes of them.
_MOST_ABOVE = 200
_MOST_BELOW = 5000
_BEGINNING = 200_000
#: Separators in the order tried; spaces last, as names and other tables may hold them.
_SEPARATORS = (",", ";", "\t", " ")
_WORDS = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "spaces"}
#: A name with its unit, or any word, in a line separated by spaces.
_SPACED = re.compile(r"\"[^\"]*\"|[^\s\[(]+(?:\s?(?:\[[^\]]*\]|\([^)]*\)))?|\S+")
#: Digits after a comma that no thousands separator leaves: none leads with 0, each groups by three.
_DECIMAL_COMMA = re.compile(r"[+-]?(?:\d*,(?!\d{3}$)\d*|,\d+|\d{4,},\d*|0\d*,\d+)(?:[eE][+-]?\d+)?")
#: Groups of thousands and nothing else.
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:,\d{3}){2,}(?:\.\d*)?|[+-]?\d{1,3},\d{3}\.\d*")

Decimal = Literal["comma", "point"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """How a text file writes its table.

    Attributes:
        separator: of its samples; a space stands for spaces and tabs of any number.
        decimal: what stands before decimals.
        layout: where header and samples stand; rows are lines of the file.
    """

    separator: str
    decimal: Decimal
    layout: Layout

    @property
    def notes(self) -> tuple[str, ...]:
        """What was understood that is not so in a plain file, in words."""
        notes = [] if self.separator == "," else [f"{_WORDS[self.separator]} between columns"]
        notes += ["decimal commas"] if self.decimal == "comma" else []
        return (*notes, *self.layout.notes)


def cells_of(line: str, separator: str) -> list[str]:
    """Cells of one line; quotes around them are taken off."""
    if separator == " ":
        cells = [cell.strip('"') for cell in _SPACED.findall(line)]
        # The mark of a comment is no cell of its own.
        return ["".join(cells[:2]), *cells[2:]] if cells[:1] and cells[0] in COMMENT else cells
    rows = csv.reader([line], delimiter=separator, skipinitialspace=True)
    try:
        return list(next(rows, ()))
    except csv.Error:  # a carriage return inside, or a cell without end
        return []


def recognise(path: Path, content: bytes, columns: LogColumns) -> Dialect | None:
    """How a file of UTF-8 text is written; None where that is not certain.

    Args:
        path: the file, for messages.
        content: all of it.
        columns: what the user asked for; all of them stand in a header.

    Raises:
        InvalidInputError: what is not certain, with the option that makes it so; a line down to
            the header that no table of a log has.
    """
    lines = list(_beginning(content))
    for header, line in enumerate(lines[:_MOST_ABOVE]):
        _refuse_endless(path, line, is_first=not any(lines[:header]))
        for separator in _SEPARATORS:
            if roles_of(path, cells_of(line, separator), columns) is None:
                continue
            found = _below(path, lines, header, separator, columns)
            if found is not None:
                return found
    return None


def _refuse_endless(path: Path, line: str, *, is_first: bool) -> None:
    """Refuse a line down to the header that is too wide, or the first if it goes on in the next."""
    written = line.encode()
    if is_first and not line.startswith(COMMENT):
        refuse_open_quote(path, written)
    # Runs of spaces stand between two columns, not around columns of their own.
    columns = max(len(line.split()), *(line.count(mark) + 1 for mark in _SEPARATORS[:-1]))
    refuse_wide(path, written, columns)


def _beginning(content: bytes) -> Iterator[str]:
    """First lines as text, without their ends; a last one that was cut is left out."""
    start = content[:_BEGINNING]
    if len(start) < len(content):
        start = start[: start.rfind(b"\n") + 1]
    for line in islice(BytesIO(start), _MOST_ABOVE + _MOST_BELOW):
        yield as_text(line).rstrip("\r\n").replace("\0", "")


def as_text(line: bytes) -> str:
    """A line as UTF-8, or where it is none as the Western code page of Windows."""
    try:
        return line.decode("utf-8-sig")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


def _below(
    path: Path, lines: Sequence[str], header: int, separator: str, columns: LogColumns
) -> Dialect | None:
    """The dialect of the samples below a header, whose separator may be another."""
    named = cells_of(lines[header], separator)
    others = [each for each in _SEPARATORS if each != separator]
    for each in (separator, *others):
        below = [cells_of(line, each) for line in lines[header + 1 : header + 2 + MOST_BETWEEN]]
        above = [cells_of(line, separator) for line in lines[:header]]
        layout = find_layout(path, [*above, named], below, columns)
        if layout is None:
            continue
        rows = lines[layout.first :]
        cells = len(cells_of(rows[0], each))
        if cells > len(named):
            _refuse_commas(path, each, layout, rows[0], cells)
            continue
        decimal = _decimal_of(path, each, layout, rows, columns)
        return Dialect(separator=each, decimal=decimal, layout=layout)
    return None


def _refuse_commas(path: Path, separator: str, layout: Layout, line: str, cells: int) -> None:
    """Refuse lines in which a comma stands between columns and before decimals."""
    if separator == "," and cells >= 2 * len(layout.names) - 1:
        raise InvalidInputError(
            path,
            f"is not a table of equally long rows: line {layout.first + 1}, '{quote(line)}', has "
            f"{cells} cells below {len(layout.names)} names, as if commas stood between columns "
            "and before decimals",
            "Export it with semicolons or tabs between columns, or with decimal points",
        )


def _decimal_of(
    path: Path, separator: str, layout: Layout, rows: Sequence[str], columns: LogColumns
) -> Decimal:
    """What stands before decimals in the columns of the log. Raises InvalidInputError."""
    if columns.decimal is not None:
        return columns.decimal
    places = sorted(layout.places.values())
    doubtful = comma = point = ""
    for number, line in enumerate(rows, layout.first + 1):
        row = cells_of(line, separator)
        for place in (place for place in places if place < len(row)):
            cell = row[place].strip()
            name = quote(layout.names[place])
            seen = f"column '{name}' holds '{quote(cell)}' in row {number}"
            if _GROUPED.fullmatch(cell):
                raise InvalidInputError(
                    path,
                    f"{seen}, with separators of thousands",
                    "Export it without them",
                )
            if "." in cell:
                point = point or seen
            elif "," in cell and _DECIMAL_COMMA.fullmatch(cell):
                comma = comma or seen
            elif "," in cell:
                doubtful = doubtful or seen
    if comma and point:
        raise InvalidInputError(
            path,
            f"{comma} and {point}: commas and points before decimals",
            "Export it with decimal points alone",
        )
    if doubtful and not comma:
        raise InvalidInputError(
            path,
            f"{doubtful}, which may have a decimal comma or a separator of thousands, and no "
            "cell tells which",
            "Add --decimal comma if it is before decimals; else export it without separators of "
            "thousands",
        )
    return "comma" if comma else "point"
