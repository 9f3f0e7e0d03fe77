"""A force that a sensor measured at each row, where one that is held from its row is asked for.

Taken as held it acts half a sample early, as no delay does; its mean over each sample is what to
hold. What a sensor says tells neither the delay nor the lag of the actuator.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.errors import Finding
from identification.estimators.least_squares import Delay, Regression, prepare, shift_of_delay
from identification.estimators.least_squares import point as least_squares
from identification.trajectory import NORMAL_95, Trajectory

#: It acts early by this many samples, and by so many deviations; ...
_EARLY, _SURELY = (0.25, 0.75), 3.0
#: ... its means leave at most this part of the mean square that it leaves, noise of position apart.
#: Play, vibration and friction that seem early leave 0.85 or more.
_LEFT = 0.6


def averaged(log: Trajectory) -> Trajectory:
    """A log with the mean of its force over each sample, of a cubic through four even rows."""
    around = np.pad(log.force, (1, 2), mode="edge")
    return replace(log, force=np.convolve(around, np.array([-1, 13, 13, -1]) / 24, mode="valid"))


def acts_early(log: Trajectory, table: Regression, delay: float) -> Delay | None:
    """How much a measured force acts before its row, s; None for one that is held."""
    step = log.sample_time
    if delay >= step / 2:
        return None
    shift = shift_of_delay(table, delay)
    early = Delay(value=-(delay + shift.value), deviation=shift.deviation)
    least = max(_EARLY[0] * step, _SURELY * early.deviation)
    if not least < early.value < _EARLY[1] * step:
        return None
    means = prepare(averaged(log), table.model, step, refine=False).refined(0.0)
    noise = table.noise_force(delay) ** 2
    left, before = (
        float(np.mean(least_squares(each, late).residual ** 2)) - noise
        for each, late in ((means, 0.0), (table, delay))
    )
    return early if left < _LEFT * before else None


def seems_measured(log: Trajectory, early: Delay) -> Finding:
    """``delay-unknown``: what was measured tells none."""
    return Finding(
        code="delay-unknown",
        severity="warning",
        seen=f"the force of {log.source} acts {early.value * 1e3:.3g} ± "
        f"{NORMAL_95 * early.deviation * 1e3:.2g} ms before its row, half a sample: it seems "
        "measured, not commanded, and tells no delay; mass and damping were told with its mean "
        "over each sample",
        needed="a force that is held from its row to the next",
        remedy="Log the force that is commanded; where only a sensor knows it, give the mean of "
        "each row's force and the next one's, and state delay in the hardware file.",
    )
