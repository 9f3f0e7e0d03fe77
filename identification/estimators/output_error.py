"""Output error by variable projection: the simulated position against the measured one.

q = q0 + v0·(1 - e^(-pt))/p + (G_p[F] - Σ terms·G_p[column])/m, G_p = 1/(s(s+p)), p = b/m, is
integrated exactly for held inputs and any time stamps. Only p, and the delay if nobody states it,
are nonlinear; with friction the velocity reversals are nonlinear too (stick_slip.py).
Best where position noise is all there is; a force that the log does not know integrates twice and
spoils it, which its residual then shows.

Such a force, white, is a slow drift of the position. While position noise still covers it in every
octave of the residual, it moves damping and friction by more than that noise does, and hardly
differs from one part of a log to the next, which is where leaving out blocks looks. So its variance
is estimated from the lowest lines of the residual, by restricted maximum likelihood: what the fit
has taken up of these lines is accounted for (Patterson and Thompson, Biometrika 58, 1971, p. 545).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import Estimate, PointEstimate, spread
from identification.estimators.filters import is_coloured, recursive, whiteness
from identification.estimators.least_squares import Regression, complete_estimate
from identification.estimators.linear import (
    physical,
    solve_separable,
    symmetric_inverse,
    unit_columns,
)
from identification.estimators.response import Drive, Gain, HeldResponse, StepResponse
from identification.estimators.signals import HeldColumn
from identification.estimators.stick_slip import FrictionProblem, PositionFit

FloatArray = NDArray[np.float64]

#: A log is looked at in so many parts at most, which hold the lines that matter.
_PARTS = 512
#: Lines of the residual, from the lowest on, that tell the force from position noise.
_LINES = 64
#: Variances tried, from so little of the position noise in the line that shows most of it to so
#: much, each this many times the one before: its root, which intervals go by, is right to 7 %.
_LEAST, _MOST, _RATIO = 1e-3, 1e9, 1.15
#: Directions this much weaker than the strongest carry nothing but rounding.
_ROUNDING = 1e-10
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


def process_noise_covariance(
    jacobian: FloatArray, residual: FloatArray, keep: int, *, mass: float, rate: float, step: float
) -> FloatArray:
    """What a white force adds to the covariance of a fit of positions, shape (keep, keep).

    The rate is b/m; where no such force is seen, nothing is added.
    """
    rows = residual.size
    parts = min(rows, _PARTS)
    starts = np.linspace(0, rows, parts, endpoint=False).astype(np.intp)
    counts = np.diff(starts, append=rows)
    unit, norms = unit_columns(jacobian.T)
    sums = np.add.reduceat(unit.T, starts, axis=1)
    pushed = _Pushed(mass, max(rate, 0.0), step * rows / parts)
    variance = _variance(sums / counts, np.add.reduceat(residual, starts) / counts, pushed)
    inverse = symmetric_inverse(unit.T @ unit, _ROUNDING)[:keep]
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
    """The likeliest variance of a force held for one part each, beside columns the fit took up."""
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
    """Orthonormal rows of the same span; ``power`` is that of a row that lost nothing."""
    powers, mixed = np.linalg.eigh(rows @ rows.T)
    strong = powers > _ROUNDING * power
    return (mixed[:, strong] / np.sqrt(powers[strong])).T @ rows


class _Acting(NamedTuple):
    """The device at one θ, its inputs, and what each of them adds in every interval."""

    device: HeldResponse
    inputs: tuple[HeldColumn, ...]
    gains: tuple[Gain, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Problem:
    """Position of one log as a separable model in θ = (p,) or (p, delay)."""

    drive: Drive  # inputs
    position: FloatArray  # measured, about its mean, m, shape (n,)
    #: first sample after intervals that feel only logged forces; what happens before is in q0 and
    #: v0
    known: int
    #: what acted at the last θ looked at, by its bytes
    last: dict[bytes, _Acting] = field(default_factory=dict[bytes, _Acting])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        return self.drive.bounds()

    def allowed(self, theta: FloatArray) -> bool:
        return bool(np.all(np.isfinite(theta)))

    def _acting(self, theta: FloatArray) -> _Acting:
        """Slopes are asked for at the θ that columns were made for last."""
        key = theta.tobytes()
        if key not in self.last:
            device = HeldResponse.at(float(theta[0]), self.drive.steps)
            inputs = self.drive.inputs(self.drive.delay_of(theta))
            self.last.clear()
            self.last[key] = _Acting(device, inputs, tuple(device.gain(held) for held in inputs))
        return self.last[key]

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        device, _, gains = self._acting(theta)
        columns = np.empty((len(gains) + 2, self.position.size - self.known))
        for index, gain in enumerate(gains):
            columns[index] = device.position(gain)[0][self.known :]
        columns[-2] = device.coasting(self.position.size - 1)[self.known :]
        columns[-1] = 1.0
        return columns, self.position[self.known :]

    def slopes(self, theta: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
        del residual
        device, inputs, gains = self._acting(theta)
        velocity, distance, added = (np.zeros(self.position.size - 1) for _ in range(3))
        for weight, held, driven in zip(weights, inputs, gains, strict=False):
            slope = device.slope_by_rate(held)
            velocity += weight * slope.velocity
            distance += weight * slope.distance
            added += weight * driven.velocity
        speed = device.speed(added, start=float(weights[-2]))
        gain = Gain(velocity=velocity, distance=distance)
        slopes = [device.position_slope(speed, gain)[self.known :]]
        if self.drive.delay is None:
            later = self.drive.slope_by_delay(device, self.drive.delay_of(theta))
            slopes.append(weights[0] * device.position(later)[0][self.known :])
        return np.stack(slopes)


def point(table: Regression, delay: float | None, *, start: float = 0.0) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    return _point(table, _found(table, delay, start if delay is None else delay), delay)


def fit(table: Regression, delay: float | None, *, start: float = 0.0) -> Estimate:
    """Mass, damping and friction by output error; the residual is in position."""
    found = _found(table, delay, start if delay is None else delay)
    best, size, fitted = _point(table, found, delay), len(table.model.parameters), delay is None
    values, jacobian, residual = best.values, found.jacobian, found.residual
    around = spread(jacobian, residual, size + fitted, signal=values[0] * jacobian[0])
    drift = process_noise_covariance(
        jacobian,
        residual,
        size + fitted,
        mass=float(values[0]),
        rate=float(values[1] / values[0]),
        step=table.signals.step,
    )
    around = replace(around, covariance=around.covariance + drift)
    notes = () if found.converged else ("the search ended before it settled",)
    return complete_estimate(
        "output-error", table, best, around, fitted=fitted, unit="position", notes=notes
    )


def _found(table: Regression, delay: float | None, first: float) -> PositionFit:
    """The better of the fits with the direction of motion as measured, and as simulated."""
    projected = _projected(table, delay, first)
    if not table.model.coulomb:
        return projected
    if not _rubs(table, projected) and not is_coloured(projected.residual):
        # Nothing is left over, and there is no friction whose turns could be told better.
        return projected
    found = _turning(table, delay, first)
    if found is None:
        return projected
    doubted = not _rubs(table, found) or whiteness(found.residual) > _DOUBTED
    if doubted and (not _rubs(table, projected) or projected.cost < found.cost):
        return projected
    return found


def _point(table: Regression, found: PositionFit, delay: float | None) -> PointEstimate:
    size, position = len(table.model.parameters), table.signals.position[table.known :]
    return PointEstimate(
        values=found.values[:size],
        delay=float(found.values[size]) if delay is None else delay,
        signal=position - np.mean(position),
        residual=found.residual,
    )


def _rubs(table: Regression, found: PositionFit) -> bool:
    """Whether there is friction to speak of, without which nothing turns."""
    if not table.model.coulomb:
        return False
    at = table.model.parameters.index("coulomb_friction")
    unit, norms = unit_columns(found.jacobian.T)
    inverse = symmetric_inverse(unit.T @ unit)
    variance = float(found.residual @ found.residual) / found.residual.size
    return bool(found.values[at] > _RUBBING * np.sqrt(variance * inverse[at, at]) / norms[at])


def _turning(table: Regression, delay: float | None, first: float) -> PositionFit | None:
    """The fit whose turns are those of its own simulation."""
    signals = table.signals
    turns = FrictionProblem(
        signals=signals,
        model=table.model,
        drive=Drive.bare(signals, delay),
        known=table.known,
        mean_speed=table.mean_speed,
    )
    standing = table.motion.moving[0] == 0
    speed = 0.0 if standing else float(np.mean(signals.speed[:_FIRST_LOOK]))
    fitted = [first] if delay is None else []
    start = np.array([*table.solve(first), *fitted, speed, signals.position[0]])
    if signals.position.size > _LONG:
        begun = turns.part(_LONG).fit(start)
        if begun is not None and begun.converged and _rubs(table, begun):
            start = begun.values
    return turns.fit(start)


def _projected(table: Regression, delay: float | None, first: float) -> PositionFit:
    """The fit with the direction of motion as measured, which matters only with friction."""
    signals = table.signals
    problem = _Problem(
        drive=Drive.of(table, delay),
        position=signals.position - np.mean(signals.position),
        known=table.known,
    )
    rate = problem.drive.rate_of(table.solve(first))
    best = solve_separable(problem, np.array([rate] if delay is not None else [rate, first]))
    values, jacobian = physical(best, len(table.model.parameters))
    return PositionFit(
        values=np.concatenate((values, best.theta[1:])),
        jacobian=jacobian,
        residual=best.residual,
        converged=best.converged,
    )
