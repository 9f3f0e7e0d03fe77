"""How a table is written: lines around its header, separators, units, the decimal mark."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Literal

from identification.errors import InvalidInputError
from identification.readers.columns import (
    LogColumns,
    column_names,
    gain_given,
    gain_option,
    quote,
    split_name,
    unit_named,
)

#: Bytes of the header line and columns of a table: memory is spent on each name.
LONGEST_HEADER = 5_000_000
MOST_COLUMNS = 10_000
#: Columns of the shortest header: time, force, position.
FEWEST_COLUMNS = 3
#: Rows above the header that are looked at; rows of units or comments between it and the samples;
#: lines below the header that are looked at, and bytes of all.
MOST_ABOVE = 200
MOST_BETWEEN = 10
_MOST_BELOW = 5000
_BEGINNING = 200_000
#: What marks a line as a comment.
COMMENT = ("#", "%", "//")
#: Characters around a name that do not belong to it.
_AROUND = " \t\"'#%/\ufeff"
#: A number, with a decimal point or comma; digits may be grouped.
_NUMBER = re.compile(
    r"[+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE
)
#: Hours, minutes and seconds at the end of a cell, with a day before them or none.
CLOCK = re.compile(
    r"(?:^|[ T])(?:(\d{1,2}):)?(\d{1,2}):(\d{2}(?:[.,:]\d+)?) ?(?:([AaPp])[Mm])?"
    r"(?:Z|[+-]\d\d:?\d\d)?$"
)
#: Separators in the order tried; spaces last, as names and other tables may hold them.
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "spaces"}
#: A name with its unit, or any word, in a line separated by spaces.
_SPACED = re.compile(r"\"[^\"]*\"|[^\s\[(]+(?:\s?(?:\[[^\]]*\]|\([^)]*\)))?|\S+")
#: Digits after a comma that no thousands separator leaves: none leads with 0, each groups by three.
_DECIMAL_COMMA = re.compile(r"[+-]?(?:\d*,(?!\d{3}$)\d*|,\d+|\d{4,},\d*|0\d*,\d+)(?:[eE][+-]?\d+)?")
#: Groups of thousands and nothing else.
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:,\d{3}){2,}(?:\.\d*)?|[+-]?\d{1,3},\d{3}\.\d*")

Row = Sequence[str]
Decimal = Literal["comma", "point"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Where a table stands.

    Attributes:
        header: row of the names of the columns, 0 the first row of the file.
        first: row of the first sample.
        names: of all columns; units from a row of their own stand behind them in brackets.
        wanted: names of the columns of the log by role, from ``names``.
        notes: what was left out or taken from another row, in words.
    """

    header: int
    first: int
    names: tuple[str, ...]
    wanted: dict[str, str]
    notes: tuple[str, ...]

    @property
    def places(self) -> dict[str, int]:
        """By role, which column it is."""
        return {role: self.names.index(name) for role, name in self.wanted.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """How a text file writes its table; the rows of the layout are lines of the file.

    The separator is that of the samples; a space stands for spaces and tabs of any number.
    """

    separator: str
    decimal: Decimal
    layout: Layout

    @property
    def notes(self) -> tuple[str, ...]:
        """What was understood that is not so in a plain file, in words."""
        notes = [] if self.separator == "," else [f"{_SEPARATORS[self.separator]} between columns"]
        notes += ["decimal commas"] if self.decimal == "comma" else []
        return (*notes, *self.layout.notes)


def refuse_wide(path: Path, header: bytes, columns: int) -> None:
    """Raises InvalidInputError for a header line that no table of a log has."""
    if len(header) > LONGEST_HEADER:
        problem = f"has a header line of {len(header)} bytes, more than {LONGEST_HEADER}"
    elif columns > MOST_COLUMNS:
        problem = f"has {columns} columns, more than {MOST_COLUMNS}"
    else:
        return
    raise InvalidInputError(path, problem, "Export the columns of the log alone, a row a line")


def refuse_open_quote(path: Path, header: bytes) -> None:
    """Raises InvalidInputError for a header line that goes on in the next one."""
    if header.count(b'"') % 2:
        problem = "has a quote in its header line that is not closed"
        raise InvalidInputError(path, problem, "Leave out the quote")


def named_by(row: Row) -> tuple[str, ...]:
    """Names that a row of cells gives its columns."""
    return tuple(cell.strip(_AROUND) for cell in row)


def roles_of(path: Path, row: Row, columns: LogColumns) -> dict[str, str] | None:
    """Columns of the log by role if a row of cells names all of them, else None."""
    names = named_by(row)
    if len(names) < FEWEST_COLUMNS:
        return None
    try:
        wanted = column_names(path, columns, names, table=True)
    except InvalidInputError:
        return None
    return wanted if all(names.count(name) == 1 for name in wanted.values()) else None


def find_layout(
    path: Path, above: Sequence[Row], below: Sequence[Row], columns: LogColumns
) -> Layout | None:
    """Layout of a table from the rows down to its header and those below, the first at least.

    None where rows around the header are neither comments nor units. Raises InvalidInputError for a
    row of units of which one is not known, or contradicts the header.
    """
    header = len(above) - 1
    wanted = roles_of(path, above[header], columns)
    if wanted is None:
        return None
    names = list(named_by(above[header]))
    places = {role: names.index(name) for role, name in wanted.items()}
    if any(_is_sample(row, range(len(row))) for row in above[:header]):
        return None  # samples above a header are of another log
    first = next(
        (k for k, row in enumerate(below[: MOST_BETWEEN + 1]) if _is_sample(row, places.values())),
        None,
    )
    if first is None:
        return None
    units: dict[str, str] = {}
    for row in (*below[:first], *above[max(0, header - 1) : header]):
        found = _units_in(path, row, places, columns)
        if found is None and row in below[:first] and not _is_comment(row):
            return None
        units = units or found or {}
    for role, text in units.items():
        place = places[role]
        names[place] = _with_unit(path, role, names[place], text)
    notes: list[str] = []
    if header:
        notes.append(f"{header} line{'' if header == 1 else 's'} above the header left out")
    if units:
        notes.append("a row of units")
    if first - (1 if units else 0) > 0 and any(_is_comment(row) for row in below[:first]):
        notes.append("comments below the header left out")
    return Layout(
        header=header,
        first=header + 1 + first,
        names=tuple(names),
        wanted={role: names[place] for role, place in places.items()},
        notes=tuple(notes),
    )


def is_number(cell: str) -> bool:
    """Whether a cell is a number, or a time of day that time is told by."""
    return (_NUMBER.fullmatch(cell.strip()) or CLOCK.search(cell)) is not None


def _is_sample(row: Row, places: Iterable[int]) -> bool:
    """Whether the cells at these places are numbers, none but one missing."""
    cells = [row[place].strip() for place in places if place < len(row)]
    return (
        len(cells) >= FEWEST_COLUMNS
        and cells.count("") <= 1
        and all(is_number(cell) for cell in cells if cell)
    )


def _is_comment(row: Row) -> bool:
    text = "".join(row).strip()
    return not text or text.startswith(COMMENT)


def _units_in(
    path: Path, row: Row, places: dict[str, int], columns: LogColumns
) -> dict[str, str] | None:
    """Units by role that a row states; None for a row of something else.

    Raises InvalidInputError if one is not known, and no gain makes it known.
    """
    cells = named_by(row)
    texts = {role: cells[place] for role, place in places.items() if place < len(cells)}
    texts = {role: text.strip("[]()") for role, text in texts.items() if text.strip("[]()-")}
    known = {role for role, text in texts.items() if unit_named(role, text) is not None}
    if not known or any(is_number(text) for text in texts.values()):
        return None
    for role, text in texts.items():
        if role not in known and gain_given(role, columns) is None:
            problem = f"has a row of units, and '{quote(text)}' is no unit of {role} that is known"
            remedy = f"Add {gain_option(role)} X, what one of it is in SI units"
            raise InvalidInputError(path, problem, remedy)
    return texts


def _with_unit(path: Path, role: str, name: str, text: str) -> str:
    """The name of a column with the unit of the row below. Raises InvalidInputError."""
    stem, own = split_name(role, name)
    if own is None:
        return f"{stem} [{text}]"
    mine, other = unit_named(role, own), unit_named(role, text)
    if mine != other and (mine is None or other is None or mine.size != other.size):
        problem = f"column '{quote(name)}' has '{quote(text)}' in the row of units"
        raise InvalidInputError(path, problem, "Delete the one that is wrong")
    return name


def recognise(path: Path, content: bytes, columns: LogColumns) -> Dialect | None:
    """How a file of UTF-8 text is written; None where that is not certain.

    Raises InvalidInputError for what is not certain, with the option that makes it so, and for a
    line down to the header that no table of a log has.
    """
    lines = list(_beginning(content))
    for header, line in enumerate(lines[:MOST_ABOVE]):
        written = line.encode()
        if not any(lines[:header]) and not line.startswith(COMMENT):
            refuse_open_quote(path, written)
        # Runs of spaces stand between two columns, not around columns of their own.
        refuse_wide(path, written, max(len(line.split()), *(line.count(c) + 1 for c in ",;\t")))
        for separator in _SEPARATORS:
            if roles_of(path, split_line(line, separator), columns) is None:
                continue
            found = _below(path, lines, header, separator, columns)
            if found is not None:
                return found
    return None


def _beginning(content: bytes) -> Iterator[str]:
    """First lines as text, without their ends; a last one that was cut is left out."""
    start = content[:_BEGINNING]
    if len(start) < len(content):
        start = start[: start.rfind(b"\n") + 1]
    for line in islice(BytesIO(start), MOST_ABOVE + _MOST_BELOW):
        try:
            text = line.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = line.decode("cp1252", "replace")
        yield text.rstrip("\r\n").replace("\0", "")


def split_line(line: str, separator: str) -> list[str]:
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


def _below(
    path: Path, lines: Sequence[str], header: int, separator: str, columns: LogColumns
) -> Dialect | None:
    """The dialect of the samples below a header, whose separator may be another."""
    above = [split_line(line, separator) for line in lines[: header + 1]]
    for each in (separator, *(other for other in _SEPARATORS if other != separator)):
        below = [split_line(line, each) for line in lines[header + 1 : header + 2 + MOST_BETWEEN]]
        layout = find_layout(path, above, below, columns)
        if layout is None:
            continue
        rows = lines[layout.first :]
        cells = len(split_line(rows[0], each))
        if cells <= len(above[header]):
            decimal = _decimal_of(path, each, layout, rows, columns)
            return Dialect(separator=each, decimal=decimal, layout=layout)
        if each == "," and cells >= 2 * len(layout.names) - 1:
            raise InvalidInputError(
                path,
                f"is not a table of equally long rows: line {layout.first + 1}, '{quote(rows[0])}',"
                f" has {cells} cells below {len(layout.names)} names, as if commas stood between "
                "columns and before decimals",
                "Export it with semicolons or tabs between columns, or with decimal points",
            )
    return None


def _decimal_of(
    path: Path, separator: str, layout: Layout, rows: Sequence[str], columns: LogColumns
) -> Decimal:
    """What stands before decimals in the columns of the log. Raises InvalidInputError."""
    if columns.decimal is not None:
        return columns.decimal
    places = sorted(layout.places.values())
    doubtful = comma = point = ""
    for number, line in enumerate(rows, layout.first + 1):
        row = split_line(line, separator)
        for place in (place for place in places if place < len(row)):
            cell = row[place].strip()
            if CLOCK.search(cell):
                continue
            name = quote(layout.names[place])
            seen = f"column '{name}' holds '{quote(cell)}' in row {number}"
            if _GROUPED.fullmatch(cell):
                problem = f"{seen}, with separators of thousands"
                raise InvalidInputError(path, problem, "Export it without them")
            if "." in cell:
                point = point or seen
            elif "," in cell and _DECIMAL_COMMA.fullmatch(cell):
                comma = comma or seen
            elif "," in cell:
                doubtful = doubtful or seen
    if comma and point:
        problem = f"{comma} and {point}: commas and points before decimals"
        raise InvalidInputError(path, problem, "Export it with decimal points alone")
    if doubtful and not comma:
        raise InvalidInputError(
            path,
            f"{doubtful}, which may have a decimal comma or a separator of thousands, and no "
            "cell tells which",
            "Add --decimal comma if it is before decimals; else export it without separators of "
            "thousands",
        )
    return "comma" if comma else "point"
