"""Least squares: on columns of very different size, and by variable projection.

Variable projection serves fits in which only a few parameters are nonlinear. Given those, θ, the
others are a linear solve; θ moves by Gauss-Newton on what the linear columns leave (Golub and
Pereyra, SIAM Journal on Numerical Analysis 10, 1973, p. 413, in Kaufman's form). Everything large
stays in columns; what is solved is as small as the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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

    Eigenvalues below ``nothing`` times the largest, in size, carry nothing but rounding.
    """
    values, vectors = np.linalg.eigh(matrices)
    sizes = np.abs(values)
    told = sizes > nothing * np.max(sizes, axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=told)
    return (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def explained_share(signal: FloatArray, residual: FloatArray) -> float:
    """Share of the mean square of a signal that is not in the residual; 0 without a signal."""
    power = float(signal @ signal)
    return 1 - float(residual @ residual) / power if power > 0 else 0.0


def gauss_newton(
    slopes: FloatArray, residual: FloatArray, nothing: float
) -> tuple[FloatArray, float]:
    """The Gauss-Newton step of a fit, and what it gains in units of the variance of a residual.

    Slopes are by each parameter, shape (k, rows); directions weaker than ``nothing`` times the
    strongest carry nothing but rounding.
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


@dataclass(frozen=True, slots=True)
class Solution:
    """The best fit found, or the linear solve at one θ."""

    theta: FloatArray  # nonlinear parameters, shape (k,)
    weights: FloatArray  # linear parameters, shape (q,)
    columns: FloatArray  # X at theta, shape (q, rows)
    target: FloatArray  # y, shape (rows,)
    residual: FloatArray  # y - Xᵀw, shape (rows,)
    inverse: FloatArray  # of the products of columns, shape (q, q)
    slopes: FloatArray  # derivative of the fit by theta, shape (k, rows); of a trial none
    converged: bool = False  # whether the search ended because steps became short

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)


def solve_separable(problem: Separable, start: FloatArray) -> Solution:
    """Minimise ‖y - Xᵀ(θ)·w‖² over θ and w, from a start that may be rough."""
    best = _with_slopes(problem, _linear(problem, np.clip(start, *problem.bounds)))
    for _ in range(_MOST_STEPS):
        along = (best.slopes @ best.columns.T) @ best.inverse
        move, gain = gauss_newton(best.slopes - along @ best.columns, best.residual, _NOTHING)
        if gain <= _CONVERGED**2:
            return replace(best, converged=True)
        found = _improved(problem, best, move)
        if found is None:
            break
        best = _with_slopes(problem, found)
    return best


def _with_slopes(problem: Separable, found: Solution) -> Solution:
    return replace(found, slopes=problem.slopes(found.theta, found.weights, found.residual))


def _improved(problem: Separable, best: Solution, move: FloatArray) -> Solution | None:
    """The longest of ever shorter steps that makes the fit better; None if there is none."""
    for halving in range(_MOST_HALVINGS):
        trial = np.clip(best.theta + move / 2**halving, *problem.bounds)
        if problem.allowed(trial):
            found = _linear(problem, trial)
            if found.cost < best.cost:
                return found
    return None


def _linear(problem: Separable, theta: FloatArray) -> Solution:
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
    return Solution(theta, weights, columns, target, residual, inverse, np.empty(0))


def physical(best: Solution, count: int) -> tuple[FloatArray, FloatArray]:
    """Parameters m, b, terms of a solution in p = θ[0] and weights 1/m, -terms/m, and its Jacobian.

    The chain rule is taken in the columns, so a covariance computed from them is already that of
    the physical parameters. The Jacobian goes on with the other θ and the other weights.
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
