"""Coefficients of a loop in w: by effect, and of plant and control law apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """Coefficients of 1, α, β and γ in the loop polynomial, each (degree+1, *shape), by power."""

    free: FloatArray
    alpha: FloatArray
    beta: FloatArray
    gamma: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Transfer:
    """Plant and control law apart, for transfer functions other than the stability polynomial.

    Each is (its degree+1, *shape), ascending in w. Position from force is (T²/m) times
    plant_numerator/plant_denominator, the delay included; force from position is -(m/T²) times
    (alpha·α + beta·β + gamma·γ)/law_denominator. Hence the terms of the loop: free is
    plant_denominator·law_denominator, that of each effect plant_numerator times its numerator.

    Attributes:
        plant_numerator: of the measured position.
        plant_denominator: of both positions.
        handle_numerator: of the position of the handle.
        law_denominator: of the control law.
        alpha: numerator of the stiffness.
        beta: numerator of the damping.
        gamma: numerator of the mass.
    """

    plant_numerator: FloatArray
    plant_denominator: FloatArray
    handle_numerator: FloatArray
    law_denominator: FloatArray
    alpha: FloatArray
    beta: FloatArray
    gamma: FloatArray
