"""Reasons why an effect cannot be kept, and what is said of one below one perceived step."""

from __future__ import annotations

import numpy as np

from tune.documents.profile import LimitedBy
from tune.optimisation.bounds import largest_allowed
from tune.optimisation.describe import bindings
from tune.optimisation.limits import stable_points
from tune.optimisation.problem import Problem
from tune.optimisation.unknown import Unknown

#: Steps that are not worth a number.
_NOTHING = 1e-3


def reasons_for_nothing(problem: Problem) -> dict[str, str]:
    """Why effects cannot be kept whatever the others are, by label; empty where all may."""
    reasons: dict[str, str] = {}
    weakest = problem.region.box.damping[0]
    gain, extra = problem.margin.gain, problem.margin.extra_delay_samples
    limits = problem.limits
    nothing = np.zeros(len(problem.unknowns))
    for index, unknown in enumerate(problem.unknowns):
        if unknown.settled:
            continue
        most = problem.linear.bounds(nothing, index).get("force", np.inf)
        top = min(unknown.high, most)
        if unknown.high <= 0:
            reasons[unknown.label] = (
                f"the device may have as little as {unknown.high * gain:.4g} to take away from, "
                f"with a gain margin of {gain:g} at most {max(unknown.high, 0):.4g}"
            )
        elif unknown.low > top and _NOTHING < unknown.steps(top) < 1:
            word = _word_of_high(unknown) if top == unknown.high else "force"
            reasons[unknown.label] = imperceptible(unknown, top, word)
        elif unknown.low > top:
            reasons[unknown.label] = (
                f"even {unknown.low:.4g} exceeds the force limit, {limits.continuous_force:g} "
                f"continuous and {limits.peak_force:g} at the peak; at most {most:.4g} keeps to it "
                "in this motion. Ask for less"
            )
        elif weakest <= 0 and not _helped(problem, index):
            reasons[unknown.label] = (
                f"the lowest damping of the device is {weakest:.4g}, not positive; nothing but "
                "its damping would hold this effect. Take a longer log, or add damping"
            )
        elif len(problem.unknowns) == 1:
            alone = largest_allowed(problem, nothing, 0)
            if alone < unknown.low and stable_points(problem, np.array([[unknown.low]]), gain)[0]:
                sizes = np.array([alone])
                reasons[unknown.label] = imperceptible(
                    unknown, alone, bindings(problem, sizes, [0])[0]
                )
            elif alone < unknown.low and unknown.wish.kind == "range" and unknown.wish.low:
                reasons[unknown.label] = (
                    f"even {unknown.low:.4g} is not stable with a gain margin of {gain:g} and "
                    f"{extra} extra samples of delay"
                )
            elif alone < unknown.low:
                sizes = np.array([alone])
                word = bindings(problem, sizes, [0])[0] if alone else "stability"
                reasons[unknown.label] = imperceptible(unknown, alone, word)
    return reasons


def _word_of_high(unknown: Unknown) -> LimitedBy:
    """What the largest size that is wanted of an unknown comes from."""
    words: dict[str, LimitedBy] = {"value": "wanted", "range": "range"}
    return words.get(unknown.wish.kind, "gain-margin")


def imperceptible(unknown: Unknown, size: float, word: LimitedBy) -> str:
    """What is said of a size that is less than one step."""
    return (
        f"{unknown.sign * size:.4g} would be {unknown.steps(size):.2g} of a step a hand can tell, "
        f"limited by {word}"
    )


def _helped(problem: Problem, index: int) -> bool:
    """True where a positive damper of the same element is there to hold the effect."""
    unknown = problem.unknowns[index]
    return problem.region.box.damping[0] == 0 and any(
        other.element == unknown.element and other.effect == "damping" and other.sign > 0
        for other in problem.unknowns
    )
