"""Numbers no device has, in any unit: their squares would not be numbers any more."""

from __future__ import annotations

import numpy as np

from identification.errors import InvalidInputError
from identification.trajectory import Trajectory

#: Size of any column, and least change of force and position, in SI units. Micro-manipulators and
#: presses lie many orders inside.
LARGEST = 1e12
SMALLEST = 1e-12


def refuse_sizes(trajectory: Trajectory) -> None:
    """Raises InvalidInputError for a column beyond LARGEST, or one that hardly changes."""
    for name, column in trajectory.columns():
        low, high = float(np.min(column)), float(np.max(column))
        largest, change = max(abs(low), abs(high)), high - low
        if largest > LARGEST or (name in {"force", "position"} and change < SMALLEST):
            raise InvalidInputError(
                trajectory.source,
                f"{name} reaches {largest:.3g} and changes by {change:.3g}, outside of "
                f"{SMALLEST:g} to {LARGEST:g}",
                f"Name the right column with --{name}, and give gains that make it SI",
            )
