"""Does the force move the device, or does the device move the force?"""

from __future__ import annotations

from identification.errors import Finding
from identification.estimators.model import Estimate
from identification.intervals import half_width
from identification.trajectory import Trajectory


def causality(trajectory: Trajectory, chosen: Estimate) -> tuple[Finding, ...]:
    """``sign-flip`` and ``controller-identified``.

    Force with the wrong sign negates every parameter. A device driven by hand against a virtual
    spring and damper shows the controller instead: F = -K·q - B·q̇ reads as damping -B, however
    well it fits.
    """
    mass, damping = chosen.value("mass"), chosen.value("damping")
    mass_spread, damping_spread = half_width(chosen, "mass"), half_width(chosen, "damping")
    if mass > 0 and damping + damping_spread >= 0:
        return ()
    seen = (
        f"{trajectory.source} gives mass {mass:.4g} ± {mass_spread:.2g} and damping "
        f"{damping:.4g} ± {damping_spread:.2g}, explaining {chosen.explained:.2%} of the "
        f"{chosen.residual_unit}"
    )
    flipped = mass + mass_spread < 0 and damping - damping_spread <= 0
    if flipped:
        return (
            Finding(
                code="sign-flip",
                severity="refusal",
                seen=seen,
                needed="positive mass; with the force negated both become positive",
                remedy="Give --force-gain the other sign: force is positive along +position.",
            ),
        )
    return (
        Finding(
            code="controller-identified",
            severity="refusal",
            seen=seen,
            needed="positive mass, and damping not clearly negative",
            remedy="Drive the device by its actuator with the hand off; a log of a hand against "
            "a virtual spring shows the controller, not the device.",
        ),
    )
