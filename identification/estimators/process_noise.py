"""Process noise: a white force that is not logged, and what it does to a fit of positions.

Integrated twice it is a slow drift. While position noise still covers it in every octave of the
residual, it moves damping and friction by more than that noise does, and hardly differs from one
part of a log to the next, which is where leaving out blocks looks. So its variance is estimated
from the lowest lines of the residual, by restricted maximum likelihood: what the fit has taken up
of these lines is accounted for (Patterson and Thompson, Biometrika 58, 1971, p. 545).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.estimators.held_response import StepResponse
from identification.estimators.linear import symmetric_inverse, unit_columns
from identification.estimators.linear_filters import recursive

FloatArray = NDArray[np.float64]

#: A log is looked at in so many parts at most, which hold the lines that matter.
_PARTS = 512
#: Lines of the residual, from the lowest on, that tell the force from position noise.
_LINES = 64
#: Variances tried, from so little of the position noise in the line that shows most of it to so
#: much, each this many times the one before: its root, which intervals go by, is right to 7 %.
_LEAST, _MOST, _RATIO = 1e-3, 1e9, 1.15
#: Directions this much weaker than the strongest carry nothing but rounding.
_NOTHING = 1e-10


def process_noise_covariance(
    jacobian: FloatArray, residual: FloatArray, keep: int, *, mass: float, rate: float, step: float
) -> FloatArray:
    """What the force adds to the covariance of a least-squares fit of positions.

    Args:
        jacobian: shape (p, rows).
        residual: shape (rows,), m (rad).
        keep: how many leading parameters are wanted.
        mass: kg (kg·m²).
        rate: b/m, 1/s.
        step: mean time between rows, s.

    Returns:
        shape (keep, keep), in the units of the parameters; zeros where no such force is seen.
    """
    rows = residual.size
    parts = min(rows, _PARTS)
    starts = np.linspace(0, rows, parts, endpoint=False).astype(np.intp)
    counts = np.diff(starts, append=rows)
    unit, norms = unit_columns(jacobian.T)
    sums = np.add.reduceat(unit.T, starts, axis=1)
    pushed = _Pushed(mass, max(rate, 0.0), step * rows / parts)
    variance = _variance(sums / counts, np.add.reduceat(residual, starts) / counts, pushed)
    inverse = symmetric_inverse(unit.T @ unit, _NOTHING)[:keep]
    moved = pushed.back(inverse @ sums / norms[:keep, None])
    return variance * moved @ moved.T


class _Pushed:
    """Positions under a force held for one part of a log each, from rest."""

    def __init__(self, mass: float, rate: float, span: float) -> None:
        push = StepResponse.during(span, rate)
        speed, place, decay = float(push.speed), float(push.place), float(push.decay)
        self._above = np.array([place, speed * speed - place * decay]) / mass
        self._below = -1.0 - decay, decay

    def back(self, weights: FloatArray) -> FloatArray:
        """Weights of the forces in sums of positions with these weights, shape (..., parts)."""
        turned = recursive(weights[..., ::-1], *self._below)
        forces = np.zeros_like(turned)
        forces[..., 1:] = self._above[0] * turned[..., :-1]
        forces[..., 2:] += self._above[1] * turned[..., :-2]
        return forces[..., ::-1]


def _variance(columns: FloatArray, residual: FloatArray, pushed: _Pushed) -> float:
    """The likeliest variance of a force held for one part each.

    Args:
        columns: what the fit has taken up, shape (p, parts).
        residual: shape (parts,).
        pushed: positions from forces.
    """
    parts = residual.size
    line = np.arange(1, min(_LINES, parts // 2) + 1)[:, None]
    lines = np.cos(np.pi * line * (np.arange(parts) + 0.5) / parts)
    taken = _directions(unit_columns(columns.T)[0].T, 1.0)
    seen = _directions(lines - (lines @ taken.T) @ taken, parts / 2)
    if not seen.size:
        return 0.0
    forces = pushed.back(seen)
    shares, axes = np.linalg.eigh(forces @ forces.T)
    power = (axes.T @ (seen @ residual)) ** 2
    rest = parts - len(taken) - len(seen)
    noise = (float(residual @ residual) - float(np.sum(power))) / max(rest, 1)
    if not (noise > 0 and shares[-1] > 0):
        return 0.0
    steps = int(np.log(_MOST / _LEAST) / np.log(_RATIO))
    tried = np.concatenate(([0.0], _LEAST * _RATIO ** np.arange(steps))) * noise / shares[-1]
    level = noise + tried[:, None] * np.maximum(shares, 0.0)
    likelihood = -np.sum(np.log(level) + power / level, axis=1)
    return float(tried[np.argmax(likelihood)])


def _directions(rows: FloatArray, power: float) -> FloatArray:
    """Orthonormal rows that span the same, shape (rank, parts).

    Args:
        rows: shape (count, parts).
        power: sum of squares of a row of which nothing was taken away.
    """
    powers, mixed = np.linalg.eigh(rows @ rows.T)
    strong = powers > _NOTHING * power
    return (mixed[:, strong] / np.sqrt(powers[strong])).T @ rows
