"""Estimates of several axes together: filtered least squares, instruments, output error."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from identification.estimators.estimate import Spread, gauss_newton, spread, unit_inverse
from identification.estimators.instruments import explained_by_reference, solve_instrumental
from identification.estimators.joint import JointLog, JointModel, Rows
from identification.estimators.joint_motion import DevicesOfAxes
from identification.estimators.least_squares import CUT_OFF_RANGE, FASTEST, FIRST_LOOK
from identification.estimators.signals import unknown_intervals
from identification.trajectory import BoolArray, FloatArray, Trajectories

JointMethod = Literal["least-squares", "instruments", "output-error"]

#: Steps of Gauss and Newton, and the part of a deviation (of the sum of squares over the variance
#: of one) below which they end.
_MOST_STEPS, _CONVERGED = 30, 0.2
#: Tries of each, ever shorter: the damping of Levenberg and Marquardt, and how it grows.
_MOST_TRIES, _FIRST, _MORE = 10, 1e-5, 10.0
#: What more a step promises, in variances of a residual, than a search that has ended; how often
#: the whole of such a step is taken, be it for the worse at first.
_BARRED, _MOST_JUMPS = 10.0, 3
#: Steps that gain less than this end it, so many after one another.
_SLOW, _MOST_SLOW = 0.5, 3
#: Part of a size by which an entry is moved for the slope of the motion by it.
NUDGE = 1e-6
#: ... and of a sample, by which the delay is.
LATER = 1e-3
#: Change of a delay, in samples, for the slope of the estimates by it.
_DELAY_STEP = 0.05
#: Weights have settled when none changes by this part; an axis of this little mass has none.
_WEIGHED, _SINGULAR = 0.01, 1e-9
#: Friction of an axis is estimated if least squares find this many deviations of it.
_CLEAR = 3.0
#: Readings that range over fewer deviations of their noise are of an axis that stands.
_STILL = 6.0
#: Directions this much weaker than the strongest carry nothing but rounding.
_NOTHING = 1e-13


class NoMassError(Exception):
    """The mass matrix is not positive definite, so that there is no motion to simulate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointEstimate:
    """One method's answer for the logs of several axes at one pose; SI units."""

    method: JointMethod
    model: JointModel
    delay: float  # s, given or fitted
    delay_deviation: float | None = None  # s; None if it was given
    values: FloatArray  # shape (p,), in the order of ``model.parameters``
    covariance: FloatArray  # shape (p, p)
    degrees_of_freedom: float
    #: of each log, m, shape (axes, n); None of filtered methods: what is simulated of it and, from
    #: the first sample on that feels known forces only, left over
    positions: tuple[FloatArray, ...] | None = None
    residuals: tuple[FloatArray, ...] | None = None

    def told(self, name: str) -> tuple[float, float]:
        """One unknown and its standard deviation; 0 where the model leaves it out."""
        if name not in self.model.parameters:
            return 0.0, 0.0
        place = self.model.parameters.index(name)
        return float(self.values[place]), float(np.sqrt(self.covariance[place, place]))

    @property
    def matrices(self) -> tuple[FloatArray, FloatArray]:
        """Λ, kg (kg·m²), and D, N·s/m (N·m·s/rad)."""
        return self.model.matrices(self.values)


def prepare_axes(logs: Sequence[Trajectories], delay: float, room: float, doubt: float) -> JointLog:
    """The logs of a pose at a delay, s, without friction that least squares take for noise."""
    prepared = JointLog.of(logs, delay, room, doubt)
    found = _filtered(prepared, "least-squares")
    told = [found.told(f"coulomb_friction_{axis}") for axis in prepared.model.axes]
    kept = tuple(value > _CLEAR * deviation for value, deviation in told)
    return prepared if kept == prepared.model.coulomb else prepared.with_friction(kept)


def fit_jointly(
    prepared: JointLog, method: JointMethod, *, fits_delay: bool = False
) -> JointEstimate:
    """The estimate of one method. Raises NoMassError where there is no mass to start from."""
    if method == "output-error":
        return _output_error(prepared, fits_delay=fits_delay)
    found = _filtered(prepared, method)
    if not prepared.doubt:
        return found
    # A delay of d looks like an added damping of -Λ·ω²·d.
    step = _DELAY_STEP * prepared.step
    late = replace(prepared, delay=prepared.delay + step)
    slope = (late.solve() - prepared.solve()) / step
    added = prepared.doubt**2 * np.outer(slope, slope)
    return replace(found, covariance=found.covariance + added)


def _filtered(prepared: JointLog, method: JointMethod) -> JointEstimate:
    """Least squares, or the rows tested against columns that are free of the log's own noise."""
    positions = noise_free_positions(prepared) if method == "instruments" else None
    values, around = solve_rows(prepared, positions)
    return JointEstimate(
        method=method,
        model=prepared.model,
        delay=prepared.delay,
        values=values,
        covariance=around.covariance,
        degrees_of_freedom=around.degrees_of_freedom,
    )


def solve_rows(
    prepared: JointLog, positions: Sequence[Sequence[FloatArray]] | None, *, symmetric: bool = True
) -> tuple[FloatArray, Spread]:
    """Unknowns of the filtered rows, shape (p,), and their spread, cut-offs included; SI units.

    Instruments are columns of the positions, of each log (n,) an axis, m; least squares where they
    are None. Matrices that are not ``symmetric`` have more unknowns, see ``Rows.with_halves``.
    """

    def tested(log: JointLog) -> tuple[FloatArray, Rows, FloatArray]:
        rows = Rows.of(log) if symmetric else Rows.of(log).with_halves(log.model)
        if positions is None:
            return rows.solve(), rows, rows.columns
        seen = Rows.of(log, positions)
        tests = (seen if symmetric else seen.with_halves(log.model)).columns
        return solve_instrumental(tests, rows.columns, rows.target), rows, tests

    values, rows, tests = tested(prepared)
    middle = prepared.parts[0].tables[0].cut_off.frequency
    low, high = (
        tested(prepared.at_cut_off(middle * factor))[0]
        for factor in (1 / CUT_OFF_RANGE, CUT_OFF_RANGE)
    )
    residual = rows.target - values @ rows.columns
    around = spread(rows.columns, residual, len(values), signal=rows.target, instruments=tests)
    shift = (high - low) / 2
    return values, replace(around, covariance=around.covariance + np.outer(shift, shift))


def noise_free_positions(prepared: JointLog) -> Sequence[Sequence[FloatArray]]:
    """Positions that references explain, or, in open loop, those that the forces make."""
    explained = [[explained_by_reference(t) for t in part.tables] for part in prepared.parts]
    known = [[each for each in part if each is not None] for part in explained]
    if all(len(each) == prepared.count for each in known):
        return known
    play = _Playing.of(prepared.along(()), fits_delay=False)
    theta = play.start()
    if not play.allowed(theta):
        raise NoMassError
    positions = [play.positions(part, theta[None])[0] for part in range(len(play.forces))]
    return [list(each) for each in play.whole(positions)]


def devices_of(model: JointModel, thetas: FloatArray, delays: FloatArray) -> DevicesOfAxes:
    """Devices by rows of unknowns, at the end of which are start speeds and places; delays in s."""
    count = len(model.axes)
    matrices = [model.matrices(each) for each in thetas]
    by_axis = [model.friction(each) for each in thetas]
    return DevicesOfAxes(
        mass=np.stack([mass for mass, _ in matrices]),
        damping=np.stack([damping for _, damping in matrices]),
        friction=np.stack([friction for friction, _ in by_axis]),
        offset=np.stack([offset for _, offset in by_axis]),
        delay=delays,
        speed=thetas[:, -2 * count : -count],
        place=thetas[:, -count:],
    )


@dataclass(frozen=True, kw_only=True)
class _Playing:
    """The motion of the logs as a function of all unknowns, the delay and the starts of each."""

    prepared: JointLog
    fits_delay: bool
    forces: tuple[FloatArray, ...]  # of each log, N, shape (n, axes)
    measured: tuple[FloatArray, ...]  # m, likewise
    first: int  # sample from which on every force is known

    @classmethod
    def of(cls, prepared: JointLog, *, fits_delay: bool) -> _Playing:
        """From what a prepared log holds; its steps are even."""
        logs = [log.axes for log in prepared.logs]
        return cls(
            prepared=prepared,
            fits_delay=fits_delay,
            forces=tuple(np.stack([each.force for each in axes], axis=1) for axes in logs),
            measured=tuple(np.stack([each.position for each in axes], axis=1) for axes in logs),
            first=prepared.parts[0].tables[0].known,
        )

    @property
    def count(self) -> int:
        """Unknowns of all logs, before the start speeds and places of each."""
        return len(self.prepared.model.parameters) + self.fits_delay

    def start(self) -> FloatArray:
        """Unknowns by least squares, the delay if it is fitted, start speeds and places."""
        prepared, first = self.prepared, self.first
        values = prepared.solve()
        named = len(prepared.model.pairs) * 2
        rough = slice(named, named + sum(prepared.model.coulomb))
        values[rough] = np.maximum(values[rough], self.sizes[rough])
        tails = [
            np.append(speeds, measured[first])
            for speeds, measured in zip(self.starts[0], self.measured, strict=True)
        ]
        return np.concatenate((values, [prepared.delay] * self.fits_delay, *tails))

    @cached_property
    def sizes(self) -> FloatArray:
        """How far each unknown is moved for the slope of the motion by it."""
        prepared, model = self.prepared, self.prepared.model

        def root_mean_squares(by_log: Sequence[Iterable[FloatArray]]) -> FloatArray:
            columns = [np.concatenate(each) for each in zip(*by_log, strict=True)]
            return np.array([np.sqrt(np.mean(each**2)) for each in columns])

        force = root_mean_squares([each.T for each in self.forces])
        speed = root_mean_squares([part.speeds for part in prepared.parts])
        bend = root_mean_squares([part.bends for part in prepared.parts])
        ratios = [force / np.maximum(each, np.finfo(float).tiny) for each in (bend, speed)]
        entries = [np.sqrt(each[i] * each[j]) for each in ratios for i, j in model.pairs]
        rough = force[[*np.flatnonzero(model.coulomb)]]
        reach = np.max([np.ptp(each, axis=0) for each in self.measured], axis=0)
        return np.concatenate(
            (
                NUDGE * np.concatenate((entries, rough, force)),
                [LATER * prepared.step] * self.fits_delay,
                NUDGE * np.tile(np.append(speed, reach), len(self.measured)),
            )
        )

    def allowed(self, theta: FloatArray) -> bool:
        """Whether it is a device, with friction, at a delay that the log knows the forces for."""
        model = self.prepared.model
        mass, damping = model.matrices(theta)
        friction, _ = model.friction(theta)
        size = np.sqrt(np.abs(np.diag(mass)))
        if np.any(np.diag(mass) <= 0) or np.any(friction[[*np.flatnonzero(model.coulomb)]] <= 0):
            return False
        if np.linalg.eigvalsh(mass / np.outer(size, size))[0] <= _SINGULAR:
            return False
        rates = np.linalg.eigvals(np.linalg.solve(mass, damping)).real
        if np.max(np.abs(rates)) * self.prepared.step > FASTEST:
            return False
        return unknown_intervals(self.prepared.steps, self.delay(theta)) <= self.first

    def within(self, theta: FloatArray) -> FloatArray:
        """With a delay that is fitted not below zero."""
        if self.fits_delay:
            at = len(self.prepared.model.parameters)
            theta = np.concatenate((theta[:at], [max(theta[at], 0.0)], theta[at + 1 :]))
        return theta

    def delay(self, theta: FloatArray) -> float:
        """The delay, s, given or fitted."""
        at = len(self.prepared.model.parameters)
        return float(theta[at]) if self.fits_delay else self.prepared.delay

    def _tail(self, part: int) -> slice:
        """Start speeds and places of a log among all unknowns."""
        size = 2 * self.prepared.count
        return slice(self.count + part * size, self.count + (part + 1) * size)

    def positions(self, part: int, thetas: FloatArray) -> FloatArray:
        """Those of a log from the first known sample on, m, shape (thetas, rows, axes)."""
        delays = np.array([self.delay(each) for each in thetas])
        own = np.hstack((thetas[:, : self.count], thetas[:, self._tail(part)]))
        devices = devices_of(self.prepared.model, own, delays)
        with np.errstate(over="ignore", invalid="ignore"):
            found = devices.positions(self.forces[part], self.prepared.step, self.first)
        return np.moveaxis(found[self.first :], 1, 0)

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions, (rows, axes), log after log, and slopes by every unknown, (k, rows, axes)."""
        moved = np.vstack((theta, theta + np.diag(self.sizes)))
        all_positions: list[FloatArray] = []
        all_slopes: list[FloatArray] = []
        for part in range(len(self.forces)):
            # Where another log starts moves nothing in this one.
            kept = [*range(self.count), *range(len(theta))[self._tail(part)]]
            found = self.positions(part, moved[[0, *(place + 1 for place in kept)]])
            slopes = np.zeros((len(theta), *found.shape[1:]))
            slopes[kept] = (found[1:] - found[0]) / self.sizes[kept, None, None]
            all_positions.append(found[0])
            all_slopes.append(slopes)
        return np.concatenate(all_positions), np.concatenate(all_slopes, axis=1)

    @cached_property
    def starts(self) -> tuple[FloatArray, FloatArray]:
        """Start speeds as the first positions show them, m/s, and how well, shape (logs, axes).

        Friction stops a slow start at once, so that the motion after it does not tell its speed.
        """
        looked = slice(self.first, self.first + FIRST_LOOK)
        span, parts = FIRST_LOOK * self.prepared.step, self.prepared.parts
        speeds = [[float(np.mean(each[looked])) for each in part.speeds] for part in parts]
        bends = [[np.sqrt(np.mean(each[looked] ** 2)) for each in part.bends] for part in parts]
        noise = [[table.signals.noise for table in part.tables] for part in parts]
        deviations = np.array(noise) / span + np.array(bends) * span
        least = np.finfo(float).tiny + self.sizes[self._tail(0)][: self.prepared.count]
        stands = self._stand(np.array(noise))[:, None]
        return np.where(stands, 0.0, speeds), np.maximum(np.where(stands, 0.0, deviations), least)

    def _stand(self, noise: FloatArray) -> BoolArray:
        """Logs all axes of which stand as they begin: readings are still, friction holds them."""
        looked = slice(self.first, self.first + FIRST_LOOK)
        friction, offset = self.prepared.model.friction(self.prepared.solve())
        ranges = np.array([np.ptp(each[looked], axis=0) for each in self.measured])
        pulls = np.array([np.max(np.abs(each[looked] - offset), axis=0) for each in self.forces])
        return np.all((ranges < _STILL * noise) & (pulls < friction), axis=1)

    def weighed(
        self, theta: FloatArray, positions: FloatArray, slopes: FloatArray, scale: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What is left over its scale, (rows,), start speeds last, and its slopes, (k, rows)."""
        count = self.prepared.count
        speeds, deviations = (each.ravel() for each in self.starts)
        tails = [self._tail(part).start for part in range(len(self.forces))]
        places = np.array([tail + axis for tail in tails for axis in range(count)])
        left = (self.left(positions) / scale).ravel()
        columns = np.zeros((len(theta), left.size + places.size))
        columns[:, : left.size] = (slopes / scale).reshape(len(theta), -1)
        columns[places, left.size + np.arange(places.size)] = 1 / deviations
        return np.append(left, (speeds - theta[places]) / deviations), columns

    def scale(self, positions: FloatArray) -> FloatArray:
        """Rms of what is left of each axis, m, shape (axes,)."""
        rest = np.sqrt(np.mean(self.left(positions) ** 2, axis=0))
        reach = np.max([np.ptp(each, axis=0) for each in self.measured], axis=0)
        return np.maximum(rest, np.finfo(float).eps * reach)

    def left(self, positions: FloatArray) -> FloatArray:
        """What is measured less some positions, m, shape (rows, axes)."""
        return np.concatenate([each[self.first :] for each in self.measured]) - positions

    def by_log(self, rows: FloatArray) -> list[FloatArray]:
        """Rows of each log, shape (n, axes)."""
        sizes = [len(each) - self.first for each in self.measured]
        return np.split(rows, np.cumsum(sizes)[:-1])

    def whole(self, positions: Sequence[FloatArray]) -> list[FloatArray]:
        """Positions of each log with the measured ones before, shape (axes, n)."""
        return [
            np.concatenate((measured[: self.first], each)).T
            for measured, each in zip(self.measured, positions, strict=True)
        ]


def _output_error(prepared: JointLog, *, fits_delay: bool) -> JointEstimate:
    """The unknowns whose exact motion comes nearest to that measured, each axis over its rest."""
    play = _Playing.of(prepared, fits_delay=fits_delay)
    theta = play.start()
    if not play.allowed(theta):
        raise NoMassError
    (positions, slopes), scale = play.slopes(theta), np.ones(prepared.count)
    best, least = (theta, positions, slopes), np.inf
    damped, improved, jumps, slow = 0.0, np.inf, 0, 0
    for _ in range(_MOST_STEPS):
        before, scale = scale, play.scale(positions)
        if np.sum(np.log(scale)) < least:
            best, least = (theta, positions, slopes), float(np.sum(np.log(scale)))
        settled = bool(np.all(np.abs(scale / before - 1) < _WEIGHED))
        residual, columns = play.weighed(theta, positions, slopes, scale)
        move, gain = _step(columns, residual, 0.0)
        if damped:  # starts that no full step improves are not followed for their own sake
            gain = min(gain, _gained(columns, move, play.count))
        found, trial = None, theta
        going_on = not settled or (improved > _CONVERGED**2 and slow < _MOST_SLOW)
        if going_on and gain > _CONVERGED**2:
            for tried in range(_MOST_TRIES):
                short = _step(columns, residual, damped)[0] if damped else move
                trial = play.within(theta + short)
                if play.allowed(trial):
                    found = play.slopes(trial)
                    better, _ = play.weighed(trial, *found, scale)
                    improved = float(residual @ residual - better @ better)
                    if improved > 0:
                        slow = slow + 1 if settled and improved < _SLOW else 0
                        if not tried:  # what was just found too far is not tried again
                            damped = damped / _MORE if damped > _FIRST else 0.0
                        break
                    found = None
                damped = max(_MORE * damped, _FIRST)
        if found is None:
            # A rest that comes and goes bars the way to what the slopes promise: once across it.
            trial = play.within(theta + move)
            if gain <= _BARRED or jumps == _MOST_JUMPS or not play.allowed(trial):
                break
            found, damped, improved, jumps = play.slopes(trial), 0.0, np.inf, jumps + 1
        theta, (positions, slopes) = trial, found
    theta, positions, slopes = best
    residual, columns = play.weighed(theta, positions, slopes, play.scale(positions))
    count, size = len(prepared.model.pairs), len(prepared.model.parameters)
    signal = np.asarray(theta[:count] @ columns[:count], dtype=np.float64)
    around = spread(columns, residual, size + fits_delay, signal=signal, instruments=columns)
    return JointEstimate(
        method="output-error",
        model=prepared.model,
        delay=play.delay(theta),
        delay_deviation=float(np.sqrt(around.covariance[size, size])) if fits_delay else None,
        values=theta[:size],
        covariance=around.covariance[:size, :size],
        degrees_of_freedom=around.degrees_of_freedom,
        positions=tuple(play.whole(play.by_log(positions))),
        residuals=tuple(each.T for each in play.by_log(play.left(positions))),
    )


def _step(columns: FloatArray, residual: FloatArray, damped: float) -> tuple[FloatArray, float]:
    """The step of Gauss and Newton and its gain; damped, that of Levenberg and Marquardt."""
    if damped:
        size = np.linalg.norm(columns, axis=1)
        columns = np.hstack((columns, np.sqrt(damped) * np.diag(size)))
        residual = np.append(residual, np.zeros(len(size)))
    return gauss_newton(columns, residual, _NOTHING)


def _gained(columns: FloatArray, move: FloatArray, count: int) -> float:
    """The most that a step gains by one of the first unknowns, in variances of a residual."""
    inverse, size = unit_inverse(columns, _NOTHING)
    variances = np.maximum(np.diag(inverse), _NOTHING)
    return float(np.max(((move * size) ** 2 / variances)[:count]))
