"""Output error by variable projection: the simulated position against the measured one.

q = q0 + v0·(1 - e^(-pt))/p + (G_p[F] - f0·G_p[1] - Fc·G_p[sign q̇])/m, G_p = 1/(s(s+p)), p = b/m.
Only p is nonlinear; everything else is a linear solve inside (Golub and Pereyra, SIAM Journal on
Numerical Analysis 10, 1973, p. 413). Best where position noise is all there is; a force that the
log does not know integrates twice and spoils it, which its residual then shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators import least_squares
from identification.estimators.held import Held, unknown_intervals
from identification.estimators.held_response import coasting, response
from identification.estimators.linear import explained, solve
from identification.estimators.model import Estimate, Model
from identification.estimators.whiteness import whiteness
from identification.intervals import spread
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Imaginary step for derivatives by p, as part of 1/T: nothing is subtracted, so it is exact.
_COMPLEX_STEP = 1e-30
#: Steps of Gauss-Newton; from least squares it converges in three to five.
_MOST_STEPS = 30
#: Times a step that makes the fit worse is halved before it is given up.
_MOST_HALVINGS = 20
#: The search ends when p moves by less than this part of its own standard deviation, ...
_CONVERGED = 1e-3
#: ... or of the finest change of p a log of this duration could show in double precision.
_FINEST = 1e-12
#: Fastest |p| searched, per sample: there the motion dies within a sample.
_FASTEST = 2.0
#: Fastest growth searched, per log: e^50 exceeds any travel.
_GROWTH = 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Projection:
    """The best linear fit at one p.

    Attributes:
        rate: p, 1/s.
        columns: responses of position, shape (n, q), and ...
        slopes: ... their derivatives by p.
        weights: shape (q,): 1/m, then what the columns of the model carry, q0, v0.
        residual: m, shape (n,).
    """

    rate: float
    columns: FloatArray
    slopes: FloatArray
    weights: FloatArray
    residual: FloatArray

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Problem:
    """Held inputs and measured position of one log, from the first sample with known force."""

    inputs: tuple[Held, ...]
    position: FloatArray
    step: float

    def at(self, rate: float) -> _Projection:
        """The fit with p given."""
        nudge = _COMPLEX_STEP / self.step
        complex_rate = complex(rate, nudge)
        dynamic = [response(held, complex_rate, self.step) for held in self.inputs]
        dynamic.append(coasting(self.position.size, complex_rate, self.step))
        stack = np.stack([*dynamic, np.ones(self.position.size, dtype=np.complex128)], axis=1)
        columns, slopes = np.ascontiguousarray(stack.real), stack.imag / nudge
        weights = solve(columns, self.position)
        return _Projection(
            rate=rate,
            columns=columns,
            slopes=slopes,
            weights=weights,
            residual=self.position - columns @ weights,
        )

    @property
    def bounds(self) -> tuple[float, float]:
        """Rates searched, 1/s."""
        return -_GROWTH / (self.step * self.position.size), _FASTEST / self.step


def estimate(trajectory: Trajectory, model: Model, delay: float) -> Estimate:
    """Mass, damping and friction by output error.

    Args:
        trajectory: the log, n samples at a constant step.
        model: which friction terms to estimate.
        delay: s, command to force; a fraction of a sample is honoured.

    Returns:
        Estimate with the residual in position.
    """
    return fit(least_squares.prepare(trajectory, model, delay), delay)


def fit(table: least_squares.Regression, delay: float) -> Estimate:
    """The same from a prepared regression, which gives the start and the direction of motion."""
    trajectory, model = table.trajectory, table.model
    step = trajectory.sample_time
    known = unknown_intervals(delay / step)
    moving = table.motion.moving
    inputs = [table.held_force(delay).times(moving)]
    if model.coulomb:
        inputs.append(table.motion.direction)
    if model.offset:
        inputs.append(Held(early=moving, late=moving, fraction=0.0))
    position = trajectory.position[known:]
    problem = _Problem(
        inputs=tuple(held.since(known) for held in inputs),
        position=position - np.mean(position),
        step=step,
    )
    mass, damping = table.solve(delay)[:2]
    best, notes = _search(problem, damping / mass if mass > 0 else 0.0)
    values, jacobian = _physical(best, len(model.parameters))
    around = spread(jacobian, best.residual, len(values), signal=values[0] * jacobian[:, 0])
    return Estimate(
        method="output-error",
        model=model,
        delay=delay,
        values=values,
        covariance=around.covariance,
        degrees_of_freedom=around.degrees_of_freedom,
        residual=best.residual,
        residual_unit="position",
        explained=explained(problem.position, best.residual),
        whiteness=whiteness(best.residual),
        condition=around.condition,
        inflation=around.inflation,
        notes=notes,
    )


def _search(problem: _Problem, start: float) -> tuple[_Projection, tuple[str, ...]]:
    """The p of the best fit, by Gauss-Newton with halved steps, or by bracketing if that fails."""
    low, high = problem.bounds
    best = problem.at(float(np.clip(start, low, high)))
    for _ in range(_MOST_STEPS):
        # Kaufman's form: the step of p is its coefficient beside all linear columns.
        slope = best.slopes @ best.weights
        across = slope - best.columns @ solve(best.columns, slope)
        square = float(across @ across)
        if square == 0:
            break
        move = float(across @ best.residual) / square
        deviation = np.sqrt(best.cost / best.residual.size / square)
        if abs(move) <= max(_CONVERGED * deviation, _FINEST / problem.step):
            return best, ()
        for halving in range(_MOST_HALVINGS):
            trial = problem.at(float(np.clip(best.rate + move / 2**halving, low, high)))
            if trial.cost < best.cost:
                best = trial
                break
        else:
            break
    return _bracketed(problem, best)


def _bracketed(problem: _Problem, best: _Projection) -> tuple[_Projection, tuple[str, ...]]:
    """Search without derivatives about the best p so far."""
    from scipy.optimize import minimize_scalar

    low, high = problem.bounds
    width = abs(best.rate) + 10.0 / (problem.step * problem.position.size)
    bounds = (max(low, best.rate - width), min(high, best.rate + width))
    found = minimize_scalar(lambda rate: problem.at(float(rate)).cost, bounds=bounds)
    trial = problem.at(float(found.x))
    chosen = trial if trial.cost < best.cost else best
    return chosen, (f"b/m was bracketed, not converged, at {chosen.rate:.6g} 1/s",)


def _physical(best: _Projection, count: int) -> tuple[FloatArray, FloatArray]:
    """Parameters (m, b, friction terms) and the Jacobian of position by them, q0 and v0.

    The chain rule from (p, 1/m, Fc/m, f0/m) is taken in the columns, so the covariance of the fit
    is already that of the physical parameters.
    """
    mass = 1 / best.weights[0]
    friction = best.weights[1 : count - 1] * -mass
    values = np.concatenate(([mass, best.rate * mass], friction))
    slope = best.slopes @ best.weights
    driven = best.columns[:, : count - 1] @ best.weights[: count - 1]
    columns = [-(driven + best.rate * slope) / mass, slope / mass]
    columns += [-best.columns[:, index] / mass for index in range(1, count - 1)]
    nuisance = best.columns[:, count - 1 :]
    return values, np.concatenate((np.stack(columns, axis=1), nuisance), axis=1)
