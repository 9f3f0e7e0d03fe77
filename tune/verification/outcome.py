"""Outcome: one thing a log was compared on, and whether it is as the profile predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Verdict = Literal["agrees", "disagrees", "cannot tell", "not assessed"]


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
