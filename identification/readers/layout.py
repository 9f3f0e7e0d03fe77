"""Where the header and the samples of a table stand, among titles, comments and rows of units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, column_names, quote
from identification.readers.header_units import split_name, unit_named

#: What marks a line as a comment.
COMMENT = ("#", "%", "//")
#: Characters around a name that do not belong to it.
_AROUND = " \t\"'#%/\ufeff"
#: Columns of the shortest header: time, force, position.
_FEWEST_COLUMNS = 3
#: Rows of units or comments between the header and the samples.
MOST_BETWEEN = 10
#: A number, with a decimal point or comma; digits may be grouped.
_NUMBER = re.compile(
    r"[+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE
)

Row = Sequence[str]


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


def is_number(cell: str) -> bool:
    """Whether a cell reads as a number, whatever its decimal mark."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def named_by(row: Row) -> tuple[str, ...]:
    """Names that a row of cells gives its columns."""
    return tuple(cell.strip(_AROUND) for cell in row)


def roles_of(path: Path, row: Row, columns: LogColumns) -> dict[str, str] | None:
    """Columns of the log by role if a row of cells names all of them, else None."""
    names = named_by(row)
    if len(names) < _FEWEST_COLUMNS:
        return None
    try:
        wanted = column_names(path, columns, names, table=True)
    except InvalidInputError:
        return None
    return wanted if all(names.count(name) == 1 for name in wanted.values()) else None


def find_layout(
    path: Path,
    above: Sequence[Row],
    below: Sequence[Row],
    columns: LogColumns,
) -> Layout | None:
    """Layout of a table whose header is known.

    Args:
        path: the file, for messages.
        above: rows above the header, and the header as the last.
        below: rows below it, the first at least.
        columns: what the user asked for.

    Returns:
        The layout; None where rows around the header are neither comments nor units.

    Raises:
        InvalidInputError: a row of units of which one is not known, or contradicts the header.
    """
    header = len(above) - 1
    wanted = roles_of(path, above[header], columns)
    if wanted is None:
        return None
    names = list(named_by(above[header]))
    places = {role: names.index(name) for role, name in wanted.items()}
    if any(is_sample(row, range(len(row))) for row in above[:header]):
        return None  # samples above a header are of another log
    first = next(
        (k for k, row in enumerate(below[: MOST_BETWEEN + 1]) if is_sample(row, places.values())),
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


def is_sample(row: Row, places: Iterable[int]) -> bool:
    """Whether the cells at these places are numbers, none but one missing."""
    cells = [row[place].strip() for place in places if place < len(row)]
    missing = cells.count("")
    return (
        len(cells) >= _FEWEST_COLUMNS
        and missing <= 1
        and all(is_number(cell) for cell in cells if cell)
    )


def _is_comment(row: Row) -> bool:
    text = "".join(row).strip()
    return not text or text.startswith(COMMENT)


def _units_in(
    path: Path, row: Row, places: dict[str, int], columns: LogColumns
) -> dict[str, str] | None:
    """Units by role that a row states; None for a row of something else.

    Raises:
        InvalidInputError: one of its cells is no unit that is known, and no gain makes it known.
    """
    cells = named_by(row)
    texts = {role: cells[place] for role, place in places.items() if place < len(cells)}
    texts = {role: text.strip("[]()") for role, text in texts.items() if text.strip("[]()-")}
    known = {role for role, text in texts.items() if unit_named(role, text) is not None}
    if not known or any(is_number(text) for text in texts.values()):
        return None
    gains = {
        "time": columns.time_gain,
        "force": columns.force_gain,
        "position": columns.position_gain,
        "reference": columns.position_gain,
    }
    for role, text in texts.items():
        if role not in known and gains[role] is None:
            option = "position" if role == "reference" else role
            raise InvalidInputError(
                path,
                f"has a row of units, and '{quote(text)}' is no unit of {role} that is known",
                f"Add --{option}-gain X, what one of it is in SI units",
            )
    return texts


def _with_unit(path: Path, role: str, name: str, text: str) -> str:
    """The name of a column with the unit of the row below. Raises InvalidInputError."""
    stem, own = split_name(role, name)
    if own is None:
        return f"{stem} [{text}]"
    mine, other = unit_named(role, own), unit_named(role, text)
    if mine != other and (mine is None or other is None or mine.size != other.size):
        raise InvalidInputError(
            path,
            f"column '{quote(name)}' has '{quote(text)}' in the row of units",
            "Delete the one that is wrong",
        )
    return name
