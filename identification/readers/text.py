"""Text files: plain CSV at once, any other way to write a table once it is recognised.

Numbers alone are read without the table library, which takes longer to load.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.errors import InvalidInputError, QuestionError
from identification.readers.columns import (
    FloatArray,
    LogColumns,
    Reading,
    column_names,
    quote,
    refuse_long,
)
from identification.readers.tables import (
    CLOCK,
    COMMENT,
    FEWEST_COLUMNS,
    MOST_ABOVE,
    Decimal,
    Dialect,
    is_number,
    recognise,
    refuse_open_quote,
    refuse_wide,
    split_line,
)

if TYPE_CHECKING:
    import polars

#: Bytes of the first lines that are looked at before a file is read as plain, and among which a
#: header is looked for.
_BEGINNING = 100_000
#: Separators of plain files; the one most frequent in the header wins, the first of equals.
_SEPARATORS = ",;\t"
#: Bytes. Beyond it the time to load the table library is earned back.
_LARGEST_PLAIN = 8_000_000
#: Anything but numbers, separators and line ends.
_OTHER = re.compile(rb"[^0-9.eE+\-,;\t\n]")
#: What lines separated by single spaces do not hold.
_RUNS = (b"  ", b"\t", b"\n ", b" \n", b" \r")
#: Rows that units may take below the header, and a summary at the end.
_MOST_UNITS = 3
_MOST_SUMMARY = 10
#: What the table library adds to the name of another column of one name.
_SECOND = re.compile(r"_duplicated_\d+$")
#: How packed streams begin; a reader of text would unpack some of them by itself.
_PACKED = {
    b"\x1f\x8b": "gzip",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"\x78\x01": "zlib",
    b"\x78\x5e": "zlib",
    b"\x78\x9c": "zlib",
    b"\x78\xda": "zlib",
    b"PK\x03\x04": "zip or spreadsheet",
    b"\xfd7zXZ\x00": "xz",
    b"BZh": "bzip2",
}
#: The mark that UTF-8 text may begin with; those of text of two or four bytes a letter, the longer
#: first.
_MARK = b"\xef\xbb\xbf"
_WIDE_MARKS = {
    b"\xff\xfe\x00\x00": "utf-32",
    b"\x00\x00\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
#: Bytes looked at for text of two bytes a letter without a mark.
_WIDE_SAMPLE = 1000
#: Bytes that hold the header, in which letters beyond ASCII stand.
_HEADER_BYTES = 10_000


def read_text(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role; empty cells are NaN. Raises InvalidInputError."""
    # Before letters of another encoding are made of the bytes that tell a packed file.
    _refuse_packed(path, content)
    content, notes = _as_utf8(path, content)
    _refuse_zeros(path, content)
    alone = _table_alone(content)
    asked = {columns.time, columns.force, columns.position}
    headless = alone is not None and alone[:5] in (b"1,2,3", b"1;2;3", b"1\t2\t3")
    counted = headless and any(map(str.isdecimal, asked))
    try:
        reading = _read_table(path, alone if alone and counted else content, columns)
    except InvalidInputError as error:
        asks = isinstance(error, QuestionError)
        if alone is None or not (asks or content.startswith(b"#")):
            raise
        try:
            reading = _read_table(path, alone, columns)
        except InvalidInputError as below:
            # What is wrong with the whole file says more than what is wrong below its comments.
            raise below if asks or headless or isinstance(below, QuestionError) else error from None
    return replace(reading, notes=(*notes, *reading.notes)) if notes else reading


def _read_table(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role of text in UTF-8 with line feeds."""
    if columns.decimal != "comma" and _is_plain(path, content, columns):
        try:
            return read_csv(path, content, columns)
        except InvalidInputError:
            other = _read_recognised(path, content, columns)
            if other is None:
                raise
            return other
    return _read_recognised(path, content, columns) or read_csv(path, content, columns)


def _table_alone(content: bytes) -> bytes | None:
    """A table from the line that seems to name its columns on; None where that is the first.

    Above one that begins with samples is put a line that counts its columns.
    """
    start, above = 0, list[tuple[int, str]]()
    for line in BytesIO(content[:_BEGINNING]):
        text = line.decode("utf-8-sig", "replace").strip("\r\n")
        for separator in "\t;, ":
            cells = split_line(text, separator)
            if sum(map(is_number, cells)) < max(FEWEST_COLUMNS, len(cells) - 1):
                continue
            begins = [at for at, each in above if len(split_line(each, separator)) >= len(cells)]
            if not begins and all(each.startswith(COMMENT) for _, each in above):
                names = ("\t" if separator == " " else separator).join(
                    str(place) for place in range(1, len(cells) + 1)
                )
                return f"{names}\n".encode() + content[start:].removeprefix(_MARK)
            return content[begins[-1] :] if begins and begins[-1] else None
        if text.strip():
            above.append((start, text))
        start += len(line)
    return None


def _refuse_packed(path: Path, content: bytes) -> None:
    """Refuse a packed stream where text is expected."""
    for beginning, kind in _PACKED.items():
        if content.startswith(beginning):
            raise InvalidInputError(
                path, f"is a packed file ({kind}), not text", "Unpack it, and give what was in it"
            )


def _as_utf8(path: Path, content: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Text as UTF-8 with line feeds, and what was understood; text that is so is not copied."""
    encoding = _wide_encoding(content)
    notes: tuple[str, ...] = ()
    if encoding:
        name = encoding[:6].upper()
        try:
            # Letters that hold no text are refused as bytes, by what reads the lines.
            content = content.decode(encoding).encode()
        except UnicodeDecodeError as error:
            problem = f"begins as {name} text, and byte {error.start} is none"
            remedy = "Save it as UTF-8 (CSV UTF-8 in Excel)"
            raise InvalidInputError(path, problem, remedy) from None
        notes = (f"{name} text",)
    elif not _is_utf8(content[:_HEADER_BYTES]):
        # Degrees and micro are the letters in question, which stand alike in Latin-1.
        content, notes = content.decode("cp1252", "replace").encode(), ("Windows-1252 text",)
    if b"\n" not in content and b"\r" in content:
        return content.replace(b"\r", b"\n"), (*notes, "lines that end in CR")
    return content, notes


def _is_utf8(start: bytes) -> bool:
    """Whether a beginning is UTF-8, its last letter perhaps cut."""
    try:
        start.decode()
    except UnicodeDecodeError as error:
        return error.reason == "unexpected end of data"
    return True


def _wide_encoding(content: bytes) -> str:
    """Name of an encoding of two or four bytes a letter; "" for another."""
    for mark, name in _WIDE_MARKS.items():
        if content.startswith(mark):
            return name
    start = content[:_WIDE_SAMPLE]
    pairs = len(start) // 2
    for side, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        letters, zeros = start[1 - side : 2 * pairs : 2], start[side : 2 * pairs : 2]
        if pairs and zeros.count(0) == pairs and letters.count(0) == 0:
            return name
    return ""


def _refuse_zeros(path: Path, content: bytes) -> None:
    """Refuse text with NUL bytes, naming the line of the first."""
    first = content.find(b"\0")
    if first < 0:
        return
    count = content.count(b"\0")
    line = content.count(b"\n", 0, first) + 1
    raise InvalidInputError(
        path,
        f"holds {count} NUL byte{'' if count == 1 else 's'}, the first in line {line}: it is "
        "no text, or was cut off while it was written",
        "Log or export it again" + (f", or keep the lines before line {line}" * (line > 1)),
    )


def _is_plain(path: Path, content: bytes, columns: LogColumns) -> bool:
    """Whether the first line names the columns and the next holds numbers with decimal points."""
    lines = [line for line in BytesIO(content[:_BEGINNING]).readlines() if line.strip()][:2]
    try:
        header, *others = (line.decode("utf-8-sig").strip("\r\n") for line in lines)
        separator = max(_SEPARATORS, key=header.count)
        names = [name.strip(' \t"#%') for name in header.split(separator)]
        wanted = column_names(path, columns, names, table=True)
        places = [names.index(name) for name in wanted.values()]
        for line in others:
            cells = line.split(separator)
            if len(cells) > len(names):
                return False
            for cell in (cells[place].strip(' \t"') for place in places if place < len(cells)):
                float(cell or 0)
    except (ValueError, InvalidInputError):
        return False
    return True


def read_csv(path: Path, content: bytes, columns: LogColumns) -> Reading:
    """Columns by role of plain CSV; empty cells are NaN. Raises InvalidInputError."""
    _refuse_packed(path, content)
    refuse_long(path, content.count(b"\n") - 1)
    # The first line with a name: with more than its end, and the mark of a file in UTF-8.
    header = next((line for line in BytesIO(content) if line.strip(_MARK + b"\r\n")), b"")
    refuse_open_quote(path, header)
    separator = max(_SEPARATORS, key=lambda mark: header.count(mark.encode()))
    refuse_wide(path, header, header.count(separator.encode()) + 1)
    reading = read_plain_numbers(path, content, separator, columns)
    return reading or _read_cells(path, content, header, separator, columns)


def read_plain_numbers(
    path: Path, content: bytes, separator: str, columns: LogColumns
) -> Reading | None:
    """Columns by role of a table whose every cell is a number with a decimal point.

    None for a table that is larger or not as plain: quotes, repeated or missing names, rows of
    other lengths, empty cells or cells that are no number.
    """
    if len(content) > _LARGEST_PLAIN:
        return None
    header, _, body = content.removeprefix(_MARK).partition(b"\n")
    body = body.replace(b"\r\n", b"\n").removesuffix(b"\n")
    if not body or b'"' in header or _OTHER.search(body):
        return None
    try:
        names = [name.strip("#% ") for name in header.decode().strip("\r").split(separator)]
        wanted = column_names(path, columns, names, table=True)
        cells = {line.count(separator.encode()) + 1 for line in body.split(b"\n")}
        if len(set(names)) < len(names) or cells != {len(names)}:
            return None
        places = [names.index(name) for name in wanted.values()]
        table = np.loadtxt(BytesIO(body), delimiter=separator, usecols=places, ndmin=2)
    except (InvalidInputError, ValueError):
        return None
    values = {role: column.copy() for role, column in zip(wanted, table.T, strict=True)}
    return Reading(values=values, names=wanted)


def _read_cells(
    path: Path, content: bytes, header: bytes, separator: str, columns: LogColumns
) -> Reading:
    """Columns by role of plain CSV whose cells may be quoted, empty or no numbers."""
    stored = _text_table(path, header, separator, n_rows=0).columns
    # A header line that begins with # comes from loggers that mark it as a comment.
    # The second is the reader's own name for another column of one name.
    own = b"_duplicated_" in header
    shown = [(name if own else _SECOND.sub("", name)).strip("#% ") for name in stored]
    if not {columns.time, columns.force, columns.position} <= set(shown):
        _refuse_preamble(path, content, separator, columns)
    wanted = column_names(path, columns, shown, table=True)
    for name in wanted.values():
        if shown.count(name) > 1:
            raise InvalidInputError(
                path, f"has two columns named '{quote(name)}'", "Rename one of them"
            )
    stored_as = dict(zip(shown, stored, strict=True))
    names = list(dict.fromkeys(stored_as[name] for name in wanted.values()))
    values, clock = _numbers(path, content, separator, wanted, stored_as, columns=names)
    return Reading(values=values, names=wanted, in_seconds=clock)


def _read_recognised(path: Path, content: bytes, columns: LogColumns) -> Reading | None:
    """The file in the dialect it is seen to be in; None where that is plain or not seen."""
    dialect = recognise(path, content, columns)
    plain = dialect is None or (dialect.decimal == "point" and not dialect.layout.notes)
    if dialect is None or (plain and dialect.separator != " " and dialect.layout.header == 0):
        return None
    return _read_delimited(path, content, dialect)


def _read_delimited(path: Path, content: bytes, dialect: Dialect) -> Reading:
    """Columns by role of a table in another dialect than plain CSV."""
    layout, separator = dialect.layout, dialect.separator
    start = 0
    for _ in range(layout.first):
        start = content.index(b"\n", start) + 1
    body = content[start:]
    # Lines above a packed stream do not keep the reader of text from unpacking it.
    _refuse_packed(path, body)
    refuse_long(path, body.count(b"\n"))
    if separator == " " and (body.startswith((b" ", b"\t")) or any(run in body for run in _RUNS)):
        body = re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", body)
        body, separator = re.sub(rb"[ \t]+", b"\t", body), "\t"
    places = sorted(set(layout.places.values()))
    names = [layout.names[place] for place in places]
    values, clock = _numbers(
        path,
        body,
        separator,
        layout.wanted,
        dict(zip(names, names, strict=True)),
        first=layout.first + 1,
        decimal=dialect.decimal,
        where=f" below line {layout.header + 1}",
        has_header=False,
        columns=places,
        new_columns=names,
    )
    return Reading(values=values, names=layout.wanted, notes=dialect.notes, in_seconds=clock)


def _numbers(
    path: Path,
    content: bytes,
    separator: str,
    wanted: Mapping[str, str],
    stored: Mapping[str, str],
    *,
    first: int = 2,
    decimal: Decimal = "point",
    where: str = "",
    **options: Any,
) -> tuple[dict[str, FloatArray], bool]:
    """Columns by role, an empty cell NaN, and whether time is told by a clock, in seconds.

    A cell that is no number is refused by its row.

    Columns ``wanted`` have the names by which they are ``stored`` in the table; its first row is
    row ``first`` of the file.
    """
    import polars as pl

    table = None
    if decimal == "point":
        floats: dict[str, Any] = {stored[name]: pl.Float64 for name in wanted.values()}
        with suppress(*_damaged()):
            table = _parsed(content, separator, schema_overrides=floats, **options)
    if table is None:
        # Ten times slower and larger, but it tells spaces from words and names the cell.
        table = _text_table(path, content, separator, where, **options)
        _refuse_other_rows(path, table.with_columns(_as_pointed(pl.all(), decimal)), first)
    values: dict[str, FloatArray] = {}
    clock = False
    for role, name in wanted.items():
        cells = table[stored[name]]
        clock = clock or (role == "time" and _is_clock(cells))
        told = _seconds(cells) if clock and role == "time" else cells
        values[role] = _column(path, name, told, first, decimal)
    return values, clock


def _is_clock(cells: polars.Series) -> bool:
    """Whether the first cell is a time of day."""
    return bool(len(cells)) and isinstance(cells[0], str) and CLOCK.search(cells[0]) is not None


def _seconds(cells: polars.Series) -> polars.Series:
    """Seconds of times of day, counted on past midnight; any day before them tells nothing more."""
    import polars as pl

    parts = cells.str.strip_chars().str.extract_groups(CLOCK.pattern).struct.unnest()
    hour, minute, second, half = (parts[name] for name in parts.columns)
    hours = hour.fill_null("0").cast(pl.Float64)
    late = half.fill_null("").str.to_lowercase()
    twelve = hours % 12 + 12 * (late == "p").cast(pl.Float64)
    hours = twelve.zip_with(late != "", hours)
    seconds = second.str.replace("[,:]", ".").cast(pl.Float64)
    told = 3600 * hours + 60 * minute.cast(pl.Float64) + seconds
    return told + 86400 * (told.diff() < -43200).fill_null(value=False).cum_sum().cast(pl.Float64)


def _damaged() -> tuple[type[BaseException], ...]:
    """What the table library raises for text that is no table."""
    import polars as pl

    return (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError)


def _parsed(content: bytes, separator: str, **options: Any) -> polars.DataFrame:
    import polars as pl

    return pl.read_csv(
        BytesIO(content),
        separator=separator,
        infer_schema=False,
        encoding="utf8-lossy",
        **options,
    )


def _text_table(
    path: Path, content: bytes, separator: str, where: str = "", **options: Any
) -> polars.DataFrame:
    """The table as text. Raises InvalidInputError where it is none."""
    try:
        return _parsed(content, separator, **options)
    except _damaged():
        problem = f"is not a table of equally long rows{where}"
        remedy = "Export it again as CSV with one header line"
        raise InvalidInputError(path, problem, remedy) from None


def _as_pointed(cells: Any, decimal: Decimal) -> Any:
    """Text without spaces around it, and with decimal points, of a polars column or expression."""
    text = cells.str.strip_chars()
    if decimal == "point":
        return text
    return text.str.replace_all(".", "'", literal=True).str.replace(",", ".", literal=True)


def _column(
    path: Path, name: str, cells: polars.Series, first: int, decimal: Decimal
) -> FloatArray:
    """A column of text or numbers as numbers, shape (rows,)."""
    import polars as pl

    numbers = cells
    if cells.dtype == pl.String:
        text = _as_pointed(cells, decimal)
        numbers = text.cast(pl.Float64, strict=False)
        wrong = (numbers.is_null() & text.is_not_null() & (text != "")).fill_null(value=False)
        found = wrong.arg_true()
        if found.len():
            row = int(found[0])
            raise InvalidInputError(
                path,
                f"column '{quote(name)}' holds '{quote(str(cells[row]))}' in row {row + first}, "
                f"which is not a number with a decimal {decimal}",
                "Write all numbers alike, and leave missing cells empty",
            )
    return np.asarray(numbers.fill_null(float("nan")).to_numpy(), dtype=np.float64)


def _refuse_preamble(path: Path, content: bytes, separator: str, columns: LogColumns) -> None:
    """Refuse a header that stands further down, or a first line that is a comment."""
    asked = {columns.time, columns.force, columns.position, columns.reference} - {None}
    lines = content[:_BEGINNING].decode("utf-8-sig", "replace").splitlines()[:MOST_ABOVE]
    for above, line in enumerate(lines):
        # Lines above a header tell nothing of its separator.
        most = max(_SEPARATORS, key=line.count)
        names = {cell.strip(" \t\"'#") for cell in line.split(most if most in line else separator)}
        if above and asked <= names:
            raise InvalidInputError(
                path,
                f"has {above} line{'' if above == 1 else 's'} above its header, which stands in "
                f"line {above + 1}; the first is '{quote(lines[0])}'",
                "Delete the lines above the header",
            )
    first = lines[0] if lines else ""
    if first.startswith("#") and len(first.split(separator)) < FEWEST_COLUMNS:
        raise InvalidInputError(
            path,
            f"begins with a comment, '{quote(first)}', where the names of the columns should be",
            "Delete the lines above the header",
        )


def _refuse_other_rows(path: Path, table: polars.DataFrame, first: int) -> None:
    """Refuse rows of units below the header and rows of a summary at the end of a table of text."""
    import polars as pl

    cells = pl.all().str.strip_chars()
    is_word = cells.cast(pl.Float64, strict=False).is_null() & cells.str.contains("[[:alpha:]]")
    is_word = is_word & ~cells.str.contains(CLOCK.pattern)
    words = table.select(pl.any_horizontal(is_word.fill_null(value=False))).to_series()
    rows = len(words)
    top = next((row for row in range(min(rows, _MOST_UNITS + 1)) if not words[row]), rows)
    if 0 < top <= _MOST_UNITS:
        raise InvalidInputError(
            path,
            f"holds {_words_of(table.head(top))} in row {first}, below the header: units or "
            "names, no numbers",
            f"Delete {_rows_named(first, top)}; --force-gain and --position-gain convert units to "
            "SI",
        )
    end = next((k for k in range(min(rows, _MOST_SUMMARY + 1)) if not words[rows - 1 - k]), rows)
    if 0 < end <= _MOST_SUMMARY:
        raise InvalidInputError(
            path,
            f"ends with {_words_of(table.tail(end))} in row {rows - end + first}, below the "
            "samples: a summary, no sample",
            f"Delete {_rows_named(rows - end + first, end)}",
        )


def _words_of(rows: polars.DataFrame) -> str:
    """The cells of the first row that hold letters."""
    cells = [(cell or "").strip() for cell in rows.row(0)]
    found = [cell for cell in cells if any(letter.isalpha() for letter in cell)]
    return ", ".join(f"'{quote(cell)}'" for cell in found)


def _rows_named(first: int, count: int) -> str:
    return f"row {first}" if count == 1 else f"rows {first} to {first + count - 1}"
