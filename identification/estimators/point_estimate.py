"""Point estimates, and how an Estimate with intervals is made of one, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.estimators.intervals import Spread
from identification.estimators.linear import explained_share
from identification.estimators.model import Estimate, Model

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PointEstimate:
    """A point estimate: values without intervals.

    Attributes:
        values: of the parameters, shape (p,).
        delay: s, given or fitted.
        signal: what was to be explained, shape (rows,).
        residual: what was not, shape (rows,).
    """

    values: FloatArray
    delay: float
    signal: FloatArray
    residual: FloatArray

    @property
    def explained(self) -> float:
        """Share of the mean square of the signal that is not in the residual."""
        return explained_share(self.signal, self.residual)


def complete_estimate(
    method: str,
    model: Model,
    point: PointEstimate,
    around: Spread,
    *,
    fitted: bool,
    unit: Literal["force", "position"],
    mean_speed: float,
    notes: tuple[str, ...],
    leaning: FloatArray | None = None,
) -> Estimate:
    """The Estimate of one fit.

    Args:
        method: its name on the command line.
        model: the terms estimated.
        point: values, delay and residual.
        around: their covariance, followed by that of the delay if it was fitted.
        fitted: whether the delay was fitted.
        unit: of the residual.
        mean_speed: s of the model, m/s.
        notes: on choices made on the way.
        leaning: one more standard deviation of every parameter, shape (p,), or None.
    """
    size = point.values.size
    covariance = around.covariance[:size, :size]
    if leaning is not None:
        covariance = covariance + np.outer(leaning, leaning)
    return Estimate(
        method=method,
        model=model,
        delay=point.delay,
        delay_deviation=float(np.sqrt(around.covariance[size, size])) if fitted else None,
        values=point.values,
        covariance=covariance,
        degrees_of_freedom=around.degrees_of_freedom,
        residual=point.residual,
        residual_unit=unit,
        explained=point.explained,
        condition=around.condition,
        inflation=around.inflation[:size],
        mean_speed=mean_speed,
        leaning=leaning,
        notes=notes,
    )
