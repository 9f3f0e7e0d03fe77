"""One log to one estimate: its most excited part, the terms it asks for, the method believed."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from identification.device.hardware import Hardware
from identification.errors import Finding
from identification.estimators.estimate import Estimate, Gravity, Model, half_width
from identification.estimators.least_squares import Delay
from identification.findings import judge
from identification.fitting.choice import (
    CONSULTED,
    PreparedLog,
    choose,
    noise_explains,
    over_cut_offs,
    robust,
)
from identification.trajectory import Trajectory, position_noise

if TYPE_CHECKING:
    from identification.fitting.friction_curve import FrictionCurve
    from identification.fitting.stability_selection import Structure


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
    """Estimate mass, damping and friction from one log."""
    stated = None if hardware is None else hardware.delay
    part = most_excited(trajectory)
    prepared, structure = PreparedLog.of(part, distinguishable_terms(part), stated), None
    explained = noise_explains(prepared)
    if explained is None:
        plain = prepared
        prepared, structure = _add_paying_terms(plain)
        explained = None if prepared is plain else noise_explains(prepared)
    regression = prepared.fit("least-squares")
    chosen, reason = choose(prepared, method, explained)
    chosen = _drop_noise_terms(prepared, over_cut_offs(prepared, chosen))
    curve = _friction_curve(prepared) if explained is None else None
    beyond: tuple[Finding, ...] = ()
    if curve is not None:
        from identification.findings.forces import unmodelled

        chosen = _with_mass_of(curve, chosen)
        beyond = tuple(unmodelled(trajectory, chosen, curve.found, curve.slope, curve.fastest))
    if len(part) < len(trajectory):
        reason += f"; from the {len(part)} samples that move most of {len(trajectory)}"
    delay = prepared.found
    if delay is not None and chosen.delay_deviation is not None:  # the chosen method knows it best
        delay = replace(delay, value=chosen.delay, deviation=chosen.delay_deviation)
    others = tuple(each for each in prepared.made.values() if each.method != chosen.method)
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


def _friction_curve(prepared: PreparedLog) -> FrictionCurve | None:
    """What the residual of a log holds beside noise, where noise does not explain it."""
    if prepared.fit("least-squares").value("mass") <= 0:
        return None
    from identification.fitting.friction_curve import friction_curve

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


#: Samples an estimate is made of at most: eight minutes at 1 kHz, where noise has long ceased to
#: limit the intervals. Estimators hold up to a hundred numbers a sample.
MOST_FITTED = 500_000


def most_excited(trajectory: Trajectory) -> Trajectory:
    """The consecutive MOST_FITTED samples with the largest mean square velocity.

    A shorter log is returned whole. Findings still look at the whole log, so a device that changed
    in the part left out is seen.
    """
    spare = len(trajectory) - MOST_FITTED
    if spare <= 0:
        return trajectory
    # Neighbours overlap by half.
    starts = np.linspace(0, spare, 1 + int(np.ceil(2 * spare / MOST_FITTED))).astype(np.intp)
    parts = [slice(int(start), int(start) + MOST_FITTED) for start in starts]

    def mean_square_velocity(rows: slice) -> float:
        velocity = np.diff(trajectory.position[rows]) / np.diff(trajectory.time[rows])
        return float(np.mean(velocity**2))

    return trajectory.part(max(parts, key=mean_square_velocity))


#: Coulomb friction can be told from an offset if at least this part of the motion goes either way.
_LEAST_RETURN = 0.01
#: A step is motion if it exceeds this many standard deviations of the noise of one reading, ...
_CLEAR = 5.0
#: ... over as many samples, doubled up to this part of the log, as make this part of steps motion.
_LONGEST_SPAN = 0.01
_ENOUGH = 0.5
#: A friction term smaller than its own standard deviation is left out. A higher hurdle would move
#: mass and damping by more than their intervals where the term is real.
_ASKED_FOR = 1.0
#: Friction cannot be negative. Down to this many deviations below zero it is nothing but chance;
#: below that something else is wrong, and it stays for all to see.
_NEGATIVE_BY_CHANCE = 3.0
#: Sine and cosine of the position are told from a straight line over this range, rad.
_WIDE_SWING = 0.5


def distinguishable_terms(trajectory: Trajectory) -> Model:
    """Friction and offset, if the log can tell them apart: motion one way only cannot.

    Noise of the readings steps both ways; only steps beyond it are motion.
    """
    place = trajectory.position
    clear = _CLEAR * position_noise(place, trajectory.force)
    span, steps = 1, np.diff(place)
    while np.mean(np.abs(steps) > clear) < _ENOUGH and 2 * span <= _LONGEST_SPAN * place.size:
        span *= 2
        steps = place[span:] - place[:-span]
    forth, back = np.sum(steps > clear), np.sum(steps < -clear)
    return Model(coulomb=bool(min(forth, back) >= _LEAST_RETURN * (forth + back)))


def _add_paying_terms(prepared: PreparedLog) -> tuple[PreparedLog, Structure | None]:
    """The log with those further terms that pay for themselves, and what sparse regression says.

    For a log of which position noise does not explain all. Direction-dependent friction and
    gravity are fitted as well, and a term stays if the square of its value over its deviation
    exceeds the logarithm of the number of rows, its price in Schwarz's criterion (Annals of
    Statistics 6, 1978, p. 461), and if sparse regression on resampled halves of the log asks for
    it too. The deviation is robust, so colour does not buy a term. It has to pay in
    least squares, which cost little and see what the sparse regression sees, before it is put
    into the model of a dearer method.
    """
    model, trajectory = prepared.model, prepared.trajectory
    plausible = prepared.fit("least-squares").value("mass") > 0
    gravity: Gravity = "proportional"
    if trajectory.motion == "rotary" and np.ptp(trajectory.position) > _WIDE_SWING:
        gravity = "pendulum"
    largest = replace(model, directional=model.coulomb and model.offset, gravity=gravity)
    wide = prepared.widened(largest)
    groups = [
        names
        for names in (("damping_asymmetry",), largest.of_gravity)
        if set(names) <= set(largest.parameters) and _pays(wide.fit("least-squares"), names)
    ]
    if not groups:
        return prepared, None
    wide = wide.narrowed(_with(model, [name for names in groups for name in names], gravity))
    estimate, _ = robust(wide, wide.model)
    paying = {names: _pays(estimate, names) for names in groups}
    # A controller looks like a spring against the motion: only a weight may turn the sign of mass.
    weight = gravity == "pendulum" or estimate.value("position_stiffness") > 0
    if not any(paying.values()) or not (plausible or (estimate.value("mass") > 0 and weight)):
        return prepared, None
    second_opinion = _sparse_regression(wide)
    asked = [
        name
        for names, pays in paying.items()
        for name in names
        if pays and (second_opinion is None or set(names) & set(second_opinion.asked))
    ]
    found = _with(model, asked, gravity)
    return prepared if found == model else wide.narrowed(found), second_opinion


def _with(model: Model, names: Collection[str], gravity: Gravity) -> Model:
    """The model with those further terms."""
    of_gravity = replace(model, gravity=gravity).of_gravity
    return replace(
        model,
        directional="damping_asymmetry" in names,
        gravity=gravity if set(of_gravity) <= set(names) else "none",
    )


def _sparse_regression(prepared: PreparedLog) -> Structure | None:
    """What sparse regression finds in the log; None if the log is too short for it."""
    from identification.fitting.stability_selection import structure_of

    try:
        return structure_of(
            prepared.table, prepared.delay, rotary=prepared.trajectory.motion == "rotary"
        )
    except ValueError:
        return None


def _pays(estimate: Estimate, names: tuple[str, ...]) -> bool:
    index = [estimate.parameters.index(name) for name in names]
    values = estimate.values[index]
    inverse = np.linalg.pinv(estimate.covariance[np.ix_(index, index)], hermitian=True)
    return bool(values @ inverse @ values > np.log(estimate.residual.size) * len(index))


def _drop_noise_terms(prepared: PreparedLog, estimate: Estimate) -> Estimate:
    """The estimate without friction terms that are nothing but noise.

    The covariance stays that of the whole model: leaving a term out must not make the others look
    better known than they are.
    """
    model = estimate.model
    if model.directional:
        return estimate
    keep: dict[str, bool] = {}
    for field, name in (("coulomb", "coulomb_friction"), ("offset", "force_offset")):
        value, deviation = estimate.value(name), estimate.deviation(name)
        lowest = -_NEGATIVE_BY_CHANCE if field == "coulomb" else -_ASKED_FOR
        noise = lowest * deviation <= value < _ASKED_FOR * deviation
        keep[field] = getattr(model, field) and not noise
    reduced = replace(model, coulomb=keep["coulomb"], offset=keep["offset"])
    if reduced == model:
        return estimate
    smaller = prepared.point(prepared.table.with_model(reduced), estimate.method)
    left = dict(zip(reduced.parameters, smaller.values.tolist(), strict=True))
    values = np.array([left.get(name, 0.0) for name in estimate.parameters])
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
        notes=estimate.notes + notes,
    )
