"""Estimators: each takes a log, a model and a delay, and gives an Estimate.

estimate(trajectory, model, delay) -> Estimate
"""

from __future__ import annotations

from identification.estimators import least_squares, output_error
from identification.estimators.model import Estimate as Estimate
from identification.estimators.model import Model as Model

#: Estimators by the name they have on the command line.
METHODS = {
    "least-squares": least_squares.estimate,
    "output-error": output_error.estimate,
}

__all__ = ["METHODS", "Estimate", "Model"]
