"""Did the log move the device in a way that tells its mass and its damping?"""

from __future__ import annotations

import numpy as np

from identification.errors import Finding
from identification.estimators.delay import MOST_SAMPLES, Delay
from identification.estimators.intervals import NORMAL_95, half_width
from identification.estimators.model import Estimate
from identification.findings.balance import Balance, left_over
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
#: Part of the acceleration's mean square that position does not explain: below, the motion has one
#: frequency.
ONE_FREQUENCY = 0.01
#: Rows that go the other way, as part of those that go either way, below which the motion is one
#: way and friction is not told from an offset.
ONE_WAY = 0.01


def excitation(
    trajectory: Trajectory,
    balance: Balance,
    regression: Estimate,
    chosen: Estimate,
    delay: Delay | None,
) -> tuple[Finding, ...]:
    """``not-exciting-mass`` and ``not-exciting-damping``.

    ``delay`` is as read from the log, None if it was stated.
    """
    findings = [*_one_frequency(trajectory, balance), *_one_way(trajectory, balance, chosen)]
    inflation = dict(zip(regression.parameters, regression.inflation, strict=True))
    mass, damping = chosen.value("mass"), chosen.value("damping")
    # Force that is late by d and damping b look like a mass of b·d.
    late = 0.0 if delay is None else _doubt(delay, trajectory.sample_time) * abs(damping)
    spread = max(half_width(chosen, "mass"), late)
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
    share = spread * float(np.std(balance.velocity)) / float(np.std(trajectory.force))
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


def _doubt(delay: Delay, step: float) -> float:
    """Half-width of the 95 % interval of a delay that was looked for, s."""
    return min(NORMAL_95 * delay.deviation, MOST_SAMPLES * step)


def _one_frequency(trajectory: Trajectory, balance: Balance) -> tuple[Finding, ...]:
    """A spring of -m·ω² and a mass m look alike at one ω."""
    near = np.stack((balance.position, balance.velocity, np.ones_like(balance.time)), axis=1)
    left = left_over(near, balance.acceleration)
    power = float(np.var(balance.acceleration))
    share = float(np.mean(left**2)) / power if power > 0 else 0.0
    if share >= ONE_FREQUENCY:
        return ()
    return (
        Finding(
            code="not-exciting-mass",
            severity="warning",
            seen=f"{trajectory.source} moves at one frequency: position and velocity explain "
            f"{1 - share:.2%} of the acceleration, so a spring or a hand would look like mass",
            needed=f"at most {1 - ONE_FREQUENCY:.0%}",
            remedy="Excite with several frequencies at once, a sweep or random steps.",
        ),
    )


def _one_way(trajectory: Trajectory, balance: Balance, chosen: Estimate) -> tuple[Finding, ...]:
    """Friction and offset are one force in motion that never turns."""
    forth, back = (int(np.count_nonzero(balance.direction * sense > 0.5)) for sense in (1, -1))
    if min(forth, back) >= ONE_WAY * (forth + back):
        return ()
    sign, sense = ("+", "forward") if forth > back else ("-", "backward")
    # Whatever the model calls it, this is what the log shows.
    both = chosen.value("force_offset") + chosen.value("coulomb_friction") * (
        1 if forth > back else -1
    )
    return (
        Finding(
            code="not-exciting-damping",
            severity="warning",
            seen=f"{trajectory.source} moves {sense} only: offset {sign} Coulomb friction is "
            f"{both:.4g}, and neither is known by itself",
            needed=f"at least {ONE_WAY:.0%} of the motion the other way",
            remedy="Move both ways to tell friction from an offset.",
        ),
    )


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
