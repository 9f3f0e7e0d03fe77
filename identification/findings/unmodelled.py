"""Is there friction that is neither constant damping nor Coulomb friction?"""

from __future__ import annotations

from collections.abc import Sequence

from identification.device.device import SlopeRange, UnmodelledForce
from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.trajectory import Trajectory

#: Friction that the slope over speed does not cover, because it falls, depends on position or
#: remembers, may make up this part of the force, both rms.
MOST_SHARE = 0.15
#: A kind named in a finding makes up at least this part of the force.
LEAST_SHARE = 0.01


def unmodelled(
    trajectory: Trajectory,
    chosen: Estimate,
    forces: Sequence[UnmodelledForce],
    slope: SlopeRange,
    fastest: float,
) -> tuple[Finding, ...]:
    """``unmodelled-force``: what the friction is, and the slopes that it has over speed.

    Args:
        trajectory: the log.
        chosen: the estimate that is to be used.
        forces: kinds of friction found, at least one.
        slope: of friction over speed, from rest to the fastest.
        fastest: m/s.
    """
    named = [each for each in forces if each.share >= LEAST_SHARE] or forces[:1]
    told = ", ".join(f"{each.words}, {each.share:.1%} of the force" for each in named)
    uncovered = [each for each in forces if not each.rises]
    refused = any(each.share > MOST_SHARE for each in uncovered)
    unit, speed = ("N·s/m", "m/s") if trajectory.motion == "linear" else ("N·m·s/rad", "rad/s")
    seen = (
        f"{trajectory.source} shows {told}; from rest to {fastest:.3g} {speed} the slope of "
        f"friction runs from {slope.low:.4g} to {slope.high:.4g} {unit}, damping alone "
        f"is {chosen.value('damping'):.4g}"
    )
    if uncovered:
        needed = (
            f"at most {MOST_SHARE:.0%} of the force that does not rise with speed"
            if refused
            else "friction that rises with speed, every slope of which the certificate covers"
        )
        remedy = (
            "Oil, align or exchange what rubs, free the cables, and log again; what is left must "
            "be allowed for in the margin: no proof covers friction that falls or depends on "
            "position."
        )
    else:
        needed = "Coulomb friction and constant damping, or slopes that the certificate covers"
        remedy = (
            "The certificate takes every slope. A log at the speeds of use gives a narrower range."
        )
    return (
        Finding(
            code="unmodelled-force",
            severity="refusal" if refused else "warning",
            seen=seen,
            needed=needed,
            remedy=remedy,
        ),
    )
