"""What is wrong, or doubtful, with a log; first: does it tell mass, damping and delay?"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from identification.device.hardware import Hardware
from identification.device.quantities import Quantity
from identification.errors import Finding, refusal
from identification.estimators.estimate import Estimate, half_width, quantile, solve, unit_columns
from identification.estimators.least_squares import Delay, longest_delay
from identification.findings.columns import (
    encoder_wrap,
    resolution,
    sampling,
    saturation,
    stiction,
    units,
)
from identification.findings.force_balance import (
    ONE_WAY,
    ForceBalance,
    balance_of,
    least_squares_residual,
)
from identification.findings.forces import (
    SLOW,
    TREMOR,
    Unlogged,
    cross_validation,
    cut_off_sensitivity,
    hand,
    inertia,
    position_dependence,
    uneven_actuator,
    unlogged,
)
from identification.findings.lost_rows import lost_rows
from identification.trajectory import NORMAL_95, FloatArray, Motion, Trajectory

#: Every code a finding can have; the list is part of the file format and of the command line.
CODES = (
    "not-exciting-mass",
    "not-exciting-damping",
    "few-counts",
    "force-saturated",
    "force-unit",
    "dropped-samples",
    "jitter",
    "clock-backward",
    "encoder-wrap",
    "sign-flip",
    "gravity",
    "stiction",
    "hand-on-device",
    "controller-identified",
    "delay-unknown",
    "delay-contradicted",
    "non-finite",
    "constant-column",
    "too-short",
    "heldout-misfit",
    "unmodelled-force",
    "not-stated",
    "drive-lag",
    "vibration-mode",
    "backlash",
    "load-friction",
    "lost-rows",
    "repeated-rows",
    "axes-not-told-apart",
)


def inspect(
    trajectory: Trajectory, hardware: Hardware, *, alone: bool = True
) -> tuple[Finding, ...]:
    """What can be said before anything is estimated; of one of several axes if not alone."""
    wrapped = tuple(encoder_wrap(trajectory))
    if wrapped:  # what else the position says is not the device's
        return (*sampling(trajectory, hardware), *wrapped, *saturation(trajectory, hardware))
    return (
        *sampling(trajectory, hardware),
        *lost_rows(trajectory, alone=alone),
        *units(trajectory, hardware),
        *resolution(trajectory, hardware),
        *saturation(trajectory, hardware),
        *stiction(trajectory, hardware),
    )


def judge(
    trajectory: Trajectory,
    regression: Estimate,
    chosen: Estimate,
    *,
    delay: Delay | None = None,
    stated: Quantity | None = None,
    consulted: Sequence[Estimate] = (),
    unexplained: float = 1.0,
) -> tuple[Finding, ...]:
    """What the estimates say about the log; friction beyond the model leaves ``unexplained``."""
    balance = balance_of(trajectory, chosen)
    left = unlogged(trajectory, balance, chosen, unexplained)
    return (
        *causality(trajectory, balance, chosen),
        *excitation(trajectory, balance, regression, chosen, delay, left),
        *position_dependence(trajectory, balance, chosen),
        *hand(trajectory, balance, left),
        *uneven_actuator(trajectory, balance),
        *cross_validation(trajectory, balance, chosen),
        *inertia(trajectory, balance, chosen),
        *cut_off_sensitivity(trajectory, chosen),
        *_doubted_delay(trajectory, chosen, delay, stated, consulted),
        *mass_unit(trajectory, chosen.value("mass")),
    )


_LAGS = 4  # rows before now that predict now: a controller with two filters has as many
_MOST = 1 << 15  # samples looked at; more add time, not truth
_ROUNDING = 1e-9  # a prediction this much finer than the signal is rounding, not news


def _answer(trajectory: Trajectory) -> float:
    """Share of what is new in the force that what is new in the position explains.

    New is what the rows before do not predict (squared partial correlation at lag zero): nought in
    open loop, where the next force does not know the last reading's noise.
    """
    middle = max(0, (len(trajectory) - _MOST) // 2)
    part = slice(middle, middle + _MOST)
    force = trajectory.force[part] - np.mean(trajectory.force[part])
    place = trajectory.position[part] - np.mean(trajectory.position[part])
    rows = force.size - _LAGS
    columns = [
        column[_LAGS - lag : _LAGS - lag + rows]
        for column in (force, place)
        for lag in range(1, _LAGS + 1)
    ]
    columns += [force[_LAGS:], place[_LAGS:]]
    unit, _ = unit_columns(np.stack(columns).T)
    # Below the diagonal of R nothing is left, so its last columns hold what is new, turned.
    news: FloatArray = np.asarray(np.linalg.qr(unit, mode="r"), dtype=np.float64)[-2:, -2:]
    first, both, second = float(news[0, 0]), float(news[0, 1]), float(news[1, 1])
    if abs(first) <= _ROUNDING or np.hypot(both, second) <= _ROUNDING:
        return 0.0
    return both**2 / (both**2 + second**2)


#: A virtual spring and damper explain the force up to this part of its mean square, ...
_LAW_EXPLAINS = 0.1
#: ... and leave over at most this part of what mass, damping and friction leave over: no device.
_LAW_BETTER = 0.5
#: At a single frequency both explain everything. Then the noise of the reading decides: the force
#: answers to it by this share, ...
_ANSWERS = 0.5
_LAW_AS_GOOD = 2.0  # ... and mass and friction do not explain clearly more than the law.
#: Samples that a spring's force may be late: the hold, and the delay the rows may have taken off.
_LATE = 5.0
_ALL = 0.01  # both leave over less than this part: the log has one frequency


def causality(trajectory: Trajectory, balance: ForceBalance, chosen: Estimate) -> Iterator[Finding]:
    """``sign-flip`` and ``controller-identified``.

    Force with the wrong sign negates every parameter. A device driven by hand against a virtual
    spring and damper shows the controller instead: F = -K·q - B·q̇ reads as damping -B, or at one
    frequency ω as mass K/ω², however well it fits.
    """
    mass, damping = chosen.value("mass"), chosen.value("damping")
    mass_spread, damping_spread = half_width(chosen, "mass"), half_width(chosen, "damping")
    seen = (
        f"{trajectory.source} gives mass {mass:.4g} ± {mass_spread:.2g} and damping {damping:.4g} "
        f"± {damping_spread:.2g}, explaining {chosen.explained:.2%} of the {chosen.residual_unit}"
    )
    law = _controller(trajectory, balance)
    if law:
        needed = "a force that moves the device, not one computed from its position"
        yield _controller_finding(law, needed)
        return
    # Motion one way may tell so little that signs are chance; ``excitation`` refuses that.
    positive = mass + mass_spread > 0 if balance.one_way else mass > 0
    if positive and damping + damping_spread >= 0:
        return
    if mass + mass_spread < 0 and damping - damping_spread <= 0:
        yield refusal(
            "sign-flip",
            seen=seen,
            needed="positive mass; with the force negated both become positive",
            remedy="Give --force-gain the other sign, force being positive along +position: -1 "
            "states that the column is in N (N·m); in volts, amperes or mN give N (N·m) per "
            "unit, with a minus.",
        )
        return
    yield _controller_finding(seen, "positive mass, and damping not clearly negative")


def _controller(trajectory: Trajectory, balance: ForceBalance) -> str:
    """A virtual spring and damper that know the force better than a device, in words, or ""."""
    columns = np.stack((balance.position, balance.velocity, np.ones_like(balance.time)), axis=1)
    weights = solve(columns, balance.force)
    stiffness, damping = -float(weights[0]), -float(weights[1])

    def share(left: FloatArray) -> float:
        return float(np.mean(left**2)) / float(np.var(balance.force))

    law, plant = share(balance.force - columns @ weights), share(balance.unexplained())
    model = plant if balance.gravity == "none" else share(balance.unexplained(balance.carried))
    answer = _answer(trajectory)
    # A logged set-point is news from outside, whatever the loop answers.
    answers = trajectory.reference is None and answer >= _ANSWERS
    # A force held from sample to sample is late, which takes some of a spring's damping.
    late = _LATE * trajectory.sample_time * max(stiffness, 0.0)
    # What brakes and answers its own reading is a virtual damper; a device takes force to be moved.
    brakes = damping > 0 or law <= _LAW_AS_GOOD * plant
    better = law <= _LAW_BETTER * plant or (answers and law <= _ALL and brakes)
    computed = damping + late > 0 and law <= _LAW_EXPLAINS and better
    if not computed and not (answers and model > _LAW_EXPLAINS):
        return ""
    return (
        f"F = {-stiffness:.4g}·q {'-' if damping >= 0 else '+'} {abs(damping):.4g}·q̇ explains "
        f"{1 - law:.2%} of the force in {trajectory.source}, mass, damping and friction "
        f"{1 - plant:.2%}; the reading of the same sample explains {answer:.0%} of what is new in "
        "the force"
    )


def _controller_finding(seen: str, needed: str) -> Finding:
    return refusal(
        "controller-identified",
        seen=seen,
        needed=needed,
        remedy="Log a force that is planned, or the set-point too (--reference): force computed "
        "from the position alone shows the controller, not the device.",
    )


#: Half-width of the 95 % interval of the mass, as part of the mass, above which a log is refused.
#: A fifth is what conservative margins still absorb.
_WIDEST_MASS = 0.2
#: The same of the damping, doubted and refused, unless the damping is shown to be small: ...
_DOUBTED_DAMPING = 0.5
_WIDEST_DAMPING = 1.0
#: ... the half-width, times the rms velocity, is below this part of the rms force.
_SMALL_DAMPING_FORCE = 0.02
#: Variance inflation of a column by the others above which it cannot be told from them: at 1000,
#: an error of one part in a thousand of a column becomes three per cent of its parameter.
_LARGEST_INFLATION = 1000.0
#: Part of the acceleration's mean square that position does not explain: below, the motion has one
#: frequency.
_ONE_FREQUENCY = 0.01
#: Standard deviation of the speed, as part of its mean, below which motion one way has one speed:
#: damping, friction and offset are then one force.
_ONE_SPEED = 0.05


def excitation(
    trajectory: Trajectory,
    balance: ForceBalance,
    regression: Estimate,
    chosen: Estimate,
    delay: Delay | None,
    left: Unlogged,
) -> Iterator[Finding]:
    """``not-exciting-mass`` and ``not-exciting-damping``; ``delay`` is None if it was stated."""
    inflation = dict(zip(regression.parameters, regression.inflation, strict=True))

    def seen(name: str, spread: float) -> str:
        text = f"{trajectory.source} gives a {name} of {chosen.value(name):.4g} ± {spread:.2g}"
        if inflation[name] > _LARGEST_INFLATION:
            text += f", hardly told from the other terms (condition {regression.condition:.0f})"
        return text

    yield from _one_frequency(trajectory, balance)
    mass, damping = chosen.value("mass"), chosen.value("damping")
    # Force that is late by d and damping b look like a mass of b·d.
    step = trajectory.sample_time
    most = longest_delay(step, len(trajectory))
    doubt = 0.0 if delay is None else min(NORMAL_95 * delay.deviation, most)
    spread = max(half_width(chosen, "mass"), doubt * abs(damping))
    alike = inflation["mass"] > _LARGEST_INFLATION
    mass_known = not alike and spread <= _WIDEST_MASS * abs(mass)
    if not mass_known:
        yield refusal(
            "not-exciting-mass",
            seen=seen("mass", spread),
            needed=f"an interval within {_WIDEST_MASS:.0%}",
            remedy="Excite with fast motion too: accelerate as hard as force and travel allow.",
        )
    spread = half_width(chosen, "damping")
    share = spread * float(np.std(balance.velocity)) / float(np.std(trajectory.force))
    alike = inflation["damping"] > _LARGEST_INFLATION
    wide = spread > _DOUBTED_DAMPING * abs(damping) and share > _SMALL_DAMPING_FORCE
    if alike or wide:
        refused = alike or spread > _WIDEST_DAMPING * abs(damping)
        yield Finding(
            code="not-exciting-damping",
            severity="refusal" if refused else "warning",
            seen=seen("damping", spread),
            needed=f"an interval within {_WIDEST_DAMPING if refused else _DOUBTED_DAMPING:.0%}, or "
            f"below {_SMALL_DAMPING_FORCE:.0%} of the force",
            remedy="Excite slower and further as well, at several speeds, and for longer.",
        )
    if balance.one_way:
        sharp = mass_known and mass > 0 and doubt <= step
        yield _one_way(trajectory, balance, chosen, left, mass_told=sharp)


def _one_frequency(trajectory: Trajectory, balance: ForceBalance) -> Iterator[Finding]:
    """A spring of -m·ω² and a mass m look alike at one ω."""
    near = np.stack((balance.position, balance.velocity, np.ones_like(balance.time)), axis=1)
    left = least_squares_residual(near, balance.acceleration)
    power = float(np.var(balance.acceleration))
    share = float(np.mean(left**2)) / power if power > 0 else 0.0
    if share >= _ONE_FREQUENCY:
        return
    yield Finding(
        code="not-exciting-mass",
        seen=f"{trajectory.source} moves at one frequency: position and velocity explain "
        f"{1 - share:.2%} of the acceleration, so a spring or a hand would look like mass",
        needed=f"at most {1 - _ONE_FREQUENCY:.0%}",
        remedy="Excite with several frequencies at once, a sweep or random steps.",
    )


def _one_way(
    trajectory: Trajectory,
    balance: ForceBalance,
    chosen: Estimate,
    left: Unlogged,
    *,
    mass_told: bool,
) -> Finding:
    """Friction and offset are one force in motion that never turns, at one speed damping too."""
    mean = float(np.mean(balance.velocity))
    sign, sense = ("+", "forward") if mean > 0 else ("-", "backward")
    steady = float(np.std(balance.velocity)) < _ONE_SPEED * abs(mean)
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
    if left.shaking or left.pushing:
        seen += (
            f"; forces that it does not log, {left.slow / left.force:.0%} of the force below "
            f"{SLOW:g} Hz and {left.tremor / left.force:.1%} at {TREMOR[0]:g} to {TREMOR[1]:g} Hz, "
            "may be a load, ripple of a motor, uneven friction or a hand"
        )
    if mass_told and not left.much:
        seen += "; the mass is told, by how the speed changes"
    speeds, more = (", at several speeds", " and damping from both") if steady else ("", "")
    alone = ", with nothing else on the device" if left.much else ""
    return Finding(
        code="not-exciting-damping",
        severity="refusal" if left.much else "warning",
        seen=seen,
        needed=f"at least {ONE_WAY:.0%} of the motion the other way{speeds}",
        remedy=f"Move both ways{speeds}, to tell friction from an offset{more}{alone}.",
    )


#: A mass or inertia that is no handle's: a fly's wing, and a forging press; and its unit.
_MASS: dict[Motion | None, tuple[float, float, str]] = {
    "linear": (1e-4, 1000.0, "kg"),
    "rotary": (1e-9, 100.0, "kg·m²"),
    None: (1e-9, 1000.0, "kg (kg·m²)"),
}


def mass_unit(trajectory: Trajectory, mass: float) -> Iterator[Finding]:
    """``force-unit`` where the mass is none a device has."""
    low, high, unit = _MASS[trajectory.motion]
    if low <= mass <= high or mass <= 0:
        return
    yield refusal(
        "force-unit",
        seen=f"{trajectory.source} gives a mass of {mass:.3g} {unit}",
        needed=f"{low:g} to {high:g} {unit}, which handles and axes have",
        remedy="Give what one unit of each column is in SI with --force-gain (mN, volts, "
        "amperes or counts?), --position-gain (mm or degrees?) and --time-gain (ms?), and "
        "state force_limit and encoder_resolution in the hardware file.",
    )


_AT_END = 0.1  # samples from the end of the scan within which the true delay may lie beyond it
#: Half-width of the 95 % interval of a delay, in samples, above which it is doubted: a stability
#: margin is of one sample.
_WIDEST_DELAY = 1.0
#: Two delays contradict each other if they are further apart than this many deviations of both ...
_DELAY_SIGMAS = 4.0
_APART = 0.25  # ... and than this part of a sample, below which the difference matters to nothing.
WRONG_DELAY = 0.5  # samples by which a stated delay may be wrong


def contradicts_delay(seen: Delay, stated: Quantity, step: float) -> bool:
    """Whether a delay read from a log lies outside of the one stated, by half a sample at least."""
    outside = max(seen.value - stated.high, stated.low - seen.value)
    return outside > max(_DELAY_SIGMAS * seen.deviation, WRONG_DELAY * step)


def _doubted_delay(
    trajectory: Trajectory,
    chosen: Estimate,
    delay: Delay | None,
    stated: Quantity | None,
    others: Iterable[Estimate],
) -> Iterator[Finding]:
    """A delay that is not told, not as stated, or told differently by two methods: one of them."""
    if delay is None:
        yield from _contradicting_delays(trajectory, chosen, others)
        return
    step = trajectory.sample_time
    most = longest_delay(step, len(trajectory))
    # Nothing is known beyond the scan, so no doubt is wider.
    width = min(NORMAL_95 * delay.deviation, most)
    seen = (
        f"the residual of {trajectory.source} is smallest at {delay.value * 1e3:.4g} ± "
        f"{width * 1e3:.2g} ms of delay"
    )
    remedy = "State delay in the hardware file, or excite fast enough to show it."
    if delay.value >= most - _AT_END * step:
        yield refusal(
            "delay-unknown",
            seen=f"{seen}, the end of the scan from 0 to {most * 1e3:.4g} ms",
            needed=f"a delay below {most * 1e3:.4g} ms",
            remedy=remedy,
        )
    elif stated is not None:  # a delay is read although one is stated: the log contradicts that
        yield Finding(
            code="delay-contradicted",
            seen=f"{seen}, the hardware states {stated.value * 1e3:.4g} ms",
            needed=f"the same within {WRONG_DELAY:g} samples ({WRONG_DELAY * step * 1e3:.4g} ms)",
            remedy="See that force[k] is what was sent at time[k], or shift the rows of force; "
            "only then correct delay in the hardware file. If both are right, the device does what "
            "the model lacks, as play or a lagging drive, and mass and damping may be off by more "
            "than their intervals. Both were told with the delay of the log.",
        )
    elif width > _WIDEST_DELAY * step:
        yield Finding(
            code="delay-unknown",
            seen=seen,
            needed=f"a delay within ± {_WIDEST_DELAY:g} sample",
            remedy=remedy,
        )
    else:
        yield from _contradicting_delays(trajectory, chosen, others)


def _contradicting_delays(
    trajectory: Trajectory, chosen: Estimate, others: Iterable[Estimate]
) -> Iterator[Finding]:
    """Two methods read delays that exclude each other."""
    if chosen.delay_deviation is None:
        return
    step = trajectory.sample_time
    for other in others:
        if other.delay_deviation is None:
            continue
        apart = abs(other.delay - chosen.delay)
        chance = float(np.hypot(other.delay_deviation, chosen.delay_deviation))
        if apart > max(_DELAY_SIGMAS * chance, _APART * step):
            yield Finding(
                code="delay-unknown",
                seen=f"{_delay_of(chosen, step)} in {trajectory.source}, {_delay_of(other, step)}",
                needed=f"delays within {_DELAY_SIGMAS:g} deviations or {_APART:g} samples",
                remedy="State delay in the hardware file; where it varies from sample to "
                "sample, state its largest value.",
            )
            return


def _delay_of(estimate: Estimate, step: float) -> str:
    width = NORMAL_95 * (estimate.delay_deviation or 0.0)
    name = estimate.method.replace("-", " ")
    return f"{name} say {estimate.delay / step:.2f} ± {width / step:.2g} samples of delay"
