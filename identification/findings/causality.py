"""Does the force move the device, or does the device move the force?"""

from __future__ import annotations

from identification.errors import Finding
from identification.estimators.estimate import Estimate, half_width
from identification.findings.feedback import Law, law_of
from identification.findings.force_balance import ForceBalance
from identification.trajectory import Trajectory

#: A virtual spring and damper explain the force up to this part of its mean square, ...
LAW_EXPLAINS = 0.1
#: ... and leave over at most this part of what mass, damping and friction leave over: no device.
LAW_BETTER = 0.5
#: At a single frequency both explain everything. Then the noise of the reading decides: the force
#: answers to it by this share, ...
ANSWERS = 0.5
#: ... and mass and friction do not explain clearly more than the law.
LAW_AS_GOOD = 2.0
#: Samples that a spring's force may be late: the hold, and the delay the rows may have taken off.
_LATE = 5.0
#: Both leave over less than this part: the log has one frequency.
_ALL = 0.01


def causality(
    trajectory: Trajectory, balance: ForceBalance, chosen: Estimate
) -> tuple[Finding, ...]:
    """``sign-flip`` and ``controller-identified``.

    Force with the wrong sign negates every parameter. A device driven by hand against a virtual
    spring and damper shows the controller instead: F = -K·q - B·q̇ reads as damping -B, or at one
    frequency ω as mass K/ω², however well it fits.
    """
    mass, damping = chosen.value("mass"), chosen.value("damping")
    mass_spread, damping_spread = half_width(chosen, "mass"), half_width(chosen, "damping")
    seen = (
        f"{trajectory.source} gives mass {mass:.4g} ± {mass_spread:.2g} and damping "
        f"{damping:.4g} ± {damping_spread:.2g}, explaining {chosen.explained:.2%} of the "
        f"{chosen.residual_unit}"
    )
    law = law_of(trajectory, balance)
    if _controller(trajectory, law):
        sign = "-" if law.damping >= 0 else "+"
        return (
            _controller_finding(
                f"F = {-law.stiffness:.4g}·q {sign} {abs(law.damping):.4g}·q̇ explains "
                f"{1 - law.unexplained:.2%} of the force in {trajectory.source}, mass, damping and "
                f"friction {1 - law.plant_unexplained:.2%}; the reading of the same sample "
                f"explains {law.answer:.0%} of what is new in the force",
                "a force that moves the device, not one computed from its position",
            ),
        )
    # Motion one way may tell so little that signs are chance; excitation.py refuses that.
    positive = mass + mass_spread > 0 if balance.one_way else mass > 0
    if positive and damping + damping_spread >= 0:
        return ()
    if mass + mass_spread < 0 and damping - damping_spread <= 0:
        return (
            Finding(
                code="sign-flip",
                severity="refusal",
                seen=seen,
                needed="positive mass; with the force negated both become positive",
                remedy="Give --force-gain the other sign, force being positive along +position: -1 "
                "states that the column is in N (N·m); in volts, amperes or mN give N (N·m) per "
                "unit, with a minus.",
            ),
        )
    return (_controller_finding(seen, "positive mass, and damping not clearly negative"),)


def _controller(trajectory: Trajectory, law: Law) -> bool:
    """A law that pulls back or brakes, and knows the force better than any device would."""
    # A logged set-point is news from outside, whatever the loop answers.
    answers = trajectory.reference is None and law.answer >= ANSWERS
    if answers and law.model_unexplained > LAW_EXPLAINS:
        return True
    # A force held from sample to sample is late, which takes some of a spring's damping.
    late = _LATE * trajectory.sample_time * max(law.stiffness, 0.0)
    if law.damping + late <= 0 or law.unexplained > LAW_EXPLAINS:
        return False
    if law.unexplained <= LAW_BETTER * law.plant_unexplained:
        return True
    # What brakes and answers its own reading is a virtual damper; a device takes force to be moved.
    as_good = law.unexplained <= LAW_AS_GOOD * law.plant_unexplained
    return answers and law.unexplained <= _ALL and (law.damping > 0 or as_good)


def _controller_finding(seen: str, needed: str) -> Finding:
    return Finding(
        code="controller-identified",
        severity="refusal",
        seen=seen,
        needed=needed,
        remedy="Drive the device by its actuator with the hand off; a log of a hand against "
        "a virtual spring shows the controller, not the device.",
    )
