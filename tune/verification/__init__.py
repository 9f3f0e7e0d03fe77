"""Verification: a closed-loop log of the real device against what its profile predicts."""

from __future__ import annotations

from tune.verification.advice import Advice, advise
from tune.verification.comparison import Verification, verify
from tune.verification.margins_kept import Kept
from tune.verification.measured_delay import MeasuredDelay, margins_of_others
from tune.verification.outcome import Outcome
from tune.verification.picture import verification_picture
from tune.verification.plays import Play

__all__ = [
    "Advice",
    "Kept",
    "MeasuredDelay",
    "Outcome",
    "Play",
    "Verification",
    "advise",
    "margins_of_others",
    "verification_picture",
    "verify",
]
