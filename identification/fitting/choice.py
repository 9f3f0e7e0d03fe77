"""Which method to believe, and why."""

from __future__ import annotations

import numpy as np

from identification.estimators.model import Estimate, Model
from identification.estimators.noise import encoder_count
from identification.estimators.shaping import is_coloured
from identification.fitting.workshop import Workshop

#: A residual of at most this many counts rms is the encoder's own, whatever its colour: rounding
#: alone is 0.289, and it is not white where the device moves slowly.
ENCODER_RESIDUAL = 0.295
#: Distance of a residual's cumulated spectrum from white up to which the intervals of output error
#: still hold, although an octave is in excess: what the model misses is then small beside noise.
NEARLY_WHITE = 0.025
#: ... or this over the root of half its rows, which white noise exceeds once in a hundred times.
WHITE_BY_CHANCE = 1.63
#: Two methods disagree if they differ by more than this many standard deviations of the difference
#: (Hausman, Econometrica 46, 1978, p. 1251); the wider of the two intervals is taken for it.
DISAGREEMENT = 3.0


def noise_explains(workshop: Workshop) -> str | None:
    """A sentence if position noise explains what output error leaves, or None.

    Gravity is taken at the measured position, and what noise does to it is a force of its own.
    """
    if workshop.model.gravity != "none":
        return None
    simulated = workshop.fit("output-error")
    if not is_coloured(simulated.residual):
        return "its residual is white in every octave"
    count = encoder_count(workshop.trajectory.position)
    counts = float(np.sqrt(np.mean(simulated.residual**2))) / (count or np.inf)
    if 0 < counts <= ENCODER_RESIDUAL:
        return (
            f"its residual is {counts:.2f} encoder counts rms (at most {ENCODER_RESIDUAL:g}), no "
            "more than rounding"
        )
    return None


def choose(workshop: Workshop, method: str) -> tuple[Estimate, str]:
    """The estimate to believe and a sentence why.

    Args:
        workshop: of one log.
        method: "auto" or a name of estimators.ESTIMATORS.
    """
    regression = workshop.fit("least-squares")
    if method == "least-squares":
        return regression, "least squares as asked"
    if regression.value("mass") <= 0:
        return regression, "least squares, because it gives no positive mass to start others from"
    if method != "auto":
        return workshop.fit(method), f"{method.replace('-', ' ')} as asked"
    return _under_gravity(workshop) if workshop.model.gravity != "none" else _evident(workshop)


def _evident(workshop: Workshop) -> tuple[Estimate, str]:
    """Output error where position noise explains what it leaves, or nearly so."""
    sentence = noise_explains(workshop)
    if sentence is not None:
        return workshop.fit("output-error"), f"output error, because {sentence}"
    chosen, reason = robust(workshop, workshop.model)
    simulated = workshop.fit("output-error")
    chance = WHITE_BY_CHANCE / np.sqrt(simulated.residual.size / 2)
    mild = simulated.whiteness <= max(NEARLY_WHITE, chance)
    if mild and _doubt(simulated) < _doubt(chosen) and not disagreement(simulated, chosen):
        return simulated, (
            f"output error, because its residual is only {simulated.whiteness:.2f} from white and "
            f"its intervals, which carry that, are narrower than those of {chosen.method}"
        )
    return chosen, reason


def _under_gravity(workshop: Workshop) -> tuple[Estimate, str]:
    """Weak form where position noise explains all, as it knows what gravity makes of that noise."""
    tested = workshop.fit("weak")
    explained = not tested.open_loop_only and not is_coloured(tested.residual)
    regression = workshop.fit("least-squares")
    if explained and tested.value("mass") > 0 and not disagreement(tested, regression):
        return tested, (
            "weak form, because noise of the position at which gravity is taken explains its "
            "residual"
        )
    return robust(workshop, workshop.model)


def _doubt(estimate: Estimate) -> float:
    """Area of the joint region of mass and damping, up to a factor."""
    return float(np.linalg.det(estimate.covariance[:2, :2]))


def robust(workshop: Workshop, model: Model) -> tuple[Estimate, str]:
    """The estimate to believe where forces act that the log does not know.

    Innovations weigh every frequency by what it tells, so they are best where the model is right.
    Where it is not (friction that no sign of the velocity describes), they follow its errors at
    high frequencies; least squares stays where the motion is. The two then disagree, which is
    Hausman's test, and the estimate that leans on less is taken.
    """
    regression = workshop.refit("least-squares", model)
    predicted = workshop.refit("innovations", model)
    apart = disagreement(predicted, regression)
    if predicted.value("mass") > 0 and not apart:
        return predicted, (
            "innovations, because forces act that the log does not know: position noise does not "
            "explain what output error leaves"
        )
    reason = (
        f"because innovations say {apart}: the friction or another force is not what the model has"
    )
    if workshop.has_reference:
        # What follows a set-point is free of the noise that a feedback puts into the force.
        instrumental = workshop.refit("instruments", model)
        if predicted.value("mass") > 0 and not disagreement(predicted, instrumental):
            return predicted, (
                f"innovations, which instruments confirm: {apart} of least squares, which noise "
                "in the force biases"
            )
        apart = disagreement(instrumental, regression)
        if apart and instrumental.value("mass") > 0:
            return instrumental, f"instruments, {reason}, and instruments {apart}"
    return regression, f"least squares, {reason}"


def disagreement(one: Estimate, other: Estimate) -> str:
    """Mass and damping of two methods that differ by more than chance; "" if they agree."""
    return ", ".join(
        f"{name} {one.value(name):.4g} instead of {other.value(name):.4g}"
        for name in ("mass", "damping")
        if abs(one.value(name) - other.value(name))
        > DISAGREEMENT * max(one.deviation(name), other.deviation(name))
    )
