"""Output error by variable projection: the simulated position against the measured one.

q = q0 + v0·(1 - e^(-pt))/p + (G_p[F] - Σ terms·G_p[column])/m, G_p = 1/(s(s+p)), p = b/m, is
integrated exactly for held inputs and any time stamps. Only p, and the delay if nobody states it,
are nonlinear; friction makes the turns nonlinear too (output_error_turns.py). Best where position
noise is all there is; a force that the log does not know integrates twice and spoils it, which its
residual then shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.estimators import least_squares, unlogged
from identification.estimators.answer import answer
from identification.estimators.drive import MOST_SAMPLES, Drive
from identification.estimators.held import unknown_intervals
from identification.estimators.held_response import Coasting, Gain
from identification.estimators.linear import unit_columns
from identification.estimators.model import Estimate, Model
from identification.estimators.output_error_turns import Fitted, Turns
from identification.estimators.rows import Signals
from identification.estimators.separable import physical, solve
from identification.estimators.whiteness import whiteness
from identification.intervals import spread
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Intervals whose mean speed is where the search for the start velocity begins.
_FIRST_LOOK = 10
#: Friction this many standard deviations large decides where the device turns; less is taken for
#: noise, and the direction of motion as measured.
_RUBBING = 3.0
#: A residual further from white than this may come from a search that went astray.
_DOUBTED = 0.05
#: A log longer than this is begun with its first so many samples: the whole then takes one or two
#: steps.
_LONG = 1 << 14


@dataclass(frozen=True, slots=True, kw_only=True)
class _Problem:
    """Position of one log as a separable model in θ = (p,) or (p, delay).

    Attributes:
        drive: inputs.
        position: measured, about its mean, m, shape (n,).
        known: first sample after intervals that feel only logged forces; what happens before is
            in q0 and v0.
    """

    drive: Drive
    position: FloatArray
    known: int

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        ranges = [self.drive.rates, *([self.drive.delays] if self.drive.delay is None else [])]
        low, high = np.array(ranges).T
        return low, high

    def allowed(self, theta: FloatArray) -> bool:
        return bool(np.all(np.isfinite(theta)))

    def _delay(self, theta: FloatArray) -> float:
        return float(theta[1]) if self.drive.delay is None else self.drive.delay

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        device = Coasting.at(float(theta[0]), self.drive.steps)
        inputs = self.drive.inputs(self._delay(theta))
        columns = np.empty((len(inputs) + 2, self.position.size - self.known))
        for index, held in enumerate(inputs):
            columns[index] = device.position(device.gain(held))[0][self.known :]
        nothing = np.zeros(self.position.size - 1)
        resting = Gain(velocity=nothing, distance=nothing)
        columns[-2] = device.position(resting, start=1.0)[0][self.known :]
        columns[-1] = 1.0
        return columns, self.position[self.known :]

    def slopes(self, theta: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
        del residual
        device = Coasting.at(float(theta[0]), self.drive.steps)
        velocity, distance, added = (np.zeros(self.position.size - 1) for _ in range(3))
        inputs = self.drive.inputs(self._delay(theta))
        for weight, held in zip(weights, inputs, strict=False):
            slope = device.slope_by_rate(held)
            velocity += weight * slope.velocity
            distance += weight * slope.distance
            added += weight * device.gain(held).velocity
        speed = device.speed(added, start=float(weights[-2]))
        gain = Gain(velocity=velocity, distance=distance)
        slopes = [device.position_slope(speed, gain)[self.known :]]
        if self.drive.delay is None:
            later = device.position(self.drive.slope_by_delay(device, self._delay(theta)))[0]
            slopes.append(weights[0] * later[self.known :])
        return np.stack(slopes)


def estimate(trajectory: Trajectory, model: Model, delay: float | None) -> Estimate:
    """Mass, damping and friction by output error.

    Args:
        trajectory: the log; time stamps are used as they are.
        model: which terms to estimate.
        delay: s, command to force, a fraction of a sample is honoured; None fits it, from 0 to
            MOST_SAMPLES samples.

    Returns:
        Estimate with the residual in position.
    """
    if model.coulomb and len(trajectory) > _LONG:
        long = _from_section(trajectory, model, delay)
        if long is not None:
            return long
    most = MOST_SAMPLES * trajectory.sample_time if delay is None else delay
    table = least_squares.prepare(trajectory, model, most, refine=False)
    # The delay enters smoothly; the usual one is near enough to begin with.
    first = trajectory.sample_time if delay is None else delay
    return _fit(table, delay, first, refined=False)


def fit(table: least_squares.Regression, delay: float | None, *, start: float = 0.0) -> Estimate:
    """The same from a prepared regression, which gives the start and the direction of motion.

    Args:
        table: with at least as many known intervals as the delay needs.
        delay: as for estimate.
        start: where the search for the delay begins, s.
    """
    return _fit(table, delay, start if delay is None else delay, refined=True)


def _fit(
    table: least_squares.Regression, delay: float | None, first: float, *, refined: bool
) -> Estimate:
    found = None
    if table.model.coulomb:
        values, standing = table.solve(first), table.motion.moving[0] == 0
        found = _turning(table, values, delay, first, standing=bool(standing))
    if found is None or not _rubs(table, found) or whiteness(found.residual) > _DOUBTED:
        settled = table if refined else table.refined(first)
        projected = _projected(settled, delay, first)
        if found is None or not _rubs(table, projected) or projected.cost < found.cost:
            found = projected
    return _estimate(table, found, delay)


def _from_section(trajectory: Trajectory, model: Model, delay: float | None) -> Estimate | None:
    """The fit of a long log, begun where its first part ends up; None if that has no friction."""
    begun = estimate(trajectory.part(slice(_LONG)), model, delay)
    if not begun.value("coulomb_friction") > _RUBBING * begun.deviation("coulomb_friction"):
        return None
    signals = Signals.of(trajectory)
    log = _Log(
        signals=signals,
        model=model,
        known=unknown_intervals(signals.steps, begun.delay),
        mean_speed=begun.mean_speed,
    )
    found = _turning(log, begun.values, delay, begun.delay, standing=False)
    return None if found is None else _estimate(log, found, delay)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Log:
    """As much of a regression as the fit with turns needs."""

    signals: Signals
    model: Model
    known: int
    mean_speed: float


def _estimate(
    table: _Log | least_squares.Regression, found: Fitted, delay: float | None
) -> Estimate:
    size, fitted = len(table.model.parameters), int(delay is None)
    values, jacobian, residual = found.values[:size], found.jacobian, found.residual
    around = spread(jacobian, residual, size + fitted, signal=values[0] * jacobian[0])
    drift = unlogged.covariance(
        jacobian,
        residual,
        size + fitted,
        mass=float(values[0]),
        rate=float(values[1] / values[0]),
        step=float(np.mean(table.signals.steps)),
    )
    around = replace(around, covariance=around.covariance + drift)
    position = table.signals.position[table.known :]
    return answer(
        "output-error",
        table.model,
        values,
        around,
        delay=float(found.values[size]) if delay is None else delay,
        fitted=delay is None,
        signal=position - np.mean(position),
        residual=residual,
        unit="position",
        mean_speed=table.mean_speed,
        notes=() if found.converged else ("the search ended before it settled",),
    )


def _rubs(table: least_squares.Regression, found: Fitted) -> bool:
    """Whether there is friction to speak of, without which nothing turns."""
    if not table.model.coulomb:
        return False
    at = table.model.parameters.index("coulomb_friction")
    unit, norms = unit_columns(found.jacobian.T)
    inverse = np.linalg.pinv(unit.T @ unit, hermitian=True)
    variance = float(found.residual @ found.residual) / found.residual.size
    return bool(found.values[at] > _RUBBING * np.sqrt(variance * inverse[at, at]) / norms[at])


def _turning(
    log: _Log | least_squares.Regression,
    values: FloatArray,
    delay: float | None,
    first: float,
    *,
    standing: bool,
) -> Fitted | None:
    """The fit whose turns are those of its own simulation, from values of the parameters on."""
    signals = log.signals
    turns = Turns(
        signals=signals,
        model=log.model,
        drive=Drive.bare(signals, delay),
        known=log.known,
        mean_speed=log.mean_speed,
    )
    speed = 0.0 if standing else float(np.mean(signals.speed[:_FIRST_LOOK]))
    fitted = [first] if delay is None else []
    return turns.fit(np.array([*values, *fitted, speed, signals.position[0]]))


def _projected(table: least_squares.Regression, delay: float | None, first: float) -> Fitted:
    """The fit with the direction of motion as measured, which matters only with friction."""
    signals = table.signals
    problem = _Problem(
        drive=Drive.of(table, delay),
        position=signals.position - np.mean(signals.position),
        known=table.known,
    )
    mass, damping = table.solve(first)[:2]
    rate = float(np.clip(damping / mass if mass > 0 else 0.0, *problem.drive.rates))
    best = solve(problem, np.array([rate] if delay is not None else [rate, first]))
    values, jacobian = physical(best, len(table.model.parameters))
    return Fitted(
        values=np.concatenate((values, best.theta[1:])),
        jacobian=jacobian,
        residual=best.residual,
        converged=best.converged,
    )
