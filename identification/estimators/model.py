"""What every estimator is asked (Model) and what every estimator answers (Estimate)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """Which terms stand beside mass and damping in m·q̈ + b·q̇ + Fc·sign(q̇) + f0 = F(t - delay).

    Attributes:
        coulomb: Coulomb friction Fc is estimated; otherwise it is zero.
        offset: a constant force f0 is estimated; otherwise it is zero.
    """

    coulomb: bool = True
    offset: bool = True

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of every vector and matrix of an Estimate."""
        names = ["mass", "damping"]
        names += ["coulomb_friction"] if self.coulomb else []
        names += ["force_offset"] if self.offset else []
        return tuple(names)


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One method's answer for one log; SI units, or the rotary ones of Device.

    Attributes:
        method: "least-squares" or "output-error".
        model: the terms estimated.
        delay: s, command to force, that was taken.
        values: shape (p,), in the order of ``model.parameters``.
        covariance: shape (p, p), robust against coloured residuals (intervals.py).
        degrees_of_freedom: of the covariance, for Student's t and Hotelling's T².
        residual: shape (rows,), in ``residual_unit``.
        residual_unit: "force" (filtered, N) or "position" (m).
        explained: share of the fitted signal's mean square that the model explains, at most 1.
        whiteness: distance of the residual's cumulated spectrum from white noise, 0 to 1.
        condition: condition number of the unit-norm columns.
        inflation: shape (p,): variance inflation of each parameter by the other columns.
        notes: sentences on choices made on the way, such as the cut-off.
    """

    method: str
    model: Model
    delay: float
    values: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    residual: FloatArray
    residual_unit: str
    explained: float
    whiteness: float
    condition: float
    inflation: FloatArray
    notes: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of ``values``."""
        return self.model.parameters

    def value(self, name: str) -> float:
        """The estimate of one parameter; 0 for a term the model leaves out."""
        if name not in self.parameters:
            return 0.0
        return float(self.values[self.parameters.index(name)])

    def deviation(self, name: str) -> float:
        """Standard deviation of one parameter; 0 for a term the model leaves out."""
        if name not in self.parameters:
            return 0.0
        index = self.parameters.index(name)
        return float(np.sqrt(self.covariance[index, index]))
