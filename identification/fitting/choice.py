"""Which method to believe, and why.

One file: one decision, test after test, in the order in which they are made.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.estimators.estimate import Estimate, Model
from identification.estimators.filters import is_coloured
from identification.estimators.least_squares import CUT_OFF_RANGE
from identification.estimators.signals import encoder_count
from identification.findings.force_balance import balance_of
from identification.findings.inertia import inertia_of
from identification.fitting.hausman import contradiction, region
from identification.fitting.prepared_log import PreparedLog

#: A residual of at most this many counts rms is the encoder's own, whatever its colour: rounding
#: alone is 0.289, and it is not white where the device moves slowly.
ENCODER_RESIDUAL = 0.295
#: Distance of a residual's cumulated spectrum from white up to which the intervals of output error
#: still hold, although an octave is in excess: what the model misses is then small beside noise.
NEARLY_WHITE = 0.025
#: ... or this over the root of half its rows, which white noise exceeds once in a hundred times.
WHITE_BY_CHANCE = 1.63
#: Methods whose answers are heard where another is believed; output error and the weak form are
#: astray where they are not believed.
CONSULTED = ("innovations", "instruments")
#: Instruments whose joint region is this many times that of least squares have nothing to say
#: against an estimate that least squares would.
_POWERLESS = 2.0
#: Areas of two regions, each of jackknifed variances, are told apart below this ratio.
_SHARPER = 0.75


def noise_explains(prepared: PreparedLog) -> str | None:
    """A sentence if position noise explains what output error leaves, or None.

    Gravity is taken at the measured position, and what noise does to it is a force of its own.
    Where least squares give no positive mass there is nothing to start output error from.
    """
    if prepared.model.gravity != "none" or prepared.fit("least-squares").value("mass") <= 0:
        return None
    simulated = prepared.fit("output-error")
    if not is_coloured(simulated.residual):
        return "its residual is white in every octave"
    count = encoder_count(prepared.trajectory.position)
    counts = float(np.sqrt(np.mean(simulated.residual**2))) / (count or np.inf)
    if 0 < counts <= ENCODER_RESIDUAL:
        return (
            f"its residual is {counts:.2f} encoder counts rms (at most {ENCODER_RESIDUAL:g}), no "
            "more than rounding"
        )
    return None


def choose(prepared: PreparedLog, method: str, explained: str | None) -> tuple[Estimate, str]:
    """The estimate to believe and a sentence why.

    Args:
        prepared: of one log.
        method: "auto" or a name of estimators.ESTIMATORS.
        explained: what ``noise_explains`` says of the log.
    """
    regression = prepared.fit("least-squares")
    if method == "least-squares":
        return regression, "least squares as asked"
    if regression.value("mass") <= 0:
        return regression, "least squares, because it gives no positive mass to start others from"
    if method != "auto":
        return prepared.fit(method), f"{method.replace('-', ' ')} as asked"
    if prepared.model.gravity != "none":
        return _under_gravity(prepared)
    return _evident(prepared, explained)


def _evident(prepared: PreparedLog, explained: str | None) -> tuple[Estimate, str]:
    """Output error where position noise explains what it leaves, or nearly so."""
    if explained is not None and not _contradicted_by_instruments(prepared):
        return prepared.fit("output-error"), f"output error, because {explained}"
    chosen, reason = robust(prepared, prepared.model)
    simulated = prepared.fit("output-error")
    chance = WHITE_BY_CHANCE / np.sqrt(simulated.residual.size / 2)
    mild = simulated.whiteness <= max(NEARLY_WHITE, chance)
    if mild and region(simulated) < region(chosen) and not contradiction(simulated, chosen):
        return simulated, (
            f"output error, because its residual is only {simulated.whiteness:.2f} from white and "
            f"its intervals, which carry that, are narrower than those of {chosen.method}"
        )
    return chosen, reason


def _contradicted_by_instruments(prepared: PreparedLog) -> bool:
    """Whether a logged reference tells another mass or damping than output error."""
    if not prepared.has_reference:
        return False
    instrumental = prepared.fit("instruments")
    simulated = prepared.fit("output-error")
    return instrumental.value("mass") > 0 and bool(contradiction(simulated, instrumental))


def _under_gravity(prepared: PreparedLog) -> tuple[Estimate, str]:
    """Weak form where position noise explains all, as it knows what gravity makes of that noise."""
    tested = prepared.fit("weak")
    explained = not tested.open_loop_only and not is_coloured(tested.residual)
    regression = prepared.fit("least-squares")
    sharper = tested.value("mass") > 0 and region(tested) <= region(regression)
    if explained and sharper and not contradiction(tested, regression):
        return tested, (
            "weak form, because noise of the position at which gravity is taken explains its "
            "residual"
        )
    return robust(prepared, prepared.model)


def robust(prepared: PreparedLog, model: Model) -> tuple[Estimate, str]:
    """The estimate to believe where forces act that the log does not know.

    Innovations weigh every frequency by what it tells, so they are best where the model is right.
    Where it is not (friction that no sign of the velocity describes), they follow its errors at
    high frequencies; least squares stays where the motion is, and instruments from a logged
    reference are free, besides, of the noise that a feedback puts into the force. So the estimate
    that leans on least comes first, and another takes its place only if its joint region of mass
    and damping is no larger and Hausman's test finds no contradiction.
    """
    leaning_least = _robust_ones(prepared, model)
    judge, at_hand = leaning_least[0], _at_hand(leaning_least)
    predicted = prepared.refit("innovations", model)
    apart = contradiction(predicted, judge)
    sharper = predicted.value("mass") > 0 and region(predicted) <= region(at_hand)
    verdict = _verdict(prepared, predicted, at_hand) if sharper else ""
    if verdict:
        return (predicted if verdict == "innovations" else at_hand), (
            f"{verdict}, because the mass that rows at equal velocity tell contradicts the other"
        )
    if sharper and not apart:
        return predicted, (
            "innovations, because forces act that the log does not know: position noise does not "
            f"explain what output error leaves, and {_named(judge)} do not contradict"
        )
    why = "innovations know mass and damping less well"
    if apart:
        why = (
            f"innovations say {apart} of {_named(judge)}: the friction or another force is not "
            "what the model has"
        )
    if prepared.has_reference and len(leaning_least) == 1 and judge.method == "instruments":
        why += "; least squares, which noise in the force biases, contradict instruments"
    return at_hand, f"{_named(at_hand)}, because {why}"


def _at_hand(leaning_least: tuple[Estimate, ...]) -> Estimate:
    """Least squares where they are not contradicted, or instruments where those are sharper."""
    usual = max(leaning_least, key=lambda each: each.method == "least-squares")
    sharpest = min(leaning_least, key=region)
    return sharpest if region(sharpest) < _SHARPER * region(usual) else usual


def _verdict(prepared: PreparedLog, predicted: Estimate, at_hand: Estimate) -> str:
    """Name of the one of two estimates that force at equal velocity leaves; "" if both or none."""
    judge = inertia_of(balance_of(prepared.trajectory, predicted))
    if judge is None or judge.contradicts(predicted) == judge.contradicts(at_hand):
        return ""
    return _named(at_hand) if judge.contradicts(predicted) else _named(predicted)


def over_cut_offs(prepared: PreparedLog, estimate: Estimate) -> Estimate:
    """Instruments with what half and twice the cut-off move, as least squares have it already."""
    if estimate.method != "instruments" or estimate.leaning is not None:
        return estimate
    table = prepared.table
    frequency = table.cut_off.frequency
    low, high = (
        prepared.point(table.at_cut_off(factor * frequency), "instruments").values
        for factor in (1 / CUT_OFF_RANGE, CUT_OFF_RANGE)
    )
    leaning = (high - low) / 2
    covariance = estimate.covariance + np.outer(leaning, leaning)
    return replace(estimate, covariance=covariance, leaning=leaning)


def _robust_ones(prepared: PreparedLog, model: Model) -> tuple[Estimate, ...]:
    """Estimates that do not lean on what colours the rest; the first judges the others.

    Instruments where a reference is logged, unless they know so little that they could not
    contradict, and least squares unless instruments contradict them.
    """
    regression = prepared.refit("least-squares", model)
    if not prepared.has_reference:
        return (regression,)
    # What follows a set-point is free of the noise that a feedback puts into the force.
    instrumental = prepared.refit("instruments", model)
    if instrumental.value("mass") <= 0:
        return (regression,)
    if contradiction(regression, instrumental):
        return (instrumental,)
    if region(instrumental) <= _POWERLESS * region(regression):
        return instrumental, regression
    return regression, instrumental


def _named(estimate: Estimate) -> str:
    return estimate.method.replace("-", " ")
