"""Estimators: each takes a log, a model and a delay, and gives an Estimate.

estimate(trajectory, model, delay) -> Estimate; a delay of None is found from the log.
"""

from __future__ import annotations

from identification.estimators import (
    innovations,
    instruments,
    least_squares,
    output_error,
    weak,
)
from identification.estimators.model import Estimate as Estimate
from identification.estimators.model import Model as Model

#: Estimators by the name they have on the command line.
METHODS = {
    "least-squares": least_squares.estimate,
    "weak": weak.estimate,
    "instruments": instruments.estimate,
    "output-error": output_error.estimate,
    "innovations": innovations.estimate,
}

__all__ = ["METHODS", "Estimate", "Model"]
