"""Verification: a closed-loop log of the real device against what its profile predicts."""

from __future__ import annotations

from tune.verification.comparison import Verification, verify
from tune.verification.outcome import Outcome
from tune.verification.picture import verification_picture

__all__ = ["Outcome", "Verification", "verification_picture", "verify"]
