"""Which terms a log asks for: friction and offset, and more where the rest says so."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from identification.estimators.estimate import Estimate, Gravity, Model, half_width
from identification.estimators.signals import position_noise
from identification.fitting.choice import robust
from identification.fitting.prepared_log import PreparedLog
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from identification.structure.stability_selection import Structure

#: Coulomb friction can be told from an offset if at least this part of the motion goes either way.
LEAST_RETURN = 0.01
#: A step is motion if it exceeds this many standard deviations of the noise of one reading, ...
_CLEAR = 5.0
#: ... over as many samples, doubled up to this part of the log, as make this part of steps motion.
_LONGEST_SPAN = 0.01
_ENOUGH = 0.5
#: A friction term smaller than its own standard deviation is left out. A higher hurdle would move
#: mass and damping by more than their intervals where the term is real.
ASKED_FOR = 1.0
#: Friction cannot be negative. Down to this many deviations below zero it is nothing but chance;
#: below that something else is wrong, and it stays for all to see.
NEGATIVE_BY_CHANCE = 3.0
#: Sine and cosine of the position are told from a straight line over this range, rad.
WIDE_SWING = 0.5


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
    return Model(coulomb=bool(min(forth, back) >= LEAST_RETURN * (forth + back)))


def add_paying_terms(prepared: PreparedLog) -> tuple[PreparedLog, Structure | None]:
    """The log with those further terms that pay for themselves, and what sparse regression says.

    For a log of which position noise does not explain all. Direction-dependent friction and
    gravity are fitted as well, and a term stays if the square of its value over its deviation
    exceeds the logarithm of the number of rows, its price in Schwarz's criterion (Annals of
    Statistics 6, 1978, p. 461), and if sparse regression on resampled halves of the log asks for
    it too (structure.py). The deviation is robust, so colour does not buy a term. It has to pay in
    least squares, which cost little and see what the sparse regression sees, before it is put
    into the model of a dearer method.
    """
    model, trajectory = prepared.model, prepared.trajectory
    plausible = prepared.fit("least-squares").value("mass") > 0
    gravity: Gravity = "proportional"
    if trajectory.motion == "rotary" and np.ptp(trajectory.position) > WIDE_SWING:
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
    from identification.structure.stability_selection import structure_of

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


def drop_noise_terms(prepared: PreparedLog, estimate: Estimate) -> Estimate:
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
        lowest = -NEGATIVE_BY_CHANCE if field == "coulomb" else -ASKED_FOR
        noise = lowest * deviation <= value < ASKED_FOR * deviation
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
