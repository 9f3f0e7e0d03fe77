"""One log to one estimate: delay, terms of the model, and which method to believe."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.estimators.least_squares import Delay
from identification.findings import judge
from identification.fitting.choice import CONSULTED, choose, noise_explains, over_cut_offs
from identification.fitting.excited_part import most_excited
from identification.fitting.prepared_log import PreparedLog
from identification.fitting.selection import (
    add_paying_terms,
    distinguishable_terms,
    drop_noise_terms,
)
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from identification.structure.friction_curve import FrictionCurve
    from identification.structure.stability_selection import Structure


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFit:
    """What one log said.

    Attributes:
        trajectory: the log.
        fitted: samples that the estimates were made of: all, or the most excited part.
        estimate: the one believed.
        others: estimates by the other methods that were tried.
        delay: read from the log, or None if it was stated.
        structure: which terms sparse regression asks for; None where nothing called for it.
        curve: friction beyond the model; None where the log shows none.
        findings: about this log, those allowed among them as warnings.
        reason: why this method, a sentence.
    """

    trajectory: Trajectory
    fitted: int
    estimate: Estimate
    others: tuple[Estimate, ...]
    delay: Delay | None
    findings: tuple[Finding, ...]
    reason: str
    structure: Structure | None = None
    curve: FrictionCurve | None = None

    @property
    def method(self) -> str:
        """Name of the method believed."""
        return self.estimate.method


def fit_log(trajectory: Trajectory, hardware: Hardware | None, method: str) -> LogFit:
    """Estimate mass, damping and friction from one log.

    Args:
        trajectory: time stamps are used as they are.
        hardware: states the delay, if it does.
        method: "auto" or a name of estimators.ESTIMATORS.
    """
    stated = None if hardware is None else hardware.delay
    part = most_excited(trajectory)
    prepared, structure = PreparedLog.of(part, distinguishable_terms(part), stated), None
    explained = noise_explains(prepared)
    if explained is None:
        plain = prepared
        prepared, structure = add_paying_terms(plain)
        explained = None if prepared is plain else noise_explains(prepared)
    regression = prepared.fit("least-squares")
    chosen, reason = choose(prepared, method, explained)
    chosen = drop_noise_terms(prepared, over_cut_offs(prepared, chosen))
    curve = _friction_curve(prepared) if explained is None else None
    beyond: tuple[Finding, ...] = ()
    if curve is not None:
        from identification.findings.unmodelled import unmodelled

        chosen = _with_mass_of(curve, chosen)
        beyond = unmodelled(trajectory, chosen, curve.found, curve.slope, curve.fastest)
    if len(part) < len(trajectory):
        reason += f"; from the {len(part)} samples that move most of {len(trajectory)}"
    delay = _delay(prepared, chosen)
    others = tuple(each for each in prepared.fitted if each.method != chosen.method)
    consulted = [each for each in others if each.method in CONSULTED]
    return LogFit(
        trajectory=trajectory,
        fitted=len(part),
        estimate=chosen,
        others=others,
        delay=delay,
        findings=judge(trajectory, regression, chosen, delay=delay, consulted=consulted) + beyond,
        reason=reason,
        structure=structure,
        curve=curve,
    )


def _delay(prepared: PreparedLog, chosen: Estimate) -> Delay | None:
    """The delay as the chosen method knows it best."""
    if prepared.found is None or chosen.delay_deviation is None:
        return prepared.found
    return replace(prepared.found, value=chosen.delay, deviation=chosen.delay_deviation)


def _friction_curve(prepared: PreparedLog) -> FrictionCurve | None:
    """What the residual of a log holds beside noise, where noise does not explain it."""
    if prepared.fit("least-squares").value("mass") <= 0:
        return None
    from identification.structure.friction_curve import friction_curve

    return friction_curve(prepared.table, prepared.delay)


def _with_mass_of(curve: FrictionCurve, estimate: Estimate) -> Estimate:
    """The estimate with the mass that the friction found leaves, known no better than before.

    Damping stays the constant that explains the log best; its slope is the curve's.
    """
    if curve.mass <= 0:
        return estimate
    values, covariance = estimate.values.copy(), estimate.covariance.copy()
    values[0] = curve.mass
    before = estimate.deviation("mass")
    deviation = max(before, curve.mass_deviation)
    factor = deviation / before if before > 0 else 0.0
    covariance[0, :] *= factor
    covariance[:, 0] *= factor
    covariance[0, 0] = deviation**2
    note = f"mass {estimate.value('mass'):.5g} without the friction found beyond the model"
    return replace(estimate, values=values, covariance=covariance, notes=(*estimate.notes, note))
