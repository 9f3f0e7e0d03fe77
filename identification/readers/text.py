"""Text files: how a table is written, and its numbers.

A table is found by a line that names the columns of the log, else by the first line of numbers.
Numbers alone are read without the table library, which takes longer to load.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from identification.errors import InvalidInputError, counted
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    column_names,
    gain_given,
    gain_option,
    quote,
    refuse_long,
    split_name,
    unit_named,
)
from identification.readers.encoding import MARK, as_utf8, refuse_packed, refuse_zeros

if TYPE_CHECKING:
    import polars

#: Bytes of the header line and columns of a table: memory is spent on each name.
_LONGEST_HEADER = 5_000_000
MOST_COLUMNS = 10_000
#: Columns of the shortest header: time, force, position.
FEWEST_COLUMNS = 3
#: Rows above the header that are looked at; rows of units or comments between it and the samples;
#: lines below the header that are looked at, and bytes of all.
_MOST_ABOVE = 200
_MOST_BETWEEN = 10
_MOST_BELOW = 5000
_BEGINNING = 200_000
#: What marks a line as a comment.
_COMMENT = ("#", "%", "//")
#: Characters around a name that do not belong to it.
_AROUND = " \t\"'#%/\ufeff"
#: A number, with a decimal point or comma; digits may be grouped.
_NUMBER = re.compile(
    r"[+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE
)
#: Hours, minutes and seconds at the end of a cell, with a day before them or none.
_CLOCK = re.compile(
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

#: Bytes. Beyond it the time to load the table library is earned back.
_LARGEST_PLAIN = 8_000_000
#: Anything but numbers, separators and line ends.
_OTHER = re.compile(rb"[^0-9.eE+\-,;\t\n]")
#: What lines separated by single spaces do not hold.
_RUNS = (b"  ", b"\t", b"\n ", b" \n", b" \r")


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Where a table stands in lines of text, and how it is written."""

    separator: str  # of the samples; a space stands for spaces and tabs of any number
    decimal: Decimal = "point"  # what stands before decimals
    header: int  # line of the names of the columns, 0 the first; -1 where their places name them
    first: int  # line of the first sample
    names: tuple[str, ...]  # of all columns; units of a line of their own stand behind in brackets
    wanted: dict[str, str]  # names of the columns of the log by role, from ``names``
    notes: tuple[str, ...] = ()  # what was left out or taken from another line, in words

    @property
    def places(self) -> dict[str, int]:
        """By role, which column it is."""
        return {role: self.names.index(name) for role, name in self.wanted.items()}


def read_text(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; empty cells are NaN. Raises InvalidInputError."""
    # Before letters of another encoding are made of the bytes that tell a packed file.
    refuse_packed(path, content)
    content, notes = as_utf8(path, content)
    refuse_zeros(path, content)
    table = table_of(path, content, columns)
    reading = read_samples(path, content, table)
    if table.notes or table.header or table.separator == " " or table.decimal == "comma":
        if table.separator != "," and table.header >= 0:
            notes = (*notes, f"{_SEPARATORS[table.separator]} between columns")
        notes = (*notes, *(["decimal commas"] if table.decimal == "comma" else []))
    return replace(reading, notes=(*notes, *reading.notes))


def table_of(path: Path, content: bytes, columns: LogColumns) -> Table:
    """Where the log stands in UTF-8 text. Raises InvalidInputError for what is not certain."""
    lines = beginning_of(content)
    counted = any(map(str.isdecimal, (columns.time, columns.force, columns.position)))
    samples = _first_samples(lines) if counted else None
    if samples is None or samples[0] >= 0:
        found = find_table(path, lines, columns)
        if found is not None:
            return found
    return _table_by_numbers(path, lines, columns)


def find_table(path: Path, lines: Sequence[str], columns: LogColumns) -> Table | None:
    """The table below the line that names the columns, or None. Raises InvalidInputError."""
    named: Table | None = None
    for header, line in enumerate(lines[:_MOST_ABOVE]):
        written = line.encode()
        if not any(lines[:header]) and not line.startswith(_COMMENT) and written.count(b'"') % 2:
            problem = "has a quote in its header line that is not closed"
            raise InvalidInputError(path, problem, "Leave out the quote")
        # Runs of spaces stand between two columns, not around columns of their own.
        _refuse_wide(path, written, max(len(line.split()), *(line.count(c) + 1 for c in ",;\t")))
        for separator in _SEPARATORS:
            wanted = _roles_of(path, _split_line(line, separator), columns)
            if wanted is None:
                continue
            found = _below(path, lines, header, separator, columns)
            if found is not None:
                return found
            named = named or Table(
                separator=separator,
                header=header,
                first=header + 1,
                names=_named_by(_split_line(line, separator)),
                wanted=wanted,
            )
    if named is not None and named.header:
        raise InvalidInputError(
            path,
            f"has {counted(named.header, 'line')} above its header, which "
            f"stands in line {named.header + 1}; the first is '{quote(lines[0])}'",
            "Delete the lines above the header",
        )
    return named


def _table_by_numbers(path: Path, lines: Sequence[str], columns: LogColumns) -> Table:
    """The table of the first line of numbers, below as many names, or named by its places."""
    top, line = next(((row, line) for row, line in enumerate(lines) if line.strip()), (0, ""))
    usual = max(",;\t", key=line.count)
    header, first, separator = _first_samples(lines) or (top, top + 1, usual)
    names = _named_by(_split_line(lines[max(header, 0)], separator))
    if header < 0:
        count = len(_split_line(lines[first], separator))
        names = tuple(str(place) for place in range(1, count + 1))
    wanted = column_names(path, columns, names, table=True)
    for name in wanted.values():
        if names.count(name) > 1:
            problem = f"has two columns named '{quote(name)}'"
            raise InvalidInputError(path, problem, "Rename one of them")
    table = Table(separator=separator, header=header, first=first, names=names, wanted=wanted)
    return replace(table, decimal=_decimal_of(path, table, lines[first:], columns))


def _first_samples(lines: Sequence[str]) -> tuple[int, int, str] | None:
    """(line that seems to name the columns, first line of numbers, their separator).

    The first is -1 where nothing but comments stands above; None where lines above have less cells.
    """
    above: list[int] = []
    for row, line in enumerate(lines):
        for separator in "\t;, ":
            cells = _split_line(line, separator)
            if sum(map(_is_number, cells)) < max(FEWEST_COLUMNS, len(cells) - 1):
                continue
            headers = [at for at in above if len(_split_line(lines[at], separator)) >= len(cells)]
            if headers:
                return headers[-1], headers[-1] + 1, separator
            bare = all(lines[at].startswith(_COMMENT) for at in above)
            return (-1, row, separator) if bare else None
        if line.strip():
            above.append(row)
    return None


def _refuse_wide(path: Path, header: bytes, columns: int) -> None:
    """Raises InvalidInputError for a header line that no table of a log has."""
    if len(header) > _LONGEST_HEADER:
        problem = f"has a header line of {len(header)} bytes, more than {_LONGEST_HEADER}"
    elif columns > MOST_COLUMNS:
        problem = f"has {columns} columns, more than {MOST_COLUMNS}"
    else:
        return
    raise InvalidInputError(path, problem, "Export the columns of the log alone, a row a line")


def _named_by(row: Row) -> tuple[str, ...]:
    """Names that a row of cells gives its columns."""
    return tuple(cell.strip(_AROUND) for cell in row)


def _roles_of(path: Path, row: Row, columns: LogColumns) -> dict[str, str] | None:
    """Columns of the log by role if a row of cells names all of them, else None."""
    names = _named_by(row)
    if len(names) < FEWEST_COLUMNS:
        return None
    try:
        wanted = column_names(path, columns, names, table=True)
    except InvalidInputError:
        return None
    return wanted if all(names.count(name) == 1 for name in wanted.values()) else None


def _laid_out(
    path: Path, above: Sequence[Row], below: Sequence[Row], separator: str, columns: LogColumns
) -> Table | None:
    """The table of a header, the last row of those above, and the first rows below it; or None."""
    header = len(above) - 1
    wanted = _roles_of(path, above[header], columns)
    if wanted is None:
        return None
    names = list(_named_by(above[header]))
    places = {role: names.index(name) for role, name in wanted.items()}
    if any(_is_sample(row, range(len(row))) for row in above[:header]):
        return None  # samples above a header are of another log
    first = next(
        (k for k, row in enumerate(below[: _MOST_BETWEEN + 1]) if _is_sample(row, places.values())),
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
        notes.append(f"{counted(header, 'line')} above the header left out")
    if units:
        notes.append("a row of units")
    if first - (1 if units else 0) > 0 and any(_is_comment(row) for row in below[:first]):
        notes.append("comments below the header left out")
    return Table(
        separator=separator,
        header=header,
        first=header + 1 + first,
        names=tuple(names),
        wanted={role: names[place] for role, place in places.items()},
        notes=tuple(notes),
    )


def _is_number(cell: str) -> bool:
    """Whether a cell is a number, or a time of day that time is told by."""
    return (_NUMBER.fullmatch(cell.strip()) or _CLOCK.search(cell)) is not None


def _is_sample(row: Row, places: Iterable[int]) -> bool:
    """Whether the cells at these places are numbers, none but one missing."""
    cells = [row[place].strip() for place in places if place < len(row)]
    return (
        len(cells) >= FEWEST_COLUMNS
        and cells.count("") <= 1
        and all(_is_number(cell) for cell in cells if cell)
    )


def _is_comment(row: Row) -> bool:
    text = "".join(row).strip()
    return not text or text.startswith(_COMMENT)


def _units_in(
    path: Path, row: Row, places: dict[str, int], columns: LogColumns
) -> dict[str, str] | None:
    """Units by role that a row states, or None. Raises InvalidInputError for an unknown one."""
    cells = _named_by(row)
    texts = {role: cells[place] for role, place in places.items() if place < len(cells)}
    texts = {role: text.strip("[]()") for role, text in texts.items() if text.strip("[]()-")}
    known = {role for role, text in texts.items() if unit_named(role, text) is not None}
    if not known or any(_is_number(text) for text in texts.values()):
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


def beginning_of(content: bytes) -> list[str]:
    """First lines as text, without their ends; a last one that was cut is left out."""
    start = content[:_BEGINNING]
    if len(start) < len(content):
        whole = start[: start.rfind(b"\n") + 1]
        start = whole if whole.strip(MARK + b" \t\r\n") else content[: 2 * _LONGEST_HEADER]
    lines = start.decode("utf-8-sig", "replace").replace("\0", "").removesuffix("\n").split("\n")
    return [line.rstrip("\r") for line in lines[: _MOST_ABOVE + _MOST_BELOW]]


def _split_line(line: str, separator: str) -> list[str]:
    """Cells of one line; quotes around them are taken off."""
    if separator == " ":
        cells = [cell.strip('"') for cell in _SPACED.findall(line)]
        # The mark of a comment is no cell of its own.
        return ["".join(cells[:2]), *cells[2:]] if cells[:1] and cells[0] in _COMMENT else cells
    rows = csv.reader([line], delimiter=separator, skipinitialspace=True)
    try:
        return list(next(rows, ()))
    except csv.Error:  # a carriage return inside, or a cell without end
        return []


def _below(
    path: Path, lines: Sequence[str], header: int, separator: str, columns: LogColumns
) -> Table | None:
    """The table of the samples below a header, whose separator may be another."""
    above = [_split_line(line, separator) for line in lines[: header + 1]]
    for each in (separator, *(other for other in _SEPARATORS if other != separator)):
        below = [_split_line(line, each) for line in lines[header + 1 : header + 2 + _MOST_BETWEEN]]
        found = _laid_out(path, above, below, each, columns)
        if found is None:
            continue
        rows = lines[found.first :]
        cells = len(_split_line(rows[0], each))
        if cells <= len(above[header]):
            return replace(found, decimal=_decimal_of(path, found, rows, columns))
        if each == "," and cells >= 2 * len(found.names) - 1:
            raise InvalidInputError(
                path,
                f"is not a table of equally long rows: line {found.first + 1}, '{quote(rows[0])}',"
                f" has {cells} cells below {len(found.names)} names, as if commas stood between "
                "columns and before decimals",
                "Export it with semicolons or tabs between columns, or with decimal points",
            )
    return None


def _decimal_of(path: Path, table: Table, rows: Sequence[str], columns: LogColumns) -> Decimal:
    """What stands before decimals in the columns of the log. Raises InvalidInputError."""
    if columns.decimal is not None:
        return columns.decimal
    mark = '"' if table.separator == "," else ","
    if not any(mark in line for line in rows):
        return "point"
    places = sorted(table.places.values())
    doubtful = comma = point = ""
    for number, line in enumerate(rows, table.first + 1):
        row = _split_line(line, table.separator)
        for place in (place for place in places if place < len(row)):
            cell = row[place].strip()
            if _CLOCK.search(cell):
                continue
            name = quote(table.names[place])
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


def read_samples(path: Path, content: bytes, table: Table) -> Reading:
    """Columns by role of the samples of a table. Raises InvalidInputError."""
    start, separator = 0, table.separator
    for _ in range(table.first):
        start = content.find(b"\n", start) + 1 or len(content)
    refuse_long(path, content.count(b"\n", start))
    # Lines above a packed stream do not keep the reader of text from unpacking it.
    refuse_packed(path, content[start : start + 10])
    plain = _plain_numbers(content[start:], table) if len(content) <= _LARGEST_PLAIN else None
    if plain is not None:
        return Reading(values=plain, names=table.wanted, notes=table.notes)
    places = sorted(set(table.places.values()))
    named = content.count(separator.encode(), 0, start) >= len(table.names) - 1
    if table.first == 1 and separator != " " and named:
        # So that nobody holds the lines of a plain file twice.
        body, names = content, _parsed(content[:start], separator).columns
        stored = {place: names[place] for place in places}
        options: dict[str, Any] = {"columns": list(stored.values())}
    else:
        body, stored = content[start:], {place: str(place) for place in places}
        options = {"has_header": False, "columns": places, "new_columns": list(stored.values())}
    if separator == " " and (body.startswith((b" ", b"\t")) or any(run in body for run in _RUNS)):
        body = re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", body)
        body, separator = re.sub(rb"[ \t]+", b"\t", body), "\t"
    values, clock, blank = _numbers(path, body, separator, table, stored, **options)
    skipped = (f"{counted(blank, 'blank line')} left out",) if blank else ()
    notes = (*table.notes, *skipped)
    return Reading(values=values, names=table.wanted, notes=notes, in_seconds=clock)


def _plain_numbers(body: bytes, table: Table) -> dict[str, FloatArray] | None:
    """Columns by role if all cells are numbers with decimal points in even rows, else None."""
    body = body.replace(b"\r\n", b"\n").removesuffix(b"\n")
    if table.decimal == "comma" or not body or _OTHER.search(body):
        return None
    separator, places = table.separator, table.places
    cells = {line.count(separator.encode()) + 1 for line in body.split(b"\n")}
    if cells != {len(table.names)}:
        return None
    try:
        numbers = np.loadtxt(
            BytesIO(body), delimiter=separator, usecols=list(places.values()), ndmin=2
        )
    except ValueError:
        return None
    return {role: column.copy() for role, column in zip(places, numbers.T, strict=True)}


def _numbers(
    path: Path,
    content: bytes,
    separator: str,
    table: Table,
    stored: Mapping[int, str],
    **options: Any,
) -> tuple[dict[str, FloatArray], bool, int]:
    """Columns by role, an empty cell NaN; whether a clock tells time, in seconds; lines left out.

    Left out is a line with nothing in any of the columns. They have by their places the names they
    are ``stored`` by. A cell that is no number is refused by its row.
    """
    import polars as pl

    damaged = (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError)
    cells = None
    if table.decimal == "point":
        floats: dict[str, Any] = dict.fromkeys(stored.values(), pl.Float64)
        with suppress(*damaged):
            cells = _parsed(content, separator, schema_overrides=floats, **options)
    if cells is None:
        # Ten times slower and larger, but it tells spaces from words and names the cell.
        try:
            cells = _parsed(content, separator, **options)
        except damaged:
            where = f" below line {table.header + 1}" if table.header > 0 else ""
            problem = f"is not a table of equally long rows{where}"
            remedy = "Export it again as CSV with one header line"
            raise InvalidInputError(path, problem, remedy) from None
    values: dict[str, FloatArray] = {}
    clock, told = False, np.zeros(len(cells), dtype=bool)
    for role, place in table.places.items():
        column = cells[stored[place]]
        is_text = column.dtype == pl.String
        filled = column.str.contains(r"\S") if is_text else column.is_not_null()
        told |= filled.fill_null(value=False).to_numpy()
        if role == "time" and len(column) and _CLOCK.search(str(column[0])):
            clock, column = True, _seconds(column)
        name = table.wanted[role]
        values[role] = _column(path, name, column, table.first + 1, table.decimal)
    kept = {role: column[told] for role, column in values.items()}
    return kept, clock, len(told) - int(np.count_nonzero(told))


def _parsed(content: bytes, separator: str, **options: Any) -> polars.DataFrame:
    import polars as pl

    return pl.read_csv(
        BytesIO(content), separator=separator, infer_schema=False, encoding="utf8-lossy", **options
    )


def _seconds(cells: polars.Series) -> polars.Series:
    """Seconds of times of day, counted on past midnight; any day before them tells nothing more."""
    import polars as pl

    parts = cells.str.strip_chars().str.extract_groups(_CLOCK.pattern).struct.unnest()
    hour, minute, second, half = (parts[name] for name in parts.columns)
    hours = hour.fill_null("0").cast(pl.Float64)
    late = half.fill_null("").str.to_lowercase()
    twelve = hours % 12 + 12 * (late == "p").cast(pl.Float64)
    hours = twelve.zip_with(late != "", hours)
    seconds = second.str.replace("[,:]", ".").cast(pl.Float64)
    told = 3600 * hours + 60 * minute.cast(pl.Float64) + seconds
    return told + 86400 * (told.diff() < -43200).fill_null(value=False).cum_sum().cast(pl.Float64)


def _column(
    path: Path, name: str, cells: polars.Series, first: int, decimal: Decimal
) -> FloatArray:
    """A column of text or numbers as numbers, shape (rows,)."""
    import polars as pl

    numbers = cells
    if cells.dtype == pl.String:
        text = cells.str.strip_chars()
        if decimal == "comma":
            text = text.str.replace_all(".", "'", literal=True).str.replace(",", ".", literal=True)
        numbers = text.cast(pl.Float64, strict=False)
        wrong = (numbers.is_null() & text.is_not_null() & (text != "")).fill_null(value=False)
        found = wrong.arg_true()
        if found.len():
            row = int(found[0])
            raise InvalidInputError(
                path,
                f"column '{quote(name)}' holds '{quote(str(cells[row]))}' in row {row + first}, "
                f"which is not a number with a decimal {decimal}",
                "Write all numbers alike, leave missing cells empty, and delete rows of units, "
                "names or a summary",
            )
    return np.asarray(numbers.fill_null(float("nan")).to_numpy(), dtype=np.float64)
