"""What one log said, and the dynamics that it shows beside a rigid device."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from identification.device.hardware import Mode
from identification.device.quantities import Quantity
from identification.errors import Finding
from identification.estimators.estimate import Estimate
from identification.estimators.least_squares import Delay
from identification.trajectory import NORMAL_95, ComplexArray, FloatArray, Trajectory

if TYPE_CHECKING:
    from identification.fitting.friction_curve import FrictionCurve


@dataclass(frozen=True, slots=True, kw_only=True)
class Dynamics:
    """What one log shows between force and position beside a rigid device."""

    log: Trajectory  # with the force that a rigid device would have needed
    doubt: FloatArray  # covariance that its parameters add to those of the model, shape (p, p)
    left: float = 0.0  # part of the residual that may still move mass and damping
    share: float = 0.0  # of the force that it leaves, rms
    findings: tuple[Finding, ...] = ()  # none where the hardware states it
    current_lag: Quantity | None = None  # s
    mode: Mode | None = None
    masses: tuple[float, float] | None = None  # kg (kg·m²), least and largest that a loop feels

    def response(self, rigid: ComplexArray, mass: float, frequency: FloatArray) -> ComplexArray:
        """Acceleration per force with the lag or the mode beside the rigid one, (bands,)."""
        turned = (2j * np.pi * frequency).astype(np.complex128)
        if self.mode is not None:
            omega, part = 2 * np.pi * self.mode.frequency_hz.value, self.mode.at_encoder**2
            damped = 2 * self.mode.damping_ratio.value * omega
            bent = turned**2 / (turned**2 + damped * turned + omega**2)
            rigid = rigid + part / mass * bent
        lag = 0.0 if self.current_lag is None else self.current_lag.value
        return rigid / (1 + lag * turned)

    def carried_by(self, estimate: Estimate, before: Estimate) -> Estimate:
        """An estimate from ``log`` with its doubt, and the one before it, without the dynamics."""
        values, covariance = estimate.values.copy(), estimate.covariance.copy()
        count = min(len(covariance), len(self.doubt))
        covariance[:count, :count] += self.doubt[:count, :count]
        covariance[:2, :2] += np.diag((self.left * (values[:2] - before.values[:2])) ** 2)
        if self.masses is not None:
            low, high = self.masses
            half = 0.5 * np.log(high / low)
            values[0] = np.sqrt(low * high)
            covariance[0, 0] += (values[0] * half / NORMAL_95) ** 2
            # Impacts take energy, as damping does.
            covariance[1, 1] += (values[1] * self.share / NORMAL_95) ** 2
        return replace(estimate, values=values, covariance=covariance)


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
