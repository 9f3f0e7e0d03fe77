"""Outcome: one thing a log was compared on, and whether it is as the profile predicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["agrees", "disagrees", "not assessed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One comparison of a log with its profile.

    Attributes:
        check: what was compared: "encoder", "law", "gain", "frequency", "decay" or "ripple".
        verdict: "agrees" and "disagrees" only where both sides were computed.
        seen: what the log shows; the reason where nothing was assessed.
        predicted: what the profile predicts; "" where that was not computed.
        tolerance: what is allowed between the two; "" likewise.
        remedy: what to do about a disagreement, or to have it assessed; "" otherwise.
    """

    check: str
    verdict: Verdict
    seen: str
    predicted: str = ""
    tolerance: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        if self.verdict == "not assessed":
            return f"{self.check}: not assessed: {self.seen}. {self.remedy}".rstrip()
        said = f"{self.check} {self.verdict}: {self.seen}; predicted: {self.predicted}"
        return f"{said} ({self.tolerance}). {self.remedy}".rstrip()


def not_assessed(check: str, why: str, remedy: str = "") -> Outcome:
    """Nothing is claimed, and why."""
    return Outcome(check=check, verdict="not assessed", seen=why, remedy=remedy)
