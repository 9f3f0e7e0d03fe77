"""Output error by variable projection: the simulated position against the measured one.

Exact for held inputs and any time stamps; docs/theory.md, 7. Best where position noise is all there
is; a force that the log does not know integrates twice and spoils it, which its residual then
shows, or moves damping and friction before it does (``process_noise_covariance``).

Where the direction of motion is read from a noisy position, every turn is off by part of a sample,
always a little to the same side, and the error integrates twice. With Coulomb friction it follows
from the parameters themselves: between two turns the motion is that of a mass with damping under a
held force, known from one response of the whole log, so only turns cost a step of a loop. At a turn
a change of velocity goes on as the part ρ = a⁺/a⁻ of itself, or ends where the device comes to rest
(the saltation of Leine and Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
2004, section 7.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.estimators.estimate import (
    UNSETTLED,
    Estimate,
    PointEstimate,
    gauss_newton,
    physical,
    process_noise_covariance,
    solve_separable,
    spread,
    symmetric_inverse,
    unit_columns,
)
from identification.estimators.filters import is_coloured, whiteness
from identification.estimators.least_squares import FIRST_LOOK, Drive, Regression, complete_estimate
from identification.estimators.motion import Direction, Motion, Path, others, path, terms
from identification.estimators.signals import HeldColumn, HeldResponse, accumulate_decay
from identification.trajectory import FloatArray

#: Friction this many standard deviations large decides where the device turns; less is taken for
#: noise, and the direction of motion as measured.
_CLEAR = 3.0
#: A residual further from white than this may come from a search that went astray.
_DOUBTED = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class _Problem:
    """Position of one log as a separable model in θ = (p,) or (p, delay)."""

    drive: Drive  # inputs
    position: FloatArray  # measured, about its mean, m, shape (n,)
    #: first sample after intervals that feel only logged forces; what happens before is in q0 and
    #: v0
    known: int

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        return self.drive.bounds()

    def allowed(self, theta: FloatArray) -> bool:
        return bool(np.all(np.isfinite(theta)))

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        device = HeldResponse.at(float(theta[0]), self.drive.steps)
        inputs = self.drive.inputs(self.drive.delay_of(theta))
        columns = np.empty((len(inputs) + 2, self.position.size - self.known))
        for index, held in enumerate(inputs):
            columns[index] = device.position(device.gain(held))[0][self.known :]
        columns[-2] = device.coasting(self.position.size - 1)[self.known :]
        columns[-1] = 1.0
        return columns, self.position[self.known :]

    def slopes(self, theta: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
        del residual
        device = HeldResponse.at(float(theta[0]), self.drive.steps)
        inputs = self.drive.inputs(self.drive.delay_of(theta))
        moved, added = np.zeros((2, self.position.size - 1)), np.zeros(self.position.size - 1)
        for weight, held in zip(weights, inputs, strict=False):
            moved += weight * device.slope_by_rate(held)
            added += weight * device.gain(held)[0]
        speed = device.speed(added, start=float(weights[-2]))
        moved += speed[:-1] * _coasting_slope(device)
        slopes = [device.position(moved)[0][self.known :]]
        if self.drive.delay is None:
            later = self.drive.slope_by_delay(device, self.drive.delay_of(theta))
            slopes.append(weights[0] * device.position(later)[0][self.known :])
        return np.stack(slopes)


def point(table: Regression, delay: float, *, fits_delay: bool = False) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    return _point(table, _found(table, delay, fits_delay=fits_delay), delay, fits_delay=fits_delay)


def fit(table: Regression, delay: float, *, fits_delay: bool = False) -> Estimate:
    """Mass, damping and friction by output error; the residual is in position."""
    found = _found(table, delay, fits_delay=fits_delay)
    best = _point(table, found, delay, fits_delay=fits_delay)
    keep = len(table.model.parameters) + fits_delay
    values, jacobian, residual = best.values, found.jacobian, found.residual
    around = spread(jacobian, residual, keep, signal=values[0] * jacobian[0])
    drift = process_noise_covariance(
        jacobian,
        residual,
        keep,
        mass=float(values[0]),
        rate=float(values[1] / values[0]),
        step=table.signals.step,
    )
    around = replace(around, covariance=around.covariance + drift)
    notes = () if found.converged else (UNSETTLED,)
    return complete_estimate(
        "output-error", table, best, around, fitted=fits_delay, unit="position", notes=notes
    )


def _found(table: Regression, first: float, *, fits_delay: bool) -> PositionFit:
    """The better of the fits with the direction of motion as measured, and as simulated."""
    projected = _projected(table, first, fits_delay=fits_delay)
    if not table.model.coulomb:
        return projected
    if not _has_friction(table, projected) and not is_coloured(projected.residual):
        # Nothing is left over, and there is no friction whose turns could be told better.
        return projected
    drive = Drive.bare(table.signals, None if fits_delay else first)
    found = _Turning(table=table, drive=drive).fit(first)
    if found is None:
        return projected
    doubted = not _has_friction(table, found) or whiteness(found.residual) > _DOUBTED
    if doubted and (not _has_friction(table, projected) or projected.cost < found.cost):
        return projected
    return found


def _point(
    table: Regression, found: PositionFit, delay: float, *, fits_delay: bool
) -> PointEstimate:
    size, position = len(table.model.parameters), table.signals.position[table.known :]
    return PointEstimate(
        values=found.values[:size],
        delay=float(found.values[size]) if fits_delay else delay,
        signal=position - np.mean(position),
        residual=found.residual,
    )


def _has_friction(table: Regression, found: PositionFit) -> bool:
    """Whether there is friction to speak of, without which nothing turns."""
    if not table.model.coulomb:
        return False
    at = table.model.parameters.index("coulomb_friction")
    unit, norms = unit_columns(found.jacobian.T)
    inverse = symmetric_inverse(unit.T @ unit)
    variance = float(found.residual @ found.residual) / found.residual.size * inverse[at, at]
    # Rounding makes that of what nothing tells negative.
    return bool(variance >= 0 and found.values[at] > _CLEAR * np.sqrt(variance) / norms[at])


def _projected(table: Regression, first: float, *, fits_delay: bool) -> PositionFit:
    """The fit with the direction of motion as measured, which matters only with friction."""
    signals = table.signals
    problem = _Problem(
        drive=Drive.of(table, None if fits_delay else first),
        position=signals.position - np.mean(signals.position),
        known=table.known,
    )
    rate = problem.drive.rate_of(table.solve(first))
    best = solve_separable(problem, np.array([rate, *([first] * fits_delay)]))
    values, jacobian = physical(best, len(table.model.parameters))
    return PositionFit(
        values=np.concatenate((values, best.theta[1:])),
        jacobian=jacobian,
        residual=best.residual,
        converged=best.converged,
    )


#: Steps of Gauss-Newton; from an estimate within its interval it takes three or four.
_MOST_STEPS = 15
#: Times a step that makes the fit worse is halved before it is given up.
_MOST_HALVINGS = 8
#: The search ends when a step is shorter than this part of the standard deviation along it.
_CONVERGED = 0.05
#: Directions this much weaker than the strongest carry nothing but rounding.
_NOTHING = 1e-13


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionFit:
    """A fit of the simulated to the measured position."""

    #: m, b, terms, then the delay if it is fitted, then nuisance; shape (parameters + nuisance,)
    values: FloatArray
    #: derivative of the position by parameters, delay, start velocity and position, shape
    #: (parameters + nuisance, rows)
    jacobian: FloatArray
    residual: FloatArray  # m, shape (rows,)
    converged: bool  # whether the search ended because steps became short

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Simulated:
    """One simulation: everything its derivatives need."""

    values: FloatArray  # see _Turning
    #: the device forward and backward; one alone where friction is the same
    ways: tuple[HeldResponse, ...]
    inputs: tuple[HeldColumn, ...]  # force, then the terms beside damping, where they act
    along: Path  # the path
    residual: FloatArray  # m, shape (rows,)

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)

    def by_way(self, of_device: Callable[[HeldResponse], FloatArray]) -> FloatArray:
        """A quantity of each interval, from the device as it moves there."""
        if len(self.ways) == 1:
            return of_device(self.ways[0])
        forward, backward = (of_device(way) for way in self.ways)
        return np.where(self.along.forward, forward, backward)

    def gain(self, held: HeldColumn) -> FloatArray:
        """Velocity and distance that a column adds, shape (2, n - 1)."""
        return self.by_way(lambda way: way.gain(held))

    def slope_by_rate(self, held: HeldColumn) -> FloatArray:
        """Derivative of ``gain`` by p."""
        return self.by_way(lambda way: way.slope_by_rate(held))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Turning:
    """The output-error problem of one log with Coulomb friction, turns as simulated.

    Values are m, b, terms, the delay if it is fitted, start velocity, start position.
    """

    table: Regression
    drive: Drive  # the force; its delay is None if it is fitted

    def fit(self, delay: float) -> PositionFit | None:
        """The best fit from that of the regression; None if friction or mass vanish there."""
        table, signals = self.table, self.table.signals
        standing = table.motion.moving[0] == 0
        speed = 0.0 if standing else float(np.mean(signals.speed[:FIRST_LOOK]))
        late = [delay] * (self.drive.delay is None)
        best = self._simulated(np.array([*table.solve(delay), *late, speed, signals.position[0]]))
        if best is None:
            return None
        jacobian, fresh, converged = self._jacobian(best), True, False
        for _ in range(_MOST_STEPS):
            move, gain = self._move(best, jacobian)
            converged = gain <= _CONVERGED**2
            if converged:
                break
            # A Jacobian is the dear part, and one step old it is still good enough to end with.
            if not fresh:
                jacobian, fresh = self._jacobian(best), True
                continue
            trial = self._improved(best, move)
            if trial is None:
                break
            best, fresh = trial, False
        return PositionFit(
            values=best.values, jacobian=jacobian, residual=best.residual, converged=converged
        )

    def _move(self, best: _Simulated, jacobian: FloatArray) -> tuple[FloatArray, float]:
        """The Gauss-Newton step, with a delay that stays within its bounds."""
        move, gain = gauss_newton(jacobian, best.residual, _NOTHING)
        least, most = np.array(self.drive.delays) - self._delay(best.values)
        if self.drive.delay is not None or least <= move[-3] <= most:
            return move, gain
        fixed, later = jacobian.copy(), float(np.clip(move[-3], least, most))
        fixed[-3] = 0.0
        move, gain = gauss_newton(fixed, best.residual - later * jacobian[-3], _NOTHING)
        move[-3] = later
        return move, gain

    def _improved(self, best: _Simulated, move: FloatArray) -> _Simulated | None:
        for halving in range(_MOST_HALVINGS):
            trial = self._simulated(best.values + move / 2**halving)
            if trial is not None and trial.cost < best.cost:
                return trial
        return None

    def _delay(self, values: FloatArray) -> float:
        return float(values[-3]) if self.drive.delay is None else self.drive.delay

    def _simulated(self, values: FloatArray) -> _Simulated | None:
        model, signals, steps = self.table.model, self.table.signals, self.drive.steps
        known = dict(zip(model.parameters, values.tolist(), strict=False))
        mass, friction = known["mass"], known["coulomb_friction"]
        delay, (least, most) = self._delay(values), self.drive.delays
        if not (mass > 0 and friction > 0 and least <= delay <= most):
            return None
        # The asymmetry is in the ways; its column is about the mean speed, which leaves an offset.
        asymmetry = known.get("damping_asymmetry", 0.0)
        known["force_offset"] = known.get("force_offset", 0.0) - asymmetry * self.table.mean_speed
        ways = tuple(
            HeldResponse.at((known["damping"] + side) / mass, steps)
            for side in ((asymmetry, -asymmetry) if model.directional else (0.0,))
        )
        slowest, fastest = self.drive.rates
        if not all(slowest <= way.rate <= fastest for way in ways):
            return None
        force = self.drive.commands.after(delay)
        # Without an asymmetry no other term leans on the direction.
        anyway = Motion.always(self.drive.moving.size, steps)
        plain = replace(model, directional=False)
        rest = others(plain, anyway, signals.position, steps, known)
        resisting = HeldColumn.constant(rest, steps)
        driven = [
            Direction(way.rate, way.speed((way.gain(force)[0] - way.gain(resisting)[0]) / mass))
            for way in ways
        ]
        along = path(
            driven[0],
            driven[-1],
            replace(force, level=force.level - rest),
            mass=mass,
            friction=friction,
            start=float(values[-2]),
        )
        moving = along.motion.moving
        inputs = (force.times(moving), along.motion.direction, resisting.times(moving))
        point = _Simulated(
            values=values, ways=ways, inputs=inputs, along=along, residual=np.empty(0)
        )
        moved = point.by_way(lambda way: way.full.speed * along.speed[:-1])
        for weight, held in zip((1.0, -friction, -1.0), inputs, strict=True):
            moved = moved + weight / mass * point.gain(held)[1]
        simulated = float(values[-1]) + np.concatenate(([0.0], np.cumsum(moved)))
        residual = (signals.position - simulated)[self.table.known :]
        return replace(point, residual=residual) if np.all(np.isfinite(residual)) else None

    def _jacobian(self, point: _Simulated) -> FloatArray:
        values, along, model = point.values, point.along, self.table.model
        mass, moving = float(values[0]), along.motion.moving
        intervals = moving.size
        added: dict[str, FloatArray] = {}
        # What the forces add, and its derivative by p where the device moves that way.
        net, by_rate = np.zeros((2, 2, intervals))
        for weight, held in zip((1.0, -values[2], -1.0), point.inputs, strict=True):
            net -= weight / mass**2 * point.gain(held)
            by_rate += weight / mass * point.slope_by_rate(held)
        by_rate += moving * along.speed[:-1] * point.by_way(_coasting_slope)
        rates = point.by_way(lambda way: np.full(intervals, way.rate))
        added["mass"] = net - rates / mass * by_rate
        added["damping"] = by_rate / mass
        beside, _ = terms(model, along.motion, self.table.signals.position, self.drive.steps)
        for name, held in zip(model.parameters[2:], beside, strict=True):
            added[name] = -point.gain(held) / mass
        if model.directional:
            side = np.where(along.forward, 1.0, -1.0)
            constant = added["force_offset"]
            added["damping_asymmetry"] = side * added["damping"] - self.table.mean_speed * constant
        if self.drive.delay is None:
            delay = self._delay(values)
            later = point.by_way(lambda way: self.drive.slope_by_delay(way, delay))
            added["delay"] = later * moving / mass
        added["start"] = np.zeros((2, intervals))
        names = tuple(added)
        decay = point.by_way(lambda way: np.broadcast_to(way.full.decay, moving.shape))
        full = point.by_way(lambda way: np.broadcast_to(way.full.speed, moving.shape))
        # A device that stands at the start does not heed a small velocity.
        start = [*([0.0] * (len(names) - 1)), float(moving[0])]
        speeds = accumulate_decay(decay * along.kept, [added[name][0] for name in names], start)
        jacobian = np.empty((len(names) + 1, intervals + 1))
        jacobian[-1], jacobian[:-1, 0] = 1.0, 0.0
        for row, name in enumerate(names):
            moved = full * speeds[row, :-1]
            moved += added[name][1]
            np.cumsum(moved, out=jacobian[row, 1:])
        return jacobian[:, self.table.known :]


def _coasting_slope(way: HeldResponse) -> FloatArray:
    """Slope by p of what is left of a velocity and of the distance coasted, (2, 1 or n - 1)."""
    full = way.full
    return np.stack((np.atleast_1d(full.decay_slope), np.atleast_1d(full.speed_slope)))
