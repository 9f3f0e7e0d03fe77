"""Mass and damping matrices of several axes: least squares, instruments, output error, jointly.

Λ·q̈ + D·q̇ + Fc∘sign(q̇) + f0 = F(t - delay), Λ and D symmetric. The filtered rows of every axis are
those of one axis, with the accelerations and velocities of the others beside its own. The motion is
simulated exactly in the coordinates in which both matrices are diagonal: there every force that is
held moves as many independent masses with damping as there are axes (Golub and Van Loan, Matrix
Computations, 4th edition, section 8.7.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from identification.device.pose import entry_names
from identification.estimators.estimate import Spread, gauss_newton, spread
from identification.estimators.instruments import explained_by_reference
from identification.estimators.joint_motion import DevicesOfAxes
from identification.estimators.least_squares import CUT_OFF_RANGE, Regression, prepare
from identification.estimators.motion import (
    distinguishable_terms,
    refine_motion,
)
from identification.estimators.signals import (
    HeldColumn,
    kinematics_of,
    of_rows,
    unknown_intervals,
)
from identification.trajectories import Trajectories
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]
#: What each axis measures beside others: the column of one unknown in the rows of one axis.
JointMethod = Literal["least-squares", "instruments", "output-error"]

#: Directions of motion are refined by the fitted model at most so often, ...
_REFINEMENTS = 8
#: ... until no friction moves by more than this part.
_SETTLED = 1e-3
#: Steps of Gauss and Newton, and the part of a deviation (of the sum of squares over the variance
#: of one) below which they end, ...
_MOST_STEPS, _CONVERGED = 30, 0.1
#: ... tries of each, ever shorter: the damping of Levenberg and Marquardt, and how it grows.
_MOST_TRIES, _LEAST, _MORE = 8, 1e-3, 10.0
#: Part of a size by which an entry is moved for the slope of the motion by it.
_NUDGE = 1e-6
#: ... and of a sample, by which the delay is.
_LATER = 1e-3
#: Change of a delay, in samples, for the slope of the estimates by it.
_DELAY_STEP = 0.05
#: Weights have settled when none changes by this part; an axis of this little mass has none.
_WEIGHED, _SINGULAR = 0.01, 1e-9
#: Intervals whose mean speed is where the search for the start speed begins.
_FIRST_LOOK = 10
#: Friction of an axis is estimated if least squares find this many deviations of it.
_CLEAR = 3.0
#: Directions this much weaker than the strongest carry nothing but rounding.
_NOTHING = 1e-13
#: Rates searched, per sample, as of one axis: there nothing of a motion is left after one.
_FASTEST = 50.0


class NoMassError(Exception):
    """The mass matrix is not positive definite, so that there is no motion to simulate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointModel:
    """Which unknowns several axes have together."""

    axes: tuple[str, ...]  # names
    coulomb: tuple[bool, ...]  # whether each axis tells friction from a constant force

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Entries of a symmetric matrix, row by row from the diagonal on."""
        return tuple(combinations_with_replacement(range(len(self.axes)), 2))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the unknowns, in the order of every vector and matrix."""
        return entry_names(self.axes) + self.by_axis

    @property
    def by_axis(self) -> tuple[str, ...]:
        """Names of friction and offset of each axis."""
        named = tuple(zip(self.axes, self.coulomb, strict=True))
        rough = tuple(f"coulomb_friction_{axis}" for axis, there in named if there)
        return rough + tuple(f"force_offset_{axis}" for axis in self.axes)

    def matrices(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Λ and D from the first of all values."""
        count = len(self.pairs)
        return self._filled(values[:count]), self._filled(values[count : 2 * count])

    def _filled(self, entries: FloatArray) -> FloatArray:
        matrix = np.empty((len(self.axes), len(self.axes)))
        for (row, column), entry in zip(self.pairs, entries.tolist(), strict=True):
            matrix[row, column] = matrix[column, row] = entry
        return matrix

    def friction(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coulomb friction and offset of each axis, zero where it is not estimated."""
        rest = iter(values[2 * len(self.pairs) :].tolist())
        rough = np.array([next(rest) if there else 0.0 for there in self.coulomb])
        return rough, np.array([next(rest) for _ in self.axes])


@dataclass(frozen=True, slots=True, kw_only=True)
class JointEstimate:
    """One method's answer for one log of several axes; SI units."""

    method: JointMethod
    model: JointModel
    delay: float  # s, given or fitted
    delay_deviation: float | None  # s; None if it was given
    values: FloatArray  # shape (p,), in the order of ``model.parameters``
    covariance: FloatArray  # shape (p, p)
    degrees_of_freedom: float
    residuals: tuple[FloatArray, ...]  # of each axis, N filtered or m
    inflation: FloatArray  # shape (p,), variance inflation factors
    positions: FloatArray | None = None  # simulated, m, shape (axes, n); None of filtered methods

    def value(self, name: str) -> float:
        """One unknown; 0 where the model leaves it out."""
        names = self.model.parameters
        return float(self.values[names.index(name)]) if name in names else 0.0

    def deviation(self, name: str) -> float:
        """Its standard deviation; 0 where the model leaves it out."""
        names = self.model.parameters
        if name not in names:
            return 0.0
        index = names.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    @property
    def matrices(self) -> tuple[FloatArray, FloatArray]:
        """Λ, kg (kg·m²), and D, N·s/m (N·m·s/rad)."""
        return self.model.matrices(self.values)


@dataclass(frozen=True, kw_only=True)
class JointLog:
    """The regressions of all axes at one filter, with directions that the joint model refines."""

    log: Trajectories
    model: JointModel
    tables: tuple[Regression, ...]
    delay: float  # s
    doubt: float  # standard deviation of a delay that is not fitted, s
    speeds: tuple[FloatArray, ...]  # mean speed of each interval, m/s, shape (n - 1,) an axis
    bends: tuple[FloatArray, ...]  # mean acceleration, m/s², likewise
    made: dict[JointMethod, JointEstimate] = field(default_factory=dict[Any, Any])

    @classmethod
    def of(cls, log: Trajectories, delay: float, room: float, doubt: float = 0.0) -> JointLog:
        """Prepared at a delay, s, which may become as long as ``room``, and its deviation."""
        models = [distinguishable_terms(each) for each in log.axes]
        found = [
            prepare(each, model, room, refine=False)
            for each, model in zip(log.axes, models, strict=True)
        ]
        cut_off = min(each.cut_off.frequency for each in found)
        model = JointModel(axes=log.names, coulomb=tuple(each.coulomb for each in models))
        tables = tuple(each.at_cut_off(cut_off) for each in found)
        low_pass, step = tables[0].low_pass, tables[0].signals.step
        speeds = tuple(low_pass.continued(each.signals.speed) for each in tables)
        bends = tuple(np.gradient(each) / step for each in speeds)
        return (
            cls(
                log=log,
                model=model,
                tables=tables,
                delay=delay,
                doubt=doubt,
                speeds=speeds,
                bends=bends,
            )
            ._refined()
            ._with_clear_friction()
        )

    @property
    def count(self) -> int:
        """Number of axes."""
        return len(self.tables)

    @property
    def steps(self) -> float | FloatArray:
        """Length of the intervals, s."""
        return self.tables[0].signals.steps

    def _refined(self) -> JointLog:
        """Directions and standstill with the help of the model that least squares find."""
        prepared, before = self, np.full(self.count, np.inf)
        for _ in range(_REFINEMENTS):
            values = prepared.solve()
            friction, _ = self.model.friction(values)
            if np.all(np.abs(friction - before) <= _SETTLED * np.abs(friction)):
                break
            before, prepared = friction, prepared.turned(values)
        return prepared

    def _with_clear_friction(self) -> JointLog:
        """Without the friction of axes of which it is nothing but noise."""
        found = self.fit("least-squares")
        named = [f"coulomb_friction_{axis}" for axis in self.log.names]
        kept = tuple(found.value(each) > _CLEAR * found.deviation(each) for each in named)
        if kept == self.model.coulomb:
            return self
        tables = tuple(
            table.with_model(replace(table.model, coulomb=there))
            for table, there in zip(self.tables, kept, strict=True)
        )
        return replace(self, model=replace(self.model, coulomb=kept), tables=tables, made={})

    def at_cut_off(self, frequency: float) -> JointLog:
        """At another cut-off of the filter, Hz, the directions of motion as they are."""
        tables = tuple(each.at_cut_off(frequency) for each in self.tables)
        return replace(self, tables=tables, made={})

    def turned(self, values: FloatArray) -> JointLog:
        """With the directions of motion and standstills that some unknowns make of the speeds."""
        mass, _ = self.model.matrices(values)
        friction, offset = self.model.friction(values)
        tables: list[Regression] = []
        for axis, table in enumerate(self.tables):
            if self.model.coulomb[axis] and friction[axis] > 0 and mass[axis, axis] > 0:
                pull = table.held_force(self.delay).mean() - offset[axis]
                motion = refine_motion(
                    table.motion,
                    self.speeds[axis],
                    pull - self.beside(axis, *self.model.matrices(values)),
                    steps=self.steps,
                    low_pass=table.low_pass,
                    mass=float(mass[axis, axis]),
                    damping=float(self.model.matrices(values)[1][axis, axis]),
                    friction=float(friction[axis]),
                )
                tables.append(table.with_motion(motion))
            else:  # without friction nothing holds it still
                tables.append(table.with_motion(table.motion.released()))
        return replace(self, tables=tuple(tables), made={})

    def _moving_as(self, positions: FloatArray) -> JointLog:
        """With mean speeds and accelerations of other positions, m, shape (axes, n)."""
        speeds = tuple(np.diff(positions) / self.steps)
        step = self.tables[0].signals.step
        return replace(
            self, speeds=speeds, bends=tuple(np.gradient(each) / step for each in speeds)
        )

    def beside(self, axis: int, mass: FloatArray, damping: FloatArray) -> FloatArray:
        """Mean force of an axis that moves the others, N, shape (n - 1,)."""
        moved = np.zeros_like(self.speeds[axis])
        for other in range(self.count):
            if other != axis:
                moved += mass[axis, other] * self.bends[other]
                moved += damping[axis, other] * self.speeds[other]
        return moved

    def alone(self, estimate: JointEstimate) -> Trajectories:
        """The logs that each axis would have had alone: its force less what moves the others."""
        mass, damping = estimate.matrices
        moving = self if estimate.positions is None else self._moving_as(estimate.positions)
        axes: list[Trajectory] = []
        for axis, log in enumerate(self.log.axes):
            steps = np.broadcast_to(self.steps, (len(log) - 1,))
            middle = log.time[:-1] + steps / 2
            moved = moving.beside(axis, mass, damping)
            # A force that acts at a time was sent a delay before.
            sent = np.interp(log.time + float(np.mean(steps)) / 2 + estimate.delay, middle, moved)
            axes.append(replace(log, force=log.force - sent))
        return replace(self.log, axes=tuple(axes))

    def solve(self) -> FloatArray:
        """Unknowns by filtered least squares less what noise adds to the squares of columns."""
        rows = _Rows.of(self)
        squares = rows.columns @ rows.columns.T - np.diag(rows.parasitic)
        return _solved(squares, rows.columns @ rows.target)

    def later(self, estimate: JointEstimate) -> JointLog:
        """With the delay of an estimate that fitted it."""
        return replace(self, delay=estimate.delay, doubt=estimate.delay_deviation or 0.0, made={})

    def fit(self, method: JointMethod, *, fits_delay: bool = False) -> JointEstimate:
        """The estimate of one method, made at most once."""
        if method not in self.made:
            make = {"output-error": _output_error}.get(method)
            found = _filtered(self, method) if make is None else make(self, fits_delay=fits_delay)
            if self.doubt and found.delay_deviation is None:
                # A delay of d looks like an added damping of -Λ·ω²·d.
                step = _DELAY_STEP * self.tables[0].signals.step
                ends = [
                    replace(self, delay=each).solve() for each in (self.delay, self.delay + step)
                ]
                slope = (ends[1] - ends[0]) / step
                added = self.doubt**2 * np.outer(slope, slope)
                found = replace(found, covariance=found.covariance + added)
            self.made[method] = found
        return self.made[method]


def _solved(squares: FloatArray, right: FloatArray) -> FloatArray:
    norms = np.sqrt(np.maximum(np.diag(squares), np.finfo(float).tiny))
    return np.linalg.lstsq(squares / np.outer(norms, norms), right / norms)[0] / norms


@dataclass(frozen=True, slots=True)
class _Rows:
    """Filtered rows of all axes, each over what its axis leaves, one time after another."""

    columns: FloatArray  # shape (p, rows), rows of all axes at one time beside each other
    target: FloatArray  # filtered force, shape (rows,)
    parasitic: FloatArray  # what noise of readings adds to the square of each column, shape (p,)
    scale: FloatArray  # what each axis was divided by, N

    @classmethod
    def of(cls, prepared: JointLog, positions: Sequence[FloatArray] | None = None) -> _Rows:
        """Columns of the measured motion, or of other positions, shape (n,) an axis."""
        tables, model = prepared.tables, prepared.model
        count, pairs = prepared.count, model.pairs
        names, rows = model.parameters, tables[0].columns.shape[1]
        if positions is None:
            motions = [table.signals.kinematics for table in tables]
        else:
            motions = [kinematics_of(each - np.mean(each), prepared.steps) for each in positions]
        columns = np.zeros((len(names), rows, count))
        parasitic = np.zeros((len(names), count))
        target = np.empty((rows, count))
        for axis, table in enumerate(tables):
            moving = HeldColumn.constant(table.motion.moving, prepared.steps)
            there = of_rows(moving.triangle())
            gains = table.low_pass.noise_gains(table.signals.step)
            for place, (row, column) in enumerate(pairs):
                if axis not in {row, column}:
                    continue
                other = column if axis == row else row
                seen = motions[other] if other == axis else motions[other] * there
                filtered = table.low_pass(seen)[:, table.known :]
                for kind, gain in enumerate(gains):
                    at = place + kind * len(pairs)
                    columns[at, :, axis] = filtered[kind]
                    parasitic[at, axis] = rows * gain * tables[other].signals.noise ** 2
            rough = f"coulomb_friction_{model.axes[axis]}"
            if rough in names:
                columns[names.index(rough), :, axis] = table.filtered(table.motion.direction)
            columns[names.index(f"force_offset_{model.axes[axis]}"), :, axis] = table.filtered(
                moving
            )
            target[:, axis] = table.force(prepared.delay)
        scale = _rest(columns, target)
        columns, parasitic = columns / scale, parasitic / scale**2
        return cls(
            columns.reshape(len(names), -1),
            (target / scale).ravel(),
            parasitic.sum(axis=1),
            scale,
        )


def _rest(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Rms of what each axis by itself leaves of its force, shape (axes,)."""
    left = np.empty(target.shape[1])
    for axis in range(target.shape[1]):
        own = columns[:, :, axis]
        used = own[np.any(own != 0, axis=1)]
        values = _solved(used @ used.T, used @ target[:, axis])
        left[axis] = np.sqrt(np.mean((target[:, axis] - values @ used) ** 2))
    return np.maximum(left, np.finfo(float).eps * np.sqrt(np.mean(target**2, axis=0)))


def _filtered(prepared: JointLog, method: JointMethod) -> JointEstimate:
    """Least squares, or the rows tested against columns that are free of the log's own noise.

    What half and twice the cut-off move is one more standard deviation, as of one axis.
    """
    rows = _Rows.of(prepared)
    positions = _noise_free(prepared) if method == "instruments" else None
    tests = None if positions is None else _Rows.of(prepared, positions).columns

    def solved(log: JointLog) -> FloatArray:
        if positions is None:
            return log.solve()
        found = _Rows.of(log)
        return _tested(_Rows.of(log, positions).columns, found.columns, found.target)

    values, middle = solved(prepared), prepared.tables[0].cut_off.frequency
    low, high = (
        solved(prepared.at_cut_off(middle * factor))
        for factor in (1 / CUT_OFF_RANGE, CUT_OFF_RANGE)
    )
    residual = rows.target - values @ rows.columns
    tests = rows.columns if tests is None else tests
    around = spread(rows.columns, residual, len(values), signal=rows.target, instruments=tests)
    shift = (high - low) / 2
    around = replace(around, covariance=around.covariance + np.outer(shift, shift))
    by_axis = residual.reshape(-1, prepared.count) * rows.scale
    return _estimate(prepared, method, values, around, tuple(by_axis.T))


def _tested(tests: FloatArray, columns: FloatArray, target: FloatArray) -> FloatArray:
    """Unknowns whose residual no instrument sees."""
    sizes, norms = (np.sqrt(np.sum(each**2, axis=1)) for each in (tests, columns))
    normal: FloatArray = (tests / sizes[:, None]) @ (columns / norms[:, None]).T
    right: FloatArray = tests @ target / sizes
    found: FloatArray = np.linalg.lstsq(normal, right)[0] / norms
    return found


def _noise_free(prepared: JointLog) -> list[FloatArray]:
    """Positions that references explain, or, in open loop, those that the forces make."""
    explained = [explained_by_reference(table) for table in prepared.tables]
    if all(each is not None for each in explained):
        return [each for each in explained if each is not None]
    play = _Playing.of(prepared, fits_delay=False)
    theta = play.start()
    if not play.allowed(theta):
        raise NoMassError
    found = play.positions(theta[None])[0]
    return list(np.concatenate((play.measured[: play.first], found)).T)


@dataclass(frozen=True, kw_only=True)
class _Playing:
    """The motion of a log as a function of all unknowns, the delay and the starts."""

    prepared: JointLog
    fits_delay: bool
    force: FloatArray  # N, shape (n, axes)
    measured: FloatArray  # m, likewise
    first: int  # sample from which on every force is known

    @classmethod
    def of(cls, prepared: JointLog, *, fits_delay: bool) -> _Playing:
        """From what a prepared log holds; its steps are even."""
        axes = prepared.log.axes
        return cls(
            prepared=prepared,
            fits_delay=fits_delay,
            force=np.stack([each.force for each in axes], axis=1),
            measured=np.stack([each.position for each in axes], axis=1),
            first=prepared.tables[0].known,
        )

    def start(self) -> FloatArray:
        """Unknowns by least squares, then the delay if it is fitted, start speeds and places."""
        prepared, first = self.prepared, self.first
        values = prepared.solve()
        named = len(prepared.model.pairs) * 2
        rough = slice(named, named + sum(prepared.model.coulomb))
        values[rough] = np.maximum(values[rough], self._sizes()[rough])
        late = [prepared.delay] * self.fits_delay
        return np.concatenate((values, late, self.starts()[0], self.measured[first]))

    def _sizes(self) -> FloatArray:
        """How far each unknown is moved for the slope of the motion by it."""
        prepared, model = self.prepared, self.prepared.model
        step = prepared.tables[0].signals.step
        force = np.sqrt(np.mean(self.force**2, axis=0))
        speed = np.array([np.sqrt(np.mean(each**2)) for each in prepared.speeds])
        bend = np.array([np.sqrt(np.mean(each**2)) for each in prepared.bends])
        ratios = [force / np.maximum(each, np.finfo(float).tiny) for each in (bend, speed)]
        entries = [np.sqrt(each[i] * each[j]) for each in ratios for i, j in model.pairs]
        rough = force[[*np.flatnonzero(model.coulomb)]]
        return np.concatenate(
            (
                _NUDGE * np.concatenate((entries, rough, force)),
                [_LATER * step] * self.fits_delay,
                _NUDGE * speed,
                _NUDGE * np.ptp(self.measured, axis=0),
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
        step = self.prepared.tables[0].signals.step
        rates = np.linalg.eigvals(np.linalg.solve(mass, damping)).real
        if np.max(np.abs(rates)) * step > _FASTEST:
            return False
        return unknown_intervals(self.prepared.steps, self._delay(theta)) <= self.first

    def within(self, theta: FloatArray) -> FloatArray:
        """With a delay that is fitted not below zero."""
        if self.fits_delay:
            at = len(self.prepared.model.parameters)
            theta = np.concatenate((theta[:at], [max(theta[at], 0.0)], theta[at + 1 :]))
        return theta

    def _delay(self, theta: FloatArray) -> float:
        at = len(self.prepared.model.parameters)
        return float(theta[at]) if self.fits_delay else self.prepared.delay

    def positions(self, thetas: FloatArray) -> FloatArray:
        """Positions from the first known sample on, m, shape (thetas, rows, axes)."""
        model, count = self.prepared.model, self.prepared.count
        matrices = [model.matrices(each) for each in thetas]
        by_axis = [model.friction(each) for each in thetas]
        devices = DevicesOfAxes(
            mass=np.stack([mass for mass, _ in matrices]),
            damping=np.stack([damping for _, damping in matrices]),
            friction=np.stack([friction for friction, _ in by_axis]),
            offset=np.stack([offset for _, offset in by_axis]),
            delay=np.array([self._delay(each) for each in thetas]),
            speed=thetas[:, -2 * count : -count],
            place=thetas[:, -count:],
        )
        step = self.prepared.tables[0].signals.step
        with np.errstate(over="ignore", invalid="ignore"):
            found = devices.positions(self.force, step, self.first)[self.first :]
        return np.moveaxis(found, 1, 0)

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions, shape (rows, axes), and their slopes by every unknown, (k, rows, axes)."""
        sizes = self._sizes()
        found = self.positions(np.vstack((theta, theta + np.diag(sizes))))
        return found[0], (found[1:] - found[0]) / sizes[:, None, None]

    def starts(self) -> tuple[FloatArray, FloatArray]:
        """Start speeds as the first positions show them, m/s, and how well they are known.

        Friction stops a slow start at once, so that the motion after it does not tell its speed.
        """
        first, tables = self.first, self.prepared.tables
        looked = slice(first, first + _FIRST_LOOK)
        speeds = np.array([float(np.mean(each[looked])) for each in self.prepared.speeds])
        bends = np.array([float(np.sqrt(np.mean(each**2))) for each in self.prepared.bends])
        step = tables[0].signals.step
        noise = np.array([table.signals.noise for table in tables])
        return speeds, noise / (_FIRST_LOOK * step) + bends * _FIRST_LOOK * step

    def weighed(
        self, theta: FloatArray, positions: FloatArray, slopes: FloatArray, scale: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What is left over its scale, shape (rows,), and its slopes, (k, rows).

        Rows of all axes at one time lie beside each other; start speeds as seen come last.
        """
        count = self.prepared.count
        seen, deviation = self.starts()
        left = (self.left(positions) / scale).ravel()
        beside = (seen - theta[-2 * count : -count]) / deviation
        columns = np.zeros((len(theta), left.size + count))
        columns[:, : left.size] = (slopes / scale).reshape(len(theta), -1)
        columns[-2 * count : -count, left.size :] = np.diag(1 / deviation)
        return np.append(left, beside), columns

    def scale(self, positions: FloatArray) -> FloatArray:
        """Rms of what is left of each axis, m, shape (axes,)."""
        rest = np.sqrt(np.mean(self.left(positions) ** 2, axis=0))
        return np.maximum(rest, np.finfo(float).eps * np.ptp(self.measured, axis=0))

    def left(self, positions: FloatArray) -> FloatArray:
        """What is measured less some positions, m, shape (rows, axes)."""
        return self.measured[self.first :] - positions


def _output_error(prepared: JointLog, *, fits_delay: bool) -> JointEstimate:
    """The unknowns whose exact motion comes nearest to the measured one.

    Each axis is weighed by what is left of it; turns and rests are those of the motion itself.
    """
    play = _Playing.of(prepared, fits_delay=fits_delay)
    theta = play.start()
    if not play.allowed(theta):
        raise NoMassError
    scale, damped, improved = np.ones(prepared.count), 0.0, np.inf
    positions, slopes = play.slopes(theta)
    for _ in range(_MOST_STEPS):
        before, scale = scale, play.scale(positions)
        settled = bool(np.all(np.abs(scale / before - 1) < _WEIGHED))
        residual, columns = play.weighed(theta, positions, slopes, scale)
        move, gain = gauss_newton(columns, residual, _NOTHING)
        if settled and min(gain, improved) <= _CONVERGED**2:
            break
        size = np.linalg.norm(columns, axis=1)
        for _ in range(_MOST_TRIES):
            if damped:  # Levenberg and Marquardt: shorter, and down the steepest slope
                more = np.hstack((columns, np.sqrt(damped) * np.diag(size)))
                move, _ = gauss_newton(more, np.append(residual, np.zeros(len(size))), _NOTHING)
            trial = play.within(theta + move)
            if play.allowed(trial):
                found = play.slopes(trial)
                better, _ = play.weighed(trial, *found, scale)
                improved = float(residual @ residual - better @ better)
                if improved > 0:
                    theta, (positions, slopes) = trial, found
                    break
            damped = max(_MORE * damped, _LEAST)
        else:
            break
        damped = 0.0 if damped <= _LEAST else damped / _MORE
    residual, columns = play.weighed(theta, positions, slopes, scale)
    count, size = len(prepared.model.pairs), len(prepared.model.parameters)
    signal = np.asarray(theta[:count] @ columns[:count], dtype=np.float64)
    around = spread(columns, residual, size + fits_delay, signal=signal, instruments=columns)
    left = play.left(positions)
    return _estimate(
        replace(prepared, delay=float(theta[size]) if fits_delay else prepared.delay),
        "output-error",
        theta[:size],
        around,
        tuple(left.T),
        fits_delay=fits_delay,
        positions=np.concatenate((play.measured[: play.first], positions)).T,
    )


def _estimate(
    prepared: JointLog,
    method: JointMethod,
    values: FloatArray,
    around: Spread,
    residuals: tuple[FloatArray, ...],
    *,
    fits_delay: bool = False,
    positions: FloatArray | None = None,
) -> JointEstimate:
    size = len(values)
    return JointEstimate(
        method=method,
        model=prepared.model,
        delay=prepared.delay,
        delay_deviation=float(np.sqrt(around.covariance[size, size])) if fits_delay else None,
        values=values,
        covariance=around.covariance[:size, :size],
        degrees_of_freedom=around.degrees_of_freedom,
        residuals=residuals,
        inflation=around.inflation[:size],
        positions=positions,
    )
