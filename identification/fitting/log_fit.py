"""What one log said."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.estimators.least_squares import Delay
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from identification.fitting.dynamics import Dynamics
    from identification.fitting.friction_curve import FrictionCurve


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFit:
    """What one log said.

    Attributes:
        trajectory: the log.
        fitted: samples that the estimates were made of: all, or the most excited part.
        estimate: the one believed.
        others: estimates by the other methods that were tried.
        delay: read from the log; None if it was stated and the log does not contradict it.
        structure: which further terms sparse regression asks for, in words; "" where none pay.
        curve: friction beyond the model; None where the log shows none.
        dynamics: lag, vibration, play or load friction that was taken out; None for none.
        findings: about this log, those allowed among them as warnings.
        reason: why this method, a sentence.
    """

    trajectory: Trajectory
    fitted: int
    estimate: Estimate
    others: tuple[Estimate, ...]
    delay: Delay | None
    findings: tuple[Finding, ...]
    reason: str
    structure: str = ""
    curve: FrictionCurve | None = None
    dynamics: Dynamics | None = None

    @property
    def method(self) -> str:
        """Name of the method believed."""
        return self.estimate.method
