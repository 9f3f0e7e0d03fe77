"""What a device of several axes is at one pose: its matrices, and its mass in every direction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from identification.device.quantities import Covariance, widening
from identification.documents import Document
from identification.trajectory import NORMAL_95

FloatArray = NDArray[np.float64]
Matrix = tuple[tuple[float, ...], ...]

#: Directions looked at first, and about the best of them each time closer.
_DIRECTIONS, _NEAR = 4000, 400
_CLOSER = 0.3 ** np.arange(1, 10)
#: Largest logarithm of a mass's interval to its value, a factor of a thousand.
_WIDEST = 7.0
#: The generator of directions starts here, so that a box can be repeated.
_SEED = 20_261_126


def entry_names(axes: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the entries of mass, then of damping: mass_x_x, mass_x_y and so on."""
    pairs = tuple(combinations_with_replacement(axes, 2))
    return tuple(f"{name}_{one}_{other}" for name in ("mass", "damping") for one, other in pairs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Extreme:
    """The least or largest mass or damping of any direction, and the direction, a unit vector."""

    value: float
    direction: tuple[float, ...]


class Pose(Document):
    """A device of several axes at one pose: Λ·q̈ + D·q̇ + Fc∘sign(q̇) + f0 = F(t - delay).

    Attributes:
        mass: Λ, kg (kg·m²), symmetric and positive definite.
        damping: D, N·s/m (N·m·s/rad), symmetric.
        coulomb_friction: Fc of each axis, N (N·m).
        force_offset: f0 of each axis, N (N·m).
        covariance: joint, of the entries of both matrices, named mass_x_y and damping_x_y.
    """

    mass: Matrix
    damping: Matrix
    coulomb_friction: tuple[float, ...]
    force_offset: tuple[float, ...]
    covariance: Covariance

    @model_validator(mode="after")
    def _sane(self) -> Pose:
        count = len(self.mass)
        for name in ("mass", "damping"):
            matrix = getattr(self, name)
            if len(matrix) != count or any(len(row) != count for row in matrix):
                raise ValueError(f"{name} must have {count} rows of {count} numbers")
            if not np.array_equal(np.array(matrix), np.array(matrix).T):
                raise ValueError(f"{name} must be symmetric")
        if len(self.coulomb_friction) != count or len(self.force_offset) != count:
            raise ValueError(f"coulomb_friction and force_offset need {count} numbers")
        least = float(np.linalg.eigvalsh(np.array(self.mass))[0])
        if least <= 0:
            raise ValueError(f"mass is {least:.3g} in some direction; it must be positive in all")
        return self

    def extremes(
        self, which: Literal["mass", "damping"], deviations: float
    ) -> tuple[Extreme, Extreme]:
        """Least and largest mass or damping of any direction, so many standard deviations away.

        Mass is widened on a logarithmic scale, because it cannot be negative.
        """
        matrix = getattr(self, which)
        size = len(matrix) * (len(matrix) + 1) // 2
        part = slice(0, size) if which == "mass" else slice(size, 2 * size)
        covariance = tuple(row[part] for row in self.covariance.matrix[part])
        return _extremes(matrix, covariance, deviations, positive=which == "mass")

    def deviations(self, confidence: float | None = None) -> float:
        """Standard deviations to a 95 % interval, or to a joint region of all that is estimated."""
        freedom = self.covariance.degrees_of_freedom
        if confidence is None:
            return NORMAL_95 * widening(1, freedom, 0.95)
        return NORMAL_95 * widening(len(self.covariance.parameters), freedom, confidence)


@lru_cache(maxsize=256)
def _extremes(
    matrix: Matrix, covariance: Matrix, deviations: float, *, positive: bool
) -> tuple[Extreme, Extreme]:
    """Ends of vᵀMv over unit vectors v, so many deviations away; a mass stays positive."""
    middle, joint = np.array(matrix), np.array(covariance)
    size = len(middle)
    rows, columns = np.triu_indices(size)
    twice = np.where(rows == columns, 1.0, 2.0)
    chance = np.random.default_rng(_SEED)
    first_look = np.vstack((np.linalg.eigh(middle)[1].T, chance.normal(size=(_DIRECTIONS, size))))

    def end(side: float) -> Extreme:
        def values(directions: FloatArray) -> FloatArray:
            value = np.einsum("di,ij,dj->d", directions, middle, directions)
            weights = directions[:, rows] * directions[:, columns] * twice
            variance = np.einsum("di,ij,dj->d", weights, joint, weights)
            half = side * deviations * np.sqrt(np.maximum(variance, 0.0))
            if positive:
                return value * np.exp(np.clip(half / value, -_WIDEST, _WIDEST))
            return value + half

        best, tried = first_look[0], first_look
        for closer in (0.0, *_CLOSER.tolist()):
            unit = tried / np.linalg.norm(tried, axis=1, keepdims=True)
            best = unit[np.argmax(side * values(unit))]
            tried = np.vstack((best, best + closer * chance.normal(size=(_NEAR, size))))
        best = best * np.sign(best[np.argmax(np.abs(best))])
        return Extreme(value=float(values(best[None])[0]), direction=tuple(best.tolist()))

    return end(-1.0), end(1.0)
