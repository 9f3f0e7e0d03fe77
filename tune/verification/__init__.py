"""Verification: a closed-loop log of the real device against what its profile predicts."""

from __future__ import annotations

from tune.verification.advice import Advice, Play, advise
from tune.verification.comparison import Verification, verification_picture, verify
from tune.verification.delay import Kept, MeasuredDelay, margins_of_others
from tune.verification.law import Outcome

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
