"""Which columns of a file are what, and the sentences about columns that are not there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identification.errors import InvalidInputError

FloatArray = NDArray[np.float64]

#: Column names listed in a message at most; a wrong file may have thousands.
_MOST_NAMED = 20
#: Characters of a file's own text quoted in a message at most.
_LONGEST_QUOTE = 40
#: The column a table may have without being asked for it.
_DEFAULT_REFERENCE = "reference"


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
        time_gain: s per unit of the column, e.g. 0.001.
        force_gain: e.g. N per volt; negative turns the direction. None takes the column for N
            (N·m), 1 states that it is.
        position_gain: e.g. m per count; applies to reference as well. None takes the column for m
            (rad), 1 states that it is.
        axis: name of the axis; None means "x".

    Raises:
        InvalidInputError: a gain that is zero, infinite or not a number.
    """

    time: str = "time"
    force: str = "force"
    position: str = "position"
    reference: str | None = None
    time_gain: float = 1.0
    force_gain: float | None = None
    position_gain: float | None = None
    axis: str | None = None

    @property
    def gains(self) -> dict[str, float]:
        """What the column of each role is multiplied with."""
        place = 1.0 if self.position_gain is None else self.position_gain
        return {
            "time": self.time_gain,
            "force": 1.0 if self.force_gain is None else self.force_gain,
            "position": place,
            "reference": place,
        }

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


def wanted_columns(
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
        InvalidInputError: names the file does not have; says which it has.
    """
    wanted = {"time": columns.time, "force": columns.force, "position": columns.position}
    if columns.reference is not None:
        wanted["reference"] = columns.reference
    elif table and _DEFAULT_REFERENCE in present:
        wanted["reference"] = _DEFAULT_REFERENCE
    missing = {role: name for role, name in wanted.items() if name not in present}
    if missing:
        named = ", ".join(f"'{quoted(name)}'" for name in missing.values())
        listed = ", ".join(quoted(name) for name in present[:_MOST_NAMED])
        more = f" and {len(present) - _MOST_NAMED} more" if len(present) > _MOST_NAMED else ""
        raise InvalidInputError(
            path,
            f"has no column {named}; it has: {listed or 'none'}{more}",
            "Name the right column with " + ", ".join(f"--{role}" for role in missing),
        )
    return wanted


def quoted(text: str) -> str:
    """A file's own text, safe and short enough to print."""
    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    return printable if len(printable) <= _LONGEST_QUOTE else printable[:_LONGEST_QUOTE] + "…"


def first_words(error: BaseException) -> str:
    """A library's complaint in one line short enough to print, with the kind of error."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]
