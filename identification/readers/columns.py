"""Which columns of a file are what, and the sentences about columns that are not there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.errors import InvalidInputError
from identification.readers.header_units import WORDS, split_name, unit_named

FloatArray = NDArray[np.float64]

#: Column names listed in a message at most; a wrong file may have thousands.
_MOST_NAMED = 20
#: Characters of a file's own text quoted in a message at most.
_LONGEST_QUOTE = 40
#: The column a table may have without being asked for it.
_DEFAULT_REFERENCE = "reference"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What a file holds of a log.

    Attributes:
        values: columns by role, in the units of the file, each of shape (rows,).
        names: of these columns in the file, units and all.
        notes: what had to be understood before the file was a table, in words.
        in_seconds: time comes from dates or durations, which carry their own unit.
    """

    values: dict[str, FloatArray]
    names: dict[str, str]
    notes: tuple[str, ...] = ()
    in_seconds: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LogColumns:
    """Which columns of a file are what, and the factors that make them SI.

    Attributes:
        time: column that, times ``time_gain``, is in s; in Parquet and NPZ files a date and time or
            a duration as well.
        force: column that, times ``force_gain``, is the force on the device in N (N·m).
        position: column that, times ``position_gain``, is the position in m (rad).
        reference: set-point column in the unit of position; None takes a column named
            ``reference`` of a CSV or Parquet file if there is one. MAT and NPZ files hold arrays
            of any meaning, so there it has to be named.
        time_gain: s per unit of the column, e.g. 0.001. None takes the unit in the column's name,
            else s.
        force_gain: e.g. N per volt; negative turns the direction. None takes the unit in the
            column's name, else N (N·m); 1 states that it is.
        position_gain: e.g. m per count; applies to reference as well. None takes the unit in the
            column's name, else m (rad); 1 states that it is.
        axis: name of the axis; None means "x".
        decimal: "comma" or "point", what stands before the decimals of a text file; None takes what
            its cells leave no doubt about.

    Raises:
        InvalidInputError: a gain that is zero, infinite or not a number.
    """

    time: str = "time"
    force: str = "force"
    position: str = "position"
    reference: str | None = None
    time_gain: float | None = None
    force_gain: float | None = None
    position_gain: float | None = None
    axis: str | None = None
    decimal: Literal["comma", "point"] | None = None

    @property
    def stated_units(self) -> frozenset[str]:
        """Roles whose gain a person gave, be it 1."""
        gains = {"force": self.force_gain, "position": self.position_gain}
        return frozenset(role for role, gain in gains.items() if gain is not None)

    def __post_init__(self) -> None:
        for name in ("time_gain", "force_gain", "position_gain"):
            gain = getattr(self, name)
            if gain is not None and (not math.isfinite(gain) or gain == 0):
                raise InvalidInputError(
                    "--" + name.replace("_", "-"),
                    f"is {gain:g}, not a finite number other than zero",
                    "Give what one unit of the column is in SI units",
                )


def column_names(
    path: Path, columns: LogColumns, present: Sequence[str], *, table: bool
) -> dict[str, str]:
    """Role (time, force, position and perhaps reference) to the column's name in the file.

    Args:
        path: the file, for the message.
        columns: what the user asked for.
        present: what the file has.
        table: the file is one table of equally long columns, so that a column named ``reference``
            belongs to the log.

    Raises:
        InvalidInputError: names the file does not have, with those it has; several columns that
            may be meant.
    """
    asked = {"time": columns.time, "force": columns.force, "position": columns.position}
    if columns.reference is not None or table:
        asked["reference"] = columns.reference or _DEFAULT_REFERENCE
    found = {
        role: column_for(path, role, name, present, words=table) for role, name in asked.items()
    }
    if columns.reference is None and found.get("reference") is None:
        found.pop("reference", None)
    wanted = {role: name for role, name in found.items() if name is not None}
    missing = {role: asked[role] for role, name in found.items() if name is None}
    if missing:
        named = ", ".join(f"'{quote(name)}'" for name in missing.values())
        listed = ", ".join(quote(name) for name in present[:_MOST_NAMED])
        more = f" and {len(present) - _MOST_NAMED} more" if len(present) > _MOST_NAMED else ""
        raise InvalidInputError(
            path,
            f"has no column {named}; it has: {listed or 'none'}{more}",
            "Name the right column with "
            + ", ".join(f"--{role}" for role in missing)
            + _suggested([name for name in present if name not in wanted.values()], tuple(missing)),
        )
    return wanted


def _suggested(present: Sequence[str], missing: Sequence[str]) -> str:
    """Options that take the columns left: by their units, or in the usual order if none has one."""
    found = [
        f'--{role} "{quote(name)}"'
        for role in missing
        for name in present[:_MOST_NAMED]
        if unit_named(role, split_name(role, name)[1] or "") is not None
    ]
    if found or len(present) != len(missing):
        return f", perhaps {' or '.join(found[:3])}" if found else ""
    in_order = (f'--{role} "{quote(name)}"' for role, name in zip(missing, present, strict=True))
    return f", perhaps {' '.join(in_order)}"


def column_for(
    path: Path, role: str, asked: str, present: Sequence[str], *, words: bool
) -> str | None:
    """The column of a role: of the name asked for, of that with a unit, or of another word for it.

    Args:
        path: the file, for the message.
        role: "time", "force", "position" or "reference".
        asked: name the user gave, or the role itself.
        present: names in the file.
        words: whether other words for the role count where the user gave no name.

    Returns:
        A name in the file; None if there is none.

    Raises:
        InvalidInputError: several columns may be meant.
    """
    if asked in present:
        return asked
    stems = {name: split_name(role, name)[0] for name in present}
    found = [name for name, stem in stems.items() if stem == asked]
    if not found and words and asked == role and role != "reference":
        found = [name for name, stem in stems.items() if stem.casefold() in WORDS[role]]
    if len(found) > 1:
        raise InvalidInputError(
            path,
            f"has several columns that may be the {role}: "
            + ", ".join(f"'{quote(name)}'" for name in found[:10]),
            f'Name the right one, such as --{role} "{quote(found[0])}"',
        )
    return found[0] if found else None


def quote(text: str) -> str:
    """A file's own text, safe and short enough to print."""
    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    return printable if len(printable) <= _LONGEST_QUOTE else printable[:_LONGEST_QUOTE] + "…"


def first_words(error: BaseException) -> str:
    """A library's complaint in one line short enough to print, with the kind of error."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]
