"""Did the log move the device in a way that tells its mass and its damping?"""

from __future__ import annotations

import numpy as np

from identification.errors import Finding
from identification.estimators.estimate import NORMAL_95, Estimate, half_width, quantile
from identification.estimators.least_squares import MOST_SAMPLES, Delay
from identification.findings.force_balance import ONE_WAY, ForceBalance, least_squares_residual
from identification.findings.hand import MOST_SLOW, SLOW, TREMOR, Unlogged
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
#: Standard deviation of the speed, as part of its mean, below which motion one way has one speed:
#: damping, friction and offset are then one force.
ONE_SPEED = 0.05


def excitation(
    trajectory: Trajectory,
    balance: ForceBalance,
    regression: Estimate,
    chosen: Estimate,
    delay: Delay | None,
    left: Unlogged,
) -> tuple[Finding, ...]:
    """``not-exciting-mass`` and ``not-exciting-damping``.

    ``delay`` is as read from the log, None if it was stated; ``left`` is what it does not know.
    """
    findings = [*_one_frequency(trajectory, balance)]
    inflation = dict(zip(regression.parameters, regression.inflation, strict=True))
    mass, damping = chosen.value("mass"), chosen.value("damping")
    # Force that is late by d and damping b look like a mass of b·d.
    doubt = 0.0 if delay is None else _doubt(delay, trajectory.sample_time)
    spread = max(half_width(chosen, "mass"), doubt * abs(damping))
    alike = inflation["mass"] > LARGEST_INFLATION
    told = not alike and spread <= WIDEST_MASS * abs(mass)
    if not told:
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
    if balance.one_way:
        known = told and mass > 0 and doubt <= trajectory.sample_time
        findings.append(_one_way(trajectory, balance, chosen, left, mass_told=known))
    return tuple(findings)


def _doubt(delay: Delay, step: float) -> float:
    """Half-width of the 95 % interval of a delay that was looked for, s."""
    return min(NORMAL_95 * delay.deviation, MOST_SAMPLES * step)


def _one_frequency(trajectory: Trajectory, balance: ForceBalance) -> tuple[Finding, ...]:
    """A spring of -m·ω² and a mass m look alike at one ω."""
    near = np.stack((balance.position, balance.velocity, np.ones_like(balance.time)), axis=1)
    left = least_squares_residual(near, balance.acceleration)
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


def _one_way(
    trajectory: Trajectory,
    balance: ForceBalance,
    chosen: Estimate,
    left: Unlogged,
    *,
    mass_told: bool,
) -> Finding:
    """Friction and offset are one force in motion that never turns, at one speed damping too.

    Mass can be told all the same, by what the force does to the speed.
    """
    mean = float(np.mean(balance.velocity))
    sign, sense = ("+", "forward") if mean > 0 else ("-", "backward")
    steady = float(np.std(balance.velocity)) < ONE_SPEED * abs(mean)
    if steady:
        seen = (
            f"{trajectory.source} moves {sense} only, at one speed of {abs(mean):.4g}: damping, "
            f"Coulomb friction and offset are one force of {np.mean(balance.force):.4g}, and none "
            "is known by itself"
        )
    else:
        # Whatever the model calls it, this is what the log shows.
        parts = {"force_offset": 1.0, "coulomb_friction": np.sign(mean)}
        weights = np.array([parts.get(name, 0.0) for name in chosen.parameters])
        both = weights @ chosen.values
        spread = quantile(chosen) * np.sqrt(max(weights @ chosen.covariance @ weights, 0.0))
        seen = (
            f"{trajectory.source} moves {sense} only: offset {sign} Coulomb friction is "
            f"{both:.4g} ± {spread:.2g}, and neither is known by itself"
        )
    if left.shaking or left.slow >= MOST_SLOW * left.force:
        seen += (
            f"; forces that it does not log, {left.slow / left.force:.0%} of the force below "
            f"{SLOW:g} Hz and {left.tremor / left.force:.1%} at {TREMOR[0]:g} to {TREMOR[1]:g} Hz, "
            "may be a load, ripple of a motor, uneven friction or a hand"
        )
    if mass_told and not left.much:
        seen += "; the mass is told, by how the speed changes"
    speeds = ", at several speeds" if steady else ""
    return Finding(
        code="not-exciting-damping",
        severity="refusal" if left.much else "warning",
        seen=seen,
        needed=f"at least {ONE_WAY:.0%} of the motion the other way{speeds}",
        remedy=f"Move both ways{speeds}, to tell friction from an offset"
        f"{' and damping from both' if steady else ''}"
        f"{', with nothing else on the device' if left.much else ''}.",
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
