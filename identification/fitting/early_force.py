"""A force that acts before its row, as no delay does, where one held from its row is asked for.

One that a sensor measured at each row acts half a sample early; its mean over each sample is what
to hold. What a sensor says tells neither the delay nor the lag of the actuator. One that was logged
rows late, or behind a filter, acts earlier still, and its log tells too much damping.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.errors import Finding, refusal
from identification.estimators.least_squares import (
    Delay,
    Regression,
    find_delay,
    longest_delay,
    prepare,
    shift_of_delay,
)
from identification.estimators.least_squares import point as least_squares
from identification.trajectory import NORMAL_95, Trajectory

#: It acts early by this part of a sample, and by so many deviations; ...
_EARLY, _SURELY = 0.25, 3.0
#: ... from this part on by rows. ...
ROWS = 0.75
#: Its means, or the force moved by rows, leave at most this part of the mean square that it leaves,
#: noise of position apart. Play, vibration and friction that seem early leave 0.85 or more; play
#: that seems early by rows 0.56, rows that are late or filtered 0.3 or less.
_LEFT, _LEFT_BY_ROWS = 0.6, 0.4


def averaged(log: Trajectory) -> Trajectory:
    """A log with the mean of its force over each sample, of a cubic through four even rows."""
    around = np.pad(log.force, (1, 2), mode="edge")
    return replace(log, force=np.convolve(around, np.array([-1, 13, 13, -1]) / 24, mode="valid"))


def acts_early(log: Trajectory, table: Regression, delay: float) -> Delay | None:
    """How much a force acts before its row, s; None for one that is held from then on."""
    step = log.sample_time
    if delay >= step / 2:
        return None
    shift = shift_of_delay(table, delay)
    early = Delay(value=-(delay + shift.value), deviation=shift.deviation)
    if early.value <= max(_EARLY * step, _SURELY * early.deviation):
        return None
    if early.value < ROWS * step:
        other, late, most = prepare(averaged(log), table.model, step, refine=False), 0.0, _LEFT
    else:
        rows = round(longest_delay(step, len(log)) / step)
        moved = replace(log.part(slice(None, -rows)), force=log.force[rows:])
        other, most = prepare(moved, table.model, rows * step, refine=False), _LEFT_BY_ROWS
        found = find_delay(moved, other)
        late = found.value
        early = replace(found, value=max(rows * step - late, ROWS * step))
    noise = table.noise_force(delay) ** 2
    left, before = (
        float(np.mean(least_squares(each, after).residual ** 2)) - noise
        for each, after in ((other.refined(late), late), (table, delay))
    )
    return early if left < most * before else None


def seems_measured(log: Trajectory, early: Delay) -> Finding:
    """``delay-unknown``: what was measured tells none."""
    return Finding(
        code="delay-unknown",
        seen=f"the force of {log.source} acts {early.value * 1e3:.3g} ± "
        f"{NORMAL_95 * early.deviation * 1e3:.2g} ms before its row, half a sample: it seems "
        "measured, not commanded, and tells no delay; mass and damping were told with its mean "
        "over each sample",
        needed="a force that is held from its row to the next",
        remedy="Log the force that is commanded; where only a sensor knows it, give the mean of "
        "each row's force and the next one's, and state delay in the hardware file.",
    )


def rows_early(log: Trajectory, early: Delay) -> Finding:
    """``delay-unknown``, a refusal: a force logged late tells too much damping."""
    return refusal(
        "delay-unknown",
        seen=f"the force of {log.source} acts {early.value * 1e3:.3g} ± "
        f"{NORMAL_95 * early.deviation * 1e3:.2g} ms before its row, "
        f"{early.value / log.sample_time:.2g} × the sample time, as no delay does: it was logged "
        "late or behind a filter, and damping comes out too high",
        needed="a force that acts from its row on: force[k] is what was sent at time[k]",
        remedy="Shift the rows of force back by that and by the delay of the device, or log the "
        "force that is commanded, not one measured through a filter.",
    )
