"""Output error with Coulomb friction: velocity reversals come from the simulated device.

Where the direction of motion is read from a noisy position, every turn is off by part of a sample,
always a little to the same side, and the error integrates twice. Here it follows from the
parameters themselves, and Gauss-Newton goes over all of them with the exact sensitivity of every
turn (stick_slip.py). One file: model, derivatives and steps of one search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from identification.estimators.drive import Drive
from identification.estimators.held_response import Gain, HeldResponse, accumulate_decay
from identification.estimators.linear import gauss_newton
from identification.estimators.model import Model
from identification.estimators.motion import Motion
from identification.estimators.rows import Signals
from identification.estimators.stick_slip import Direction, Path, path
from identification.estimators.terms import others, terms
from identification.estimators.zero_order_hold import HeldColumn

FloatArray = NDArray[np.float64]

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
    """A fit of the simulated to the measured position.

    Attributes:
        values: m, b, terms, then the delay if it is fitted, then nuisance; shape
            (parameters + nuisance,).
        jacobian: derivative of the position by parameters, delay, start velocity and position,
            shape (parameters + nuisance, rows).
        residual: m, shape (rows,).
        converged: whether the search ended because steps became short.
    """

    values: FloatArray
    jacobian: FloatArray
    residual: FloatArray
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Simulated:
    """One simulation: everything its derivatives need.

    Attributes:
        values: see Turns.fit.
        ways: the device forward and backward; one alone where friction is the same.
        inputs: force, then the terms beside damping, where they act.
        along: the path.
        residual: m, shape (rows,).
    """

    values: FloatArray
    ways: tuple[HeldResponse, ...]
    inputs: tuple[HeldColumn, ...]
    along: Path
    residual: FloatArray

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)

    def by_way(self, of_device: Callable[[HeldResponse], FloatArray]) -> FloatArray:
        """A quantity of each interval, from the device as it moves there."""
        if len(self.ways) == 1:
            return of_device(self.ways[0])
        forward, backward = (of_device(way) for way in self.ways)
        return np.where(self.along.forward, forward, backward)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionProblem:
    """The output-error problem of one log with Coulomb friction.

    Attributes:
        signals: of the log.
        model: with Coulomb friction.
        drive: the force; its delay is None if it is fitted.
        known: first sample after intervals that feel only logged forces.
        mean_speed: s of the model, m/s.
    """

    signals: Signals
    model: Model
    drive: Drive
    known: int
    mean_speed: float

    def part(self, samples: int) -> FrictionProblem:
        """The problem of the first samples alone."""
        signals = self.signals.part(samples)
        return replace(self, signals=signals, drive=Drive.bare(signals, self.drive.delay))

    def fit(self, start: FloatArray) -> PositionFit | None:
        """The best fit; None if friction or mass vanish at the start.

        Args:
            start: m, b, terms, the delay if it is fitted, start velocity, start position; shape
                (parameters + nuisance,).
        """
        best = self._simulated(start)
        if best is None:
            return None
        jacobian, fresh, converged = self._jacobian(best), True, False
        for _ in range(_MOST_STEPS):
            move, gain = gauss_newton(jacobian, best.residual, _NOTHING)
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

    def _improved(self, best: _Simulated, move: FloatArray) -> _Simulated | None:
        for halving in range(_MOST_HALVINGS):
            trial = self._simulated(best.values + move / 2**halving)
            if trial is not None and trial.cost < best.cost:
                return trial
        return None

    def _delay(self, values: FloatArray) -> float:
        return float(values[-3]) if self.drive.delay is None else self.drive.delay

    def _simulated(self, values: FloatArray) -> _Simulated | None:
        model, steps = self.model, self.drive.steps
        known = dict(zip(model.parameters, values.tolist(), strict=False))
        mass, friction = known["mass"], known["coulomb_friction"]
        delay, (least, most) = self._delay(values), self.drive.delays
        if not (mass > 0 and friction > 0 and least <= delay <= most):
            return None
        # The asymmetry is in the ways; its column is about the mean speed, which leaves an offset.
        asymmetry = known.get("damping_asymmetry", 0.0)
        known["force_offset"] = known.get("force_offset", 0.0) - asymmetry * self.mean_speed
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
        rest = others(plain, anyway, self.signals.position, steps, known)
        resisting = HeldColumn.constant(rest, steps)
        driven = [
            Direction.of(
                way, way.speed((way.gain(force).velocity - way.gain(resisting).velocity) / mass)
            )
            for way in ways
        ]
        along = path(
            driven[0],
            driven[-1],
            force.mean() - rest,
            mass=mass,
            friction=friction,
            start=float(values[-2]),
        )
        moving = along.motion.moving
        inputs = (force.times(moving), along.motion.direction, resisting.times(moving))
        point = _Simulated(
            values=values, ways=ways, inputs=inputs, along=along, residual=np.empty(0)
        )
        moved = point.by_way(lambda way: way.whole.speed * along.speed[:-1])
        for weight, held in zip((1.0, -friction, -1.0), inputs, strict=True):
            gained = point.by_way(partial(_distance, held))
            moved = moved + weight / mass * gained
        simulated = float(values[-1]) + np.concatenate(([0.0], np.cumsum(moved)))
        residual = (self.signals.position - simulated)[self.known :]
        return replace(point, residual=residual) if np.all(np.isfinite(residual)) else None

    def _jacobian(self, point: _Simulated) -> FloatArray:
        values, along, names = point.values, point.along, self.model.parameters
        mass, moving = float(values[0]), along.motion.moving
        intervals = moving.size
        added: dict[str, FloatArray] = {}
        # What the forces add, and its derivative by p where the device moves that way.
        net, by_rate = np.zeros((2, 2, intervals))
        for weight, held in zip((1.0, -values[2], -1.0), point.inputs, strict=True):
            net -= weight / mass**2 * point.by_way(partial(_gain, held))
            by_rate += weight / mass * point.by_way(partial(_slope, held))
        by_rate += moving * along.speed[:-1] * point.by_way(_coasting_slope)
        rates = point.by_way(lambda way: np.full(intervals, way.rate))
        added["mass"] = net - rates / mass * by_rate
        added["damping"] = by_rate / mass
        found = terms(self.model, along.motion, self.signals.position, self.drive.steps)
        for name, held in zip(names[2:], found.columns, strict=True):
            added[name] = -point.by_way(partial(_gain, held)) / mass
        if self.model.directional:
            side = np.where(along.forward, 1.0, -1.0)
            constant = added["force_offset"]
            added["damping_asymmetry"] = side * added["damping"] - self.mean_speed * constant
        if self.drive.delay is None:
            delay = self._delay(values)
            later = point.by_way(lambda way: _pair(self.drive.slope_by_delay(way, delay)))
            added["delay"] = later * moving / mass
        added["start"] = np.zeros((2, intervals))
        names = tuple(added)
        decay = point.by_way(lambda way: np.broadcast_to(way.whole.decay, moving.shape))
        whole = point.by_way(lambda way: np.broadcast_to(way.whole.speed, moving.shape))
        # A device that stands at the start does not heed a small velocity.
        start = [*([0.0] * (len(names) - 1)), float(moving[0])]
        speeds = accumulate_decay(decay * along.kept, [added[name][0] for name in names], start)
        jacobian = np.empty((len(names) + 1, intervals + 1))
        jacobian[-1], jacobian[:-1, 0] = 1.0, 0.0
        for row, name in enumerate(names):
            moved = whole * speeds[row, :-1]
            moved += added[name][1]
            np.cumsum(moved, out=jacobian[row, 1:])
        return jacobian[:, self.known :]


def _pair(gain: Gain) -> FloatArray:
    """Velocity and distance as rows, shape (2, n - 1)."""
    return np.stack((gain.velocity, gain.distance))


def _distance(held: HeldColumn, way: HeldResponse) -> FloatArray:
    return way.gain(held).distance


def _gain(held: HeldColumn, way: HeldResponse) -> FloatArray:
    return _pair(way.gain(held))


def _slope(held: HeldColumn, way: HeldResponse) -> FloatArray:
    return _pair(way.slope_by_rate(held))


def _coasting_slope(way: HeldResponse) -> FloatArray:
    """Slope by p of what is left of a velocity and of the distance coasted, (2, 1 or n - 1)."""
    whole = way.whole
    return np.stack((np.atleast_1d(whole.decay_slope), np.atleast_1d(whole.speed_slope)))
