"""Collinearity: columns scaled to one size, and those of them that a motion can tell apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Always part of the model, never judged.
ALWAYS = ("mass", "damping")
#: Columns of a constant force and of the position.
OFFSET, POSITION = "force_offset", "position_stiffness"
#: Stand and fall together: moving the zero of the angle turns one into the other.
GRAVITY = ("gravity_sine", "gravity_cosine")
#: A candidate is judged if at least this part of its column is not made up of mass, damping and
#: the candidates before it; 2 % lets sine and cosine in from a half range of some 0.7 rad.
DISTINCT = 0.02
#: A position this many times further from zero than its own spread is counted from its middle:
#: the zero of such an encoder is an accident, and its column would only repeat the offset.
FAR = 10.0


def normalise_columns(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Columns of mean square 1, in which no unit is left; a column of zeros stays zero.

    Each column has shape (rows,), before and after.
    """
    counted = dict(columns)
    if OFFSET in counted and POSITION in counted:
        counted[POSITION] = _from_its_middle(counted[POSITION], counted[OFFSET])
    return {name: scale_to_unit_rms(column) for name, column in counted.items()}


def scale_to_unit_rms(column: FloatArray) -> FloatArray:
    """A column over its rms, found without overflow whatever the unit.

    The column has shape (rows,), any unit; the answer has the same shape and no unit.
    """
    largest = float(np.max(np.abs(column)))
    if largest == 0:
        return column
    moderate = column / largest
    return moderate / np.sqrt(np.mean(moderate**2))


def distinguishable_columns(
    table: Mapping[str, FloatArray],
) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """The candidates this motion can tell apart, and the names of those it cannot.

    Each column has shape (rows,) and no unit.

    Args:
        table: normalised columns, ALWAYS among them, the simplest candidate first.

    Returns:
        What stands or falls as one, each a tuple of names: a candidate, or GRAVITY.
    """
    basis = [_rest(table[name], []) for name in ALWAYS]
    groups: list[tuple[str, ...]] = []
    unjudged: list[str] = []
    pair = tuple(name for name in GRAVITY if name in table)
    for name in table:
        if name in ALWAYS or name in pair[1:]:
            continue
        group = pair if name in pair else (name,)
        extended = list(basis)
        for each in group:
            extended.append(_rest(table[each], extended))
        if all(np.any(new) for new in extended[len(basis) :]):
            basis = extended
            groups.append(group)
        else:
            unjudged += group
    return groups, tuple(unjudged)


def _from_its_middle(position: FloatArray, constant: FloatArray) -> FloatArray:
    """The position less its mean, if that is FAR away; a constant that rests where it does."""
    length = float(constant @ constant)
    middle = float(position @ constant) / length if length > 0 else 0.0
    centred = position - middle * constant
    spread = float(np.linalg.norm(centred))
    return centred if abs(middle) * np.sqrt(length) > FAR * spread else position


def _rest(column: FloatArray, basis: Sequence[FloatArray]) -> FloatArray:
    """Unit vector of what is left of a column beside orthonormal ones; zero if below DISTINCT."""
    length = float(np.linalg.norm(column))
    left = column
    # Twice, because the first pass leaves rounding errors along the basis.
    for _ in range(2):
        for unit in basis:
            left = left - (unit @ left) * unit
    remaining = float(np.linalg.norm(left))
    return left / remaining if remaining > DISTINCT * length else np.zeros_like(column)
