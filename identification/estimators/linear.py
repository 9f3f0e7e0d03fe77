"""Least squares: on columns of very different size, and by variable projection.

Variable projection serves fits in which only a few parameters are nonlinear. Given those, θ, the
others are a linear solve; θ moves by Gauss-Newton on what the linear columns leave (Golub and
Pereyra, SIAM Journal on Numerical Analysis 10, 1973, p. 413, in Kaufman's form). Everything large
stays in columns; what is solved is as small as the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Steps of Gauss-Newton; from least squares it converges in three to five.
_MOST_STEPS = 40
#: Times a step that makes the fit worse is halved before it is given up.
_MOST_HALVINGS = 12
#: The search ends when a step is shorter than this part of the standard deviation along it; a
#: tenth of it could no longer be told from the rounding of a million squares.
_CONVERGED = 1e-2
#: Times a linear solve is repeated on its own residual: normal equations lose half of the digits,
#: each repetition gains them back.
_REPEATS = 2
#: Singular values of unit columns below this part of the largest carry nothing but rounding.
_NOTHING = 1e-14
#: A force that moves nothing leaves 1/m at zero; it is kept this far from it, 1/kg.
_LIGHTEST = 1e-15


def unit_columns(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns of unit norm and the norms, shape (n, p) and (p,); a column of zeros stays zero."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    return columns / norms, norms


def solve(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution by QR of unit-norm columns, shape (p,)."""
    unit, norms = unit_columns(columns)
    q, r = np.linalg.qr(unit)
    return np.linalg.lstsq(r, q.T @ right, rcond=None)[0] / norms


def symmetric_inverse(matrices: FloatArray, nothing: float = 1e-15) -> FloatArray:
    """Pseudo-inverses of symmetric matrices by their eigenvalues, shape (..., p, p).

    Args:
        matrices: shape (..., p, p).
        nothing: eigenvalues below this part of the largest, in size, carry nothing but rounding.
    """
    values, vectors = np.linalg.eigh(matrices)
    sizes = np.abs(values)
    told = sizes > nothing * np.max(sizes, axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=told)
    return (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def explained_share(signal: FloatArray, residual: FloatArray) -> float:
    """Share of the mean square of a signal that is not in the residual; 0 without a signal.

    Both are of shape (rows,) and of one unit; the share has none.
    """
    power = float(signal @ signal)
    return 1 - float(residual @ residual) / power if power > 0 else 0.0


def gauss_newton(
    slopes: FloatArray, residual: FloatArray, nothing: float
) -> tuple[FloatArray, float]:
    """The Gauss-Newton step of a fit, and what it gains in units of the variance of a residual.

    Args:
        slopes: derivative of the fit by each parameter, shape (k, rows).
        residual: what the fit leaves, shape (rows,).
        nothing: directions this much weaker than the strongest carry nothing but rounding.
    """
    normal = slopes @ slopes.T
    size = np.sqrt(np.diag(normal))
    # A parameter that changes nothing does not move.
    size = np.where(size > 0, size, 1.0)
    right = slopes @ residual / size
    inverse = symmetric_inverse(normal / np.outer(size, size), nothing)
    move = inverse @ right
    cost = max(float(residual @ residual), np.finfo(float).tiny)
    return move / size, float(move @ right) * residual.size / cost


class Separable(Protocol):
    """A model y ≈ Xᵀ(θ)·w of one log."""

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest θ searched, shape (k,) each."""
        ...

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns X, shape (q, rows), and the target y, shape (rows,)."""
        ...

    def slopes(self, theta: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
        """Derivative of Xᵀw - y by θ, shape (k, rows); the residual is y - Xᵀw."""
        ...

    def allowed(self, theta: FloatArray) -> bool:
        """Whether a θ within the bounds, shape (k,), may be tried."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """The best fit found.

    Attributes:
        theta: nonlinear parameters, shape (k,).
        weights: linear parameters, shape (q,).
        columns: X at theta, shape (q, rows).
        slopes: derivative of the fit by theta, shape (k, rows).
        target: y, shape (rows,).
        residual: y - Xᵀw, shape (rows,).
        converged: whether the search ended because steps became short.
    """

    theta: FloatArray
    weights: FloatArray
    columns: FloatArray
    slopes: FloatArray
    target: FloatArray
    residual: FloatArray
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)


@dataclass(frozen=True, slots=True)
class _Linear:
    """The linear solve at one θ."""

    columns: FloatArray
    target: FloatArray
    inverse: FloatArray
    weights: FloatArray
    residual: FloatArray

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)

    def project(self, right: FloatArray) -> FloatArray:
        """Weights that fit other right-hand sides, shape (..., rows) to (..., q)."""
        return (right @ self.columns.T) @ self.inverse


def solve_separable(problem: Separable, start: FloatArray) -> Solution:
    """Minimise ‖y - Xᵀ(θ)·w‖² over θ and w, from a start that may be rough.

    The start has shape (parameters,), in the units of θ.
    """
    theta = np.clip(start, *problem.bounds)
    best = _linear(problem, theta)
    converged = False
    slopes = problem.slopes(theta, best.weights, best.residual)
    for _ in range(_MOST_STEPS):
        across = slopes - best.project(slopes) @ best.columns
        move, gain = gauss_newton(across, best.residual, _NOTHING)
        if gain <= _CONVERGED**2:
            converged = True
            break
        found = _improved(problem, theta, move, best.cost)
        if found is None:
            break
        theta, best = found
        slopes = problem.slopes(theta, best.weights, best.residual)
    return Solution(
        theta=theta,
        weights=best.weights,
        columns=best.columns,
        slopes=slopes,
        target=best.target,
        residual=best.residual,
        converged=converged,
    )


def _improved(
    problem: Separable, theta: FloatArray, move: FloatArray, cost: float
) -> tuple[FloatArray, _Linear] | None:
    """The longest of ever shorter steps that makes the fit better; None if there is none."""
    for halving in range(_MOST_HALVINGS):
        trial = np.clip(theta + move / 2**halving, *problem.bounds)
        if not problem.allowed(trial):
            continue
        found = _linear(problem, trial)
        if found.cost < cost:
            return trial, found
    return None


def _linear(problem: Separable, theta: FloatArray) -> _Linear:
    columns, target = problem.at(theta)
    gram = columns @ columns.T
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    scale = np.outer(size, size)
    inverse = symmetric_inverse(gram / scale, _NOTHING) / scale
    weights = inverse @ (columns @ target)
    residual = target - weights @ columns
    for _ in range(_REPEATS):
        weights = weights + inverse @ (columns @ residual)
        residual = target - weights @ columns
    return _Linear(columns, target, inverse, weights, residual)


def physical(best: Solution, count: int) -> tuple[FloatArray, FloatArray]:
    """Parameters m, b, terms of a solution in p = θ[0] and weights 1/m, -terms/m, and its Jacobian.

    The chain rule is taken in the columns, so a covariance computed from them is already that of
    the physical parameters.

    Args:
        best: its first ``count - 1`` weights are those of force and terms.
        count: number of parameters.

    Returns:
        values, shape (count,), and derivatives of the fit by them, then by the other θ and the
        other weights, shape (count + nuisance, rows).
    """
    inverse = float(best.weights[0])
    if abs(inverse) < _LIGHTEST:
        inverse = np.copysign(_LIGHTEST, inverse)
    mass, rate = 1 / inverse, float(best.theta[0])
    values = np.concatenate(([mass, rate * mass], best.weights[1 : count - 1] * -mass))
    slope = best.slopes[0]
    driven = best.weights[: count - 1] @ best.columns[: count - 1]
    jacobian = [-(driven + rate * slope) / mass, slope / mass]
    jacobian += [-column / mass for column in best.columns[1 : count - 1]]
    return values, np.stack([*jacobian, *best.slopes[1:], *best.columns[count - 1 :]])
