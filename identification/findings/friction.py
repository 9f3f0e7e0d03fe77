"""Friction that is no straight line over speed: what a log shows of it, and its slopes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from identification.device.device import SlopeRange, UnmodelledForce
from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.trajectory import Trajectory

#: Friction that the slope over speed does not cover, because it falls, depends on position or
#: remembers, may make up this part of the force, both rms, ...
_MOST_SHARE = 0.15
#: ... or this, where it leaves so little of the force over that mass and damping are told.
_MOST_EXPLAINED, _LITTLE_LEFT = 0.5, 0.04
_NAMED_SHARE = 0.01  # a kind named in a finding makes up at least this part of the force
#: A slope over the speeds seen that would take this many times the largest force is not told.
_STEEPEST = 10.0


def unmodelled(
    trajectory: Trajectory,
    chosen: Estimate,
    forces: Sequence[UnmodelledForce],
    slope: SlopeRange,
    fastest: float,
    left: float = 1.0,
) -> Iterator[Finding]:
    """``unmodelled-force``: what the friction is, and the slopes that it has over speed.

    ``left`` is what all of it leaves over, rms as part of the force.
    """
    named = [each for each in forces if each.share >= _NAMED_SHARE] or forces[:1]
    kinds = ", ".join(
        f"{each.words}, "
        + (f"{each.share:.1%} of the force" if each.share < 1 else "as much as the force itself")
        for each in named
    )
    uncovered = [each for each in forces if not each.rises]
    steepest = _STEEPEST * float(np.max(np.abs(trajectory.force))) / fastest
    told = -steepest <= slope.low and slope.high <= steepest
    most = _MOST_EXPLAINED if left <= _LITTLE_LEFT else _MOST_SHARE
    refused = not told or any(each.share > most for each in uncovered)
    unit, speed = ("N·s/m", "m/s") if trajectory.motion == "linear" else ("N·m·s/rad", "rad/s")
    slopes = (
        f"runs from {slope.low:.4g} to {slope.high:.4g} {unit}, damping alone is "
        f"{chosen.value('damping'):.4g}"
        if told
        else "is not told"
    )
    seen = (
        f"{trajectory.source} shows {kinds}; from rest to {fastest:.3g} {speed} the slope of "
        f"friction {slopes}"
    )
    if not told:
        needed = "motion at several speeds that tells the slope of friction"
        remedy = "Excite slower and faster, further and for longer, with nothing else on the axis."
    elif uncovered:
        needed = (
            f"at most {most:.0%} of the force that does not rise with speed"
            if refused
            else "friction that rises with speed, every slope of which the certificate covers"
        )
        remedy = (
            "Oil, align or exchange what rubs, free the cables, warm up, and log again; what is "
            "left must be allowed for in the margin: no proof covers friction that falls, drifts "
            "or depends on position."
        )
    else:
        needed = "Coulomb friction and constant damping, or slopes that the certificate covers"
        remedy = (
            "The certificate takes every slope. A log at the speeds of use gives a narrower range."
        )
    yield Finding(
        code="unmodelled-force",
        severity="refusal" if refused else "warning",
        seen=seen,
        needed=needed,
        remedy=remedy,
    )
