"""The part of a long log that parameters are estimated from."""

from __future__ import annotations

import numpy as np

from identification.trajectory import Trajectory

#: Samples an estimate is made of at most: eight minutes at 1 kHz, where noise has long ceased to
#: limit the intervals. Estimators hold up to a hundred numbers a sample.
MOST_FITTED = 500_000


def most_excited(trajectory: Trajectory) -> Trajectory:
    """The consecutive MOST_FITTED samples with the largest mean square velocity.

    A shorter log is returned whole. Findings still look at the whole log, so a device that changed
    in the part left out is seen.
    """
    spare = len(trajectory) - MOST_FITTED
    if spare <= 0:
        return trajectory
    # Neighbours overlap by half.
    starts = np.linspace(0, spare, 1 + int(np.ceil(2 * spare / MOST_FITTED))).astype(np.intp)
    parts = [slice(int(start), int(start) + MOST_FITTED) for start in starts]
    return trajectory.part(max(parts, key=lambda rows: _mean_square_velocity(trajectory, rows)))


def _mean_square_velocity(trajectory: Trajectory, rows: slice) -> float:
    """Mean square velocity of some consecutive samples, m²/s²."""
    velocity = np.diff(trajectory.position[rows]) / np.diff(trajectory.time[rows])
    return float(np.mean(velocity**2))
