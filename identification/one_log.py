"""One log to one estimate: delay, terms of the model, and which method to believe."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.device import Hardware
from identification.errors import Finding
from identification.estimators import least_squares, output_error
from identification.estimators.delay import Delay, find_delay
from identification.estimators.model import Estimate, Model
from identification.estimators.noise import finest_reading
from identification.findings import judge
from identification.intervals import NORMAL_95, half_width
from identification.trajectory import Trajectory

#: Distance of a residual's cumulated spectrum from white up to which output error is believed.
#: Position noise and rounding give 0.005 to 0.04 (chance alone 0.05 in 2000 samples, once in a
#: hundred), forces unknown to the log 0.9 and more; already at 0.1, one device in two hundred lay
#: outside of its simultaneous region.
WHITE = 0.05
#: A residual of at most this many counts rms is the encoder's own, whatever its colour: rounding
#: alone is 0.289, and it is not white where the device moves slowly.
ENCODER_RESIDUAL = 0.295
#: A friction term smaller than its own standard deviation is left out. A higher hurdle would move
#: mass and damping by more than their intervals where the term is real.
ASKED_FOR = 1.0
#: Coulomb friction can be told from an offset if at least this part of the motion goes either way.
LEAST_RETURN = 0.01
#: Change of delay, in samples, for the slope of the estimates over delay.
_DELAY_STEP = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFit:
    """What one log said.

    Attributes:
        trajectory: the log, on the even time grid that was used.
        estimate: the one believed.
        others: estimates by the other methods that were tried.
        delay: read from the log, or None if it was stated.
        findings: about this log, those allowed among them as warnings.
        reason: why this method, a sentence.
    """

    trajectory: Trajectory
    estimate: Estimate
    others: tuple[Estimate, ...]
    delay: Delay | None
    findings: tuple[Finding, ...]
    reason: str

    @property
    def method(self) -> str:
        """Name of the method believed."""
        return self.estimate.method

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual, in the unit of ``estimate.residual_unit``."""
        return float(np.sqrt(np.mean(self.estimate.residual**2)))


def fit_log(trajectory: Trajectory, hardware: Hardware | None, method: str) -> LogFit:
    """Estimate mass, damping and friction from one log.

    Args:
        trajectory: on an even time grid.
        hardware: states the delay, if it does.
        method: "auto" or a key of estimators.METHODS.
    """
    model = _distinguishable(trajectory)
    found = None
    if hardware is None or hardware.delay is None:
        found = find_delay(trajectory, model)
        delay, doubt = found.value, found.deviation
    else:
        delay = hardware.delay.value
        doubt = (hardware.delay.high - hardware.delay.low) / (2 * NORMAL_95)
    step = _DELAY_STEP * trajectory.sample_time
    table = least_squares.prepare(trajectory, model, delay + step)
    regression = _with_doubt(table, least_squares.fit(table, delay), delay, doubt, step)
    simulated = None
    if method != "least-squares" and regression.value("mass") > 0:
        simulated = _with_doubt(table, output_error.fit(table, delay), delay, doubt, step)
    chosen, reason = _choose(trajectory, method, regression, simulated)
    chosen = _only_what_is_asked_for(table, chosen, delay)
    tried = (regression, simulated)
    return LogFit(
        trajectory=trajectory,
        estimate=chosen,
        others=tuple(each for each in tried if each and each.method != chosen.method),
        delay=found,
        findings=judge(trajectory, regression, chosen),
        reason=reason,
    )


def _distinguishable(trajectory: Trajectory) -> Model:
    """The terms a log can tell apart: motion one way only cannot split friction from offset."""
    steps = np.diff(trajectory.position)
    forth, back = np.sum(steps > 0), np.sum(steps < 0)
    return Model(coulomb=bool(min(forth, back) >= LEAST_RETURN * (forth + back)))


def _refit(table: least_squares.Regression, method: str, delay: float) -> Estimate:
    return (output_error if method == "output-error" else least_squares).fit(table, delay)


def _with_doubt(
    table: least_squares.Regression, estimate: Estimate, delay: float, doubt: float, step: float
) -> Estimate:
    """The estimate with the doubt about the delay in its covariance.

    A delay of d looks like an added damping of -m·ω²·d, so this is often most of the interval.
    """
    if doubt == 0:
        return estimate
    moved = _refit(table, estimate.method, delay + step)
    slope = (moved.values - estimate.values) / step
    return replace(estimate, covariance=estimate.covariance + doubt**2 * np.outer(slope, slope))


def _choose(
    trajectory: Trajectory, method: str, regression: Estimate, simulated: Estimate | None
) -> tuple[Estimate, str]:
    if simulated is None:
        asked = method == "least-squares"
        return regression, (
            "least squares as asked"
            if asked
            else "least squares, because it gives no positive mass to start output error from"
        )
    if method == "output-error":
        return simulated, "output error as asked"
    count = finest_reading(trajectory.position, trajectory.force)
    counts = float(np.sqrt(np.mean(simulated.residual**2))) / count
    seen = f"the residual of output error is {simulated.whiteness:.2f} from white"
    if simulated.whiteness <= WHITE:
        return simulated, f"output error, because {seen} (at most {WHITE:g})"
    if counts <= ENCODER_RESIDUAL:
        return simulated, (
            f"output error, because its residual is {counts:.2f} encoder counts rms "
            f"(at most {ENCODER_RESIDUAL:g}), no more than rounding"
        )
    return regression, (
        f"least squares, because {seen} (more than {WHITE:g}): forces act that the log does not "
        "know"
    )


def _only_what_is_asked_for(
    table: least_squares.Regression, estimate: Estimate, delay: float
) -> Estimate:
    """The estimate without friction terms that are nothing but noise.

    The covariance stays that of the whole model: leaving a term out must not make the others look
    better known than they are.
    """
    keep: dict[str, bool] = {}
    for field, name in (("coulomb", "coulomb_friction"), ("offset", "force_offset")):
        value, deviation = estimate.value(name), estimate.deviation(name)
        # Friction cannot be negative; an offset can.
        size = value if field == "coulomb" else abs(value)
        noise = -ASKED_FOR * deviation <= size < ASKED_FOR * deviation
        keep[field] = getattr(estimate.model, field) and not noise
    reduced = Model(coulomb=keep["coulomb"], offset=keep["offset"])
    if reduced == estimate.model:
        return estimate
    smaller = _refit(table.with_model(reduced), estimate.method, delay)
    values = np.array([smaller.value(name) for name in estimate.parameters])
    dropped = [name for name in estimate.parameters if name not in reduced.parameters]
    notes = tuple(
        f"{name} left out: {estimate.value(name):.2g} ± {half_width(estimate, name):.2g}"
        for name in dropped
    )
    return replace(
        estimate,
        values=values,
        residual=smaller.residual,
        explained=smaller.explained,
        whiteness=smaller.whiteness,
        notes=estimate.notes + notes,
    )
