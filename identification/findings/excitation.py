"""Did the log move the device in a way that tells its mass and its damping?"""

from __future__ import annotations

import numpy as np

from identification.errors import Finding
from identification.estimators.model import Estimate
from identification.intervals import half_width
from identification.trajectory import Trajectory

#: Half-width of the 95 % interval of the mass, as part of the mass, above which a log is refused.
#: A fifth is what conservative margins still absorb.
WIDEST_MASS = 0.2
#: The same of the damping, doubted and refused, unless the damping is shown to be small: ...
DOUBTED_DAMPING = 0.5
WIDEST_DAMPING = 1.0
#: ... the half-width, times the rms velocity, is below this part of the rms force.
SMALL_DAMPING_FORCE = 0.02
#: Variance inflation of a column by the others above which it cannot be told from them: at 1000,
#: an error of one part in a thousand of a column becomes three per cent of its parameter.
LARGEST_INFLATION = 1000.0


def excitation(
    trajectory: Trajectory, regression: Estimate, chosen: Estimate
) -> tuple[Finding, ...]:
    """``not-exciting-mass`` and ``not-exciting-damping``."""
    findings: list[Finding] = []
    inflation = dict(zip(regression.parameters, regression.inflation, strict=True))
    mass, damping = chosen.value("mass"), chosen.value("damping")
    spread = half_width(chosen, "mass")
    alike = inflation["mass"] > LARGEST_INFLATION
    if alike or spread > WIDEST_MASS * abs(mass):
        findings.append(
            Finding(
                code="not-exciting-mass",
                severity="refusal",
                seen=_seen(trajectory, "mass", mass, spread, regression, alike=alike),
                needed=f"an interval within {WIDEST_MASS:.0%}",
                remedy="Excite with fast motion too: accelerate as hard as force and travel allow.",
            )
        )
    spread = half_width(chosen, "damping")
    velocity = np.diff(trajectory.position) / trajectory.sample_time
    share = spread * float(np.std(velocity)) / float(np.std(trajectory.force))
    alike = inflation["damping"] > LARGEST_INFLATION
    wide = spread > DOUBTED_DAMPING * abs(damping) and share > SMALL_DAMPING_FORCE
    if alike or wide:
        refused = alike or spread > WIDEST_DAMPING * abs(damping)
        findings.append(
            Finding(
                code="not-exciting-damping",
                severity="refusal" if refused else "warning",
                seen=_seen(trajectory, "damping", damping, spread, regression, alike=alike),
                needed=f"an interval within {WIDEST_DAMPING if refused else DOUBTED_DAMPING:.0%}, "
                f"or below {SMALL_DAMPING_FORCE:.0%} of the force",
                remedy="Excite slower and further as well, at several speeds, and for longer.",
            )
        )
    return tuple(findings)


def _seen(
    trajectory: Trajectory,
    name: str,
    value: float,
    spread: float,
    regression: Estimate,
    *,
    alike: bool,
) -> str:
    text = f"{trajectory.source} gives a {name} of {value:.4g} ± {spread:.2g}"
    if alike:
        text += f", hardly told from the other terms (condition {regression.condition:.0f})"
    return text
