"""From a fit to an Estimate: the part that is alike whatever the method."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.estimators.intervals import Spread
from identification.estimators.linear import explained
from identification.estimators.model import Estimate, Model
from identification.estimators.shaping import whiteness

FloatArray = NDArray[np.float64]


def answer(
    method: str,
    model: Model,
    values: FloatArray,
    around: Spread,
    *,
    delay: float,
    fitted: bool,
    signal: FloatArray,
    residual: FloatArray,
    unit: Literal["force", "position"],
    mean_speed: float,
    notes: tuple[str, ...],
    leaning: FloatArray | None = None,
    scale: float = 1.0,
) -> Estimate:
    """The Estimate of one fit.

    Args:
        method: its name on the command line.
        model: the terms estimated.
        values: of the parameters, shape (p,).
        around: their covariance, followed by that of the delay if it was fitted.
        delay: s, given or fitted.
        fitted: whether the delay was fitted.
        signal: what was to be explained, shape (rows,).
        residual: what was not, shape (rows,).
        unit: of the residual.
        mean_speed: s of the model.
        notes: on choices made on the way.
        leaning: one more standard deviation of every parameter, shape (p,), or None.
        scale: of the residual to its unit.
    """
    size = values.size
    covariance = around.covariance[:size, :size]
    if leaning is not None:
        covariance = covariance + np.outer(leaning, leaning)
    return Estimate(
        method=method,
        model=model,
        delay=delay,
        delay_deviation=float(np.sqrt(around.covariance[size, size])) if fitted else None,
        values=values,
        covariance=covariance,
        degrees_of_freedom=around.degrees_of_freedom,
        residual=residual * scale,
        residual_unit=unit,
        explained=explained(signal, residual),
        whiteness=whiteness(residual),
        condition=around.condition,
        inflation=around.inflation[:size],
        mean_speed=mean_speed,
        leaning=leaning,
        notes=notes,
    )
