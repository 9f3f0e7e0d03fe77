"""Does the motion span enough counts of the encoder?"""

from __future__ import annotations

import numpy as np

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.signals import finest_reading
from identification.trajectory import Trajectory

#: Travel in counts below which rounding is no longer noise but part of the motion.
FEWEST_COUNTS = 100


def resolution(trajectory: Trajectory, hardware: Hardware | None) -> tuple[Finding, ...]:
    """``few-counts``."""
    stated = None if hardware is None else hardware.encoder_resolution
    count = (
        finest_reading(trajectory.position, trajectory.force) if stated is None else stated.value
    )
    travel = float(np.ptp(trajectory.position))
    if travel >= FEWEST_COUNTS * count:
        return ()
    return (
        Finding(
            code="few-counts",
            severity="refusal",
            seen=f"{trajectory.source} travels {travel:.3g}, {travel / count:.0f} counts of "
            f"{count:.3g}",
            needed=f"at least {FEWEST_COUNTS} counts",
            remedy="Give m (rad) per unit of the position column with --position-gain if it is in "
            "another unit; otherwise move the device further while logging.",
        ),
    )
