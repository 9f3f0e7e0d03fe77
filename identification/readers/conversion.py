"""What makes the columns of a log SI: gains that were given, units that stand in their names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from identification.errors import InvalidInputError
from identification.readers.columns import LogColumns, Reading, quote
from identification.readers.header_units import Unit, split_name, unit_named
from identification.trajectory import Motion

#: A gain this part off the unit in the name contradicts it: 0.0174533 is degrees, 0.0175 is not.
_SAME = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Conversion:
    """What makes the columns of a file SI.

    Attributes:
        gains: by role, what the column is multiplied with.
        stated: of "force" and "position", those whose unit a person or the file stated.
        notes: what was understood from names, in words.
    """

    gains: Mapping[str, float]
    stated: frozenset[str]
    notes: tuple[str, ...]


def conversion_of(
    path: Path, reading: Reading, columns: LogColumns, motion: Motion | None
) -> Conversion:
    """What the columns found are multiplied with: by gains given, else by units in their names.

    Args:
        path: the file, for messages.
        reading: what it holds, with the names of its columns.
        columns: what the user asked for.
        motion: of the axis, if anybody stated it.

    Raises:
        InvalidInputError: a unit that is not known, that depends on the device, that is not of the
            axis's motion, or that contradicts the gain given.
    """
    names = reading.names
    units = {
        role: None if role == "time" and reading.in_seconds else _unit_of(path, role, name, columns)
        for role, name in names.items()
    }
    _refuse_two_motions(path, names, units, columns, motion)
    gains: dict[str, float] = {}
    notes: list[str] = []
    for role, name in names.items():
        unit, given = units[role], _given(role, columns)
        if given is not None:
            _refuse_contradiction(path, role, name, unit, given, motion)
        named = unit.size if unit else None
        gains[role] = given if given is not None else 1.0 if named is None else named
        if role == "reference" and given is None and unit is None:
            gains[role] = gains["position"]
        if unit is not None or name != getattr(columns, role):
            words = f"{role} from '{quote(name)}'"
            notes.append(words + (f" times {gains[role]:.6g}" if gains[role] != 1 else ""))
    known = {role for role in ("force", "position") if role in names and units[role] is not None}
    return Conversion(
        gains=gains, stated=columns.stated_units | frozenset(known), notes=tuple(notes)
    )


def _option(role: str) -> str:
    """The option that gives the gain of a role."""
    return f"--{'position' if role == 'reference' else role}-gain"


def _given(role: str, columns: LogColumns) -> float | None:
    return {
        "time": columns.time_gain,
        "force": columns.force_gain,
        "position": columns.position_gain,
        "reference": columns.position_gain,
    }[role]


def _si(role: str) -> str:
    return {"time": "s", "force": "N (N·m)"}.get(role, "m (rad)")


def _unit_of(path: Path, role: str, name: str, columns: LogColumns) -> Unit | None:
    """The unit in a column's name; None if it has none, or one that a gain makes known."""
    text = split_name(role, name)[1]
    if text is None:
        return None
    unit, given = unit_named(role, text), _given(role, columns)
    if given is not None or (unit is not None and unit.size is not None):
        return unit
    kind = "is no unit of it that is known" if unit is None else "depends on the device"
    how = ""
    if role == "force" and unit is not None and unit.text.lower() in {"a", "ma", "amp", "ampere"}:
        how = ", torque constant times transmission"
    raise InvalidInputError(
        path,
        f"column '{quote(name)}' states its unit as '{quote(text)}', which {kind}",
        f"Add {_option(role)} X: {_si(role)} per unit of the column{how}",
    )


def _refuse_contradiction(
    path: Path, role: str, name: str, unit: Unit | None, given: float, motion: Motion | None
) -> None:
    """Refuse a gain that is not the size of the unit in the name, whichever its sign.

    Between angles and a linear axis, or the other way round, lies a transmission: any gain may be.
    """
    if unit is None or unit.size is None or abs(abs(given) / unit.size - 1) <= _SAME:
        return
    if motion is not None and unit.motion not in {None, motion}:
        return
    raise InvalidInputError(
        path,
        f"column '{quote(name)}' states its unit as '{unit.text}', {unit.size:.6g} {_si(role)}, "
        f"and {_option(role)} {given:g} contradicts it",
        f"Leave out {_option(role)}, give {math.copysign(unit.size, given):.6g}, or rename the "
        "column if its unit is wrong",
    )


def _refuse_two_motions(
    path: Path,
    names: Mapping[str, str],
    units: Mapping[str, Unit | None],
    columns: LogColumns,
    motion: Motion | None,
) -> None:
    """Refuse a unit of another motion than the axis's, or than that of the other column."""
    meant = motion
    for role, unit in units.items():
        kind = None if unit is None or _given(role, columns) is not None else unit.motion
        if unit is None or kind is None:
            continue
        if meant is not None and kind != meant:
            who = "the axis is" if motion is not None else "another column's unit is"
            raise InvalidInputError(
                path,
                f"column '{quote(names[role])}' is in {unit.text}, a unit of {kind} motion, and "
                f"{who} {meant}",
                f"Add {_option(role)} X, {_si(role)} per {unit.text} through the transmission, or "
                "state the right motion in the hardware file",
            )
        meant = kind
