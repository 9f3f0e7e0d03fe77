"""Stiction: does the device stand although the force changes?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.motion import running_maximum, running_range
from identification.estimators.signals import finest_reading
from identification.trajectory import Trajectory

#: The device stands where its position stays within this many readings of the finest resolution, a
#: count to either side, ...
STILL = 3.0
#: ... for as long as it takes to move this many times as far at its usual speed: a slow turn is no
#: standstill, ...
_FURTHER = 10.0
#: ... and for this many samples at least, this part of the log at most, ...
_FEWEST = 20
_LONGEST = 0.1
#: ... while the force in the window changes by this part of its whole range.
CHANGES = 0.02
#: Part of the log spent so above which friction is doubted, and above which too little motion is
#: left to tell mass and damping.
DOUBTED = 0.25
REFUSED = 0.9


def stiction(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """``stiction``: the device is held, or sticks and slips, under a force that changes."""
    stuck = _stuck(trajectory, hardware)
    share = float(np.mean(stuck))
    if share < DOUBTED:
        return ()
    stops = int(np.count_nonzero(np.diff(stuck.astype(np.int8)) == 1)) + int(stuck[0])
    largest = float(np.max(np.abs(trajectory.force[:-1][stuck])))
    refused = share >= REFUSED
    return (
        Finding(
            code="stiction",
            severity="refusal" if refused else "warning",
            seen=f"{trajectory.source} stands still for {share:.0%} of its time, in {stops} "
            f"stops, while the force changes and reaches {largest:.3g}",
            needed=f"at most {REFUSED if refused else DOUBTED:.0%} of the time",
            remedy="Push harder than friction holds, for longer in each direction; look for a "
            "brake, an end stop or a dry bearing.",
        ),
    )


def _stuck(trajectory: Trajectory, hardware: Hardware | None) -> NDArray[np.bool_]:
    """Which of the n - 1 intervals lie in a standstill under a changing force."""
    place, force = trajectory.position, trajectory.force
    stated = None if hardware is None else hardware.encoder_resolution
    known = 0.0 if stated is None else stated.value
    fine = max(known, finest_reading(place, force))
    # Over spans long enough for the noise of a reading not to count as speed.
    span = max(1, place.size // 200)
    speed = float(np.sqrt(np.mean((place[span:] - place[:-span]) ** 2))) / span
    if speed == 0:  # a cycle of exactly this span
        return np.zeros(place.size - 1, dtype=np.bool_)
    width = 2 * (int(max(_FEWEST, _FURTHER * STILL * fine / speed)) // 2) + 1
    if width >= _LONGEST * place.size:
        return np.zeros(place.size - 1, dtype=np.bool_)
    changes = running_range(force, width) >= CHANGES * float(np.ptp(force))
    still = changes & (running_range(place, width) <= STILL * fine)
    covered = running_maximum(still.astype(np.float64), width) > 0
    return covered[:-1] & covered[1:]
