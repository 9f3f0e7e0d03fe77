"""What a log may be of, the moments of a profile; and outcomes: is it as the profile predicts?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from identification import UsageError
from tune.documents.effects import EFFECT_NAMES, Effects
from tune.documents.profile import Design

Verdict = Literal["agrees", "disagrees", "cannot tell", "not assessed"]
Moment = tuple[str, ...]

#: Joins the elements of one moment, on the command line and in sentences.
_AND = "+"


def moments_of(profile: Design, element: str | None) -> tuple[Moment, ...]:
    """Every moment the log may be of: all of them, or the one named "wall" or "wall+water".

    Raises:
        UsageError: no such element, or elements that are not felt together.
    """
    every = profile.moments()
    told = tuple(
        moment
        for moment in every
        if any(size is not None for size in effects_of(profile, moment).arrays())
    )
    if element is None:
        return told
    wanted = frozenset(element.split(_AND))
    found = tuple(moment for moment in every if frozenset(moment) == wanted)
    if not found or found[0] not in told:
        known = ", ".join(moment_in_words(moment) for moment in told)
        problem = "plays nothing" if found else "is not in the profile"
        raise UsageError("--element", f"'{element[:80]}' {problem}", f"Choose from {known}")
    return found


def effects_of(profile: Design, moment: Moment) -> Effects:
    """The sum of the effects of a moment; what sums to zero is not there."""
    sums = {
        name: sum(float(getattr(profile.elements[each], name)) for each in moment)
        for name in EFFECT_NAMES
    }
    return Effects(**{name: value or None for name, value in sums.items()})


def scale_effects(effects: Effects, gain: float) -> Effects:
    """Effects at a gain; what is not there stays away."""
    K, B, M = (None if size is None else float(size) * gain for size in effects.arrays())
    return Effects(stiffness=K, damping=B, mass=M)


def moment_in_words(moment: Moment) -> str:
    """The name of a moment."""
    return _AND.join(moment)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One comparison of a log with its profile.

    Attributes:
        check: what was compared: "encoder", "law", "gain", "velocity filter",
            "acceleration filter", "frequency", "decay", "ripple" or "delay".
        verdict: "agrees" and "disagrees" only where both sides were computed; "cannot tell" where
            what is predicted is possible, and so is what must not be.
        seen: what the log shows; the reason where nothing was assessed.
        predicted: what the profile predicts; "" where that was not computed.
        tolerance: what is allowed between the two; "" likewise.
        remedy: what to do about a disagreement, or to have it assessed; "" otherwise.
        numbers: those in the words, by name, in the units of the words; parts of 1 for percent.
    """

    check: str
    verdict: Verdict
    seen: str
    predicted: str = ""
    tolerance: str = ""
    remedy: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def told(self) -> str:
        """What was found, in one short line without the remedy."""
        if self.verdict == "not assessed":
            return f"{self.check}: not assessed: {self.seen}"
        return f"{self.check} {self.verdict}: {self.seen}; predicted: {self.predicted}"

    def __str__(self) -> str:
        allowed = "" if self.verdict == "not assessed" else f" ({self.tolerance})"
        return f"{self.told}{allowed}. {self.remedy}".rstrip()


def unassessed_outcome(check: str, why: str, remedy: str = "", **numbers: float) -> Outcome:
    """Nothing is claimed, and why; with the numbers that the words name."""
    return Outcome(check=check, verdict="not assessed", seen=why, remedy=remedy, numbers=numbers)
