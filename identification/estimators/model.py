"""What every estimator is asked (Model) and what every estimator answers (Estimate)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.estimators.whitening import whiteness

FloatArray = NDArray[np.float64]
Gravity = Literal["none", "proportional", "pendulum"]

_OF_GRAVITY: dict[Gravity, tuple[str, ...]] = {
    "none": (),
    "proportional": ("position_stiffness",),
    "pendulum": ("gravity_sine", "gravity_cosine"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """Which terms stand beside mass and damping in the equation of motion.

    m·q̈ + b·q̇ + a·(|q̇| - s) + Fc·sign(q̇) + f0 + k·q + gs·sin(q) + gc·cos(q) = F(t - delay).

    Attributes:
        coulomb: Coulomb friction Fc is estimated; otherwise it is zero.
        offset: a constant force f0 is estimated; otherwise it is zero.
        directional: friction differs by direction: damping is b + a forward and b - a backward, and
            Coulomb friction Fc ± (f0 - a·s). With s, the mean speed of the log, f0 stays the
            offset at that speed. Needs ``coulomb`` and ``offset``.
        gravity: "proportional" adds k·q, "pendulum" adds gs·sin(q) + gc·cos(q), q in rad.
    """

    coulomb: bool = True
    offset: bool = True
    directional: bool = False
    gravity: Gravity = "none"

    def __post_init__(self) -> None:
        if self.directional and not (self.coulomb and self.offset):
            raise ValueError("direction-dependent friction needs coulomb and offset as well")

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of every vector and matrix of an Estimate."""
        names = ["mass", "damping"]
        names += ["coulomb_friction"] if self.coulomb else []
        names += ["force_offset"] if self.offset else []
        names += ["damping_asymmetry"] if self.directional else []
        return (*names, *self.of_gravity)

    @property
    def of_gravity(self) -> tuple[str, ...]:
        """Names of the parameters of gravity."""
        return _OF_GRAVITY[self.gravity]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One method's answer for one log; SI units, or the rotary ones of Device.

    Attributes:
        method: its name on the command line.
        model: the terms estimated.
        delay: s, command to force: as given, or as fitted.
        delay_deviation: standard deviation of a fitted delay, s; None if it was given.
        values: shape (p,), in the order of ``model.parameters``.
        covariance: shape (p, p), robust against coloured residuals (intervals.py).
        degrees_of_freedom: of the covariance, for Student's t and Hotelling's T².
        residual: shape (rows,), in ``residual_unit``.
        residual_unit: "force" (filtered, N) or "position" (m).
        explained: share of the fitted signal's mean square that the model explains, at most 1.
        condition: condition number of the unit-norm columns.
        inflation: shape (p,): variance inflation of each parameter by the other columns.
        mean_speed: s of the model, m/s; 0 where friction does not differ by direction.
        leaning: shape (p,): what choices of the method move the estimate by, such as half of the
            difference between half and twice the cut-off; one more standard deviation, in the
            covariance. None where there is no such choice.
        open_loop_only: whether forces that were not logged would bias the fitted delay if they
            came back through a controller.
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
    condition: float
    inflation: FloatArray
    delay_deviation: float | None = None
    mean_speed: float = 0.0
    leaning: FloatArray | None = None
    open_loop_only: bool = False
    notes: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of ``values``."""
        return self.model.parameters

    @property
    def whiteness(self) -> float:
        """Distance of the residual's cumulated spectrum from white noise, 0 to 1."""
        return whiteness(self.residual)

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
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def combined(self, **weights: float) -> tuple[float, float]:
        """Value and standard deviation of a weighted sum of parameters, absent ones being zero."""
        known = np.array([weights.get(name, 0.0) for name in self.parameters])
        return float(known @ self.values), float(np.sqrt(max(known @ self.covariance @ known, 0.0)))
