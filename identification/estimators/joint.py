"""Several axes as one regression: what is unknown of them together, and the filtered rows of all.

Λ·q̈ + D·q̇ + Fc∘sign(q̇) + f0 = F(t - delay), Λ and D symmetric. The filtered rows of every axis are
those of one axis, with the accelerations and velocities of the others beside its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from identification.estimators.estimate import solve
from identification.estimators.least_squares import Regression, prepare
from identification.estimators.motion import distinguishable_terms, refine_motion, sense_of
from identification.estimators.signals import HeldColumn, kinematics_of, of_rows
from identification.trajectory import FloatArray, Trajectories, Trajectory

#: Positions that vary by this many deviations of their noise at most are of an axis that stands.
_NOISE = 2.0
#: Directions of motion are refined by the fitted model at most so often, ...
_REFINEMENTS = 8
#: ... until no friction moves by more than this part.
_SETTLED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class JointModel:
    """Which unknowns several axes have together."""

    axes: tuple[str, ...]  # names
    coulomb: tuple[bool, ...]  # whether each axis tells friction from a constant force
    directions: tuple[tuple[float, ...], ...] = ()  # of friction that acts along no axis, units

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Entries of a symmetric matrix, row by row from the diagonal on."""
        return tuple(combinations_with_replacement(range(len(self.axes)), 2))

    @property
    def across(self) -> tuple[int, ...]:
        """Places of the pairs of two axes among all pairs."""
        return tuple(place for place, (one, other) in enumerate(self.pairs) if one != other)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the unknowns, in the order of every vector and matrix: mass_x_x, mass_x_y ..."""
        pairs = tuple(combinations_with_replacement(self.axes, 2))
        named = zip(self.axes, self.coulomb, strict=True)
        return (
            *(f"{name}_{one}_{other}" for name in ("mass", "damping") for one, other in pairs),
            *(f"coulomb_friction_{axis}" for axis, there in named if there),
            *(f"force_offset_{axis}" for axis in self.axes),
            *(f"coulomb_friction_along_{each}" for each in self.directions),
        )

    def matrices(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Λ and D from the first of all values."""
        both = np.empty((2, len(self.axes), len(self.axes)))
        one, other = np.array(self.pairs).T
        both[:, one, other] = both[:, other, one] = values[: 2 * one.size].reshape(2, -1)
        return both[0], both[1]

    def friction(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coulomb friction and offset of each axis that moves alone, zero where not estimated."""
        rest = iter(values[2 * len(self.pairs) :].tolist())
        rough = np.array([next(rest) if there else 0.0 for there in self.coulomb])
        offset = np.array([next(rest) for _ in self.axes])
        for direction, friction in zip(self.directions, rest, strict=False):
            rough += friction * np.abs(direction)
        return rough, offset


@dataclass(frozen=True, kw_only=True)
class JointPart:
    """One log among those of a pose: the regressions of all axes at one filter."""

    log: Trajectories
    tables: tuple[Regression, ...]
    speeds: tuple[FloatArray, ...]  # mean speed of each interval, m/s, shape (n - 1,) an axis

    @cached_property
    def stands(self) -> tuple[bool, ...]:
        """Whether an axis does not move beyond its noise: friction, a brake or a servo holds it."""
        return tuple(
            float(np.std(axis.position)) <= _NOISE * table.signals.noise
            for axis, table in zip(self.log.axes, self.tables, strict=True)
        )

    @property
    def steps(self) -> float | FloatArray:
        """Length of the intervals, s."""
        return self.tables[0].signals.steps

    @cached_property
    def bends(self) -> tuple[FloatArray, ...]:
        """Mean acceleration of each interval, m/s², shape (n - 1,) an axis."""
        return tuple(np.gradient(each) / self.tables[0].signals.step for each in self.speeds)

    def rubbed(self, direction: FloatArray) -> FloatArray:
        """Filtered rows of a friction of 1 N along a direction, shape (rows, axes)."""
        sense = sense_of(direction @ np.stack(self.speeds), self.steps)
        columns = [table.filtered(sense.times(table.motion.moving)) for table in self.tables]
        return np.stack(columns, axis=1) * direction

    def filtered(self, forces: Sequence[FloatArray]) -> FloatArray:
        """Filtered rows of the forces of all axes in each interval, shape (rows, axes)."""
        columns = [
            table.filtered(HeldColumn.constant(force * table.motion.moving, self.steps))
            for table, force in zip(self.tables, forces, strict=True)
        ]
        return np.stack(columns, axis=1)

    def held(self) -> JointPart:
        """With standstill of the axes that stand, whatever the forces."""
        tables = (
            table.with_motion(table.motion.held()) if stands else table
            for table, stands in zip(self.tables, self.stands, strict=True)
        )
        return replace(self, tables=tuple(tables))

    def turned(self, model: JointModel, values: FloatArray, delay: float) -> JointPart:
        """With the directions of motion and standstills that some unknowns make of the speeds."""
        mass, damping = model.matrices(values)
        friction, offset = model.friction(values)
        tables: list[Regression] = []
        for axis, table in enumerate(self.tables):
            if self.stands[axis]:
                tables.append(table)
            elif model.coulomb[axis] and friction[axis] > 0 and mass[axis, axis] > 0:
                pull = table.held_force(delay).mean() - offset[axis]
                motion = refine_motion(
                    table.motion,
                    self.speeds[axis],
                    pull - self.beside(axis, mass, damping),
                    steps=self.steps,
                    low_pass=table.low_pass,
                    mass=float(mass[axis, axis]),
                    damping=float(damping[axis, axis]),
                    friction=float(friction[axis]),
                )
                tables.append(table.with_motion(motion))
            else:  # without friction nothing holds it still
                tables.append(table.with_motion(table.motion.released()))
        return replace(self, tables=tuple(tables))

    def beside(self, axis: int, mass: FloatArray, damping: FloatArray) -> FloatArray:
        """Mean force of an axis that moves the others, N, shape (n - 1,)."""
        moved = np.zeros_like(self.speeds[axis])
        for other in range(len(self.tables)):
            if other != axis:
                moved += mass[axis, other] * self.bends[other]
                moved += damping[axis, other] * self.speeds[other]
        return moved

    def alone(
        self,
        axis: int,
        matrices: tuple[FloatArray, FloatArray],
        delay: float,
        positions: FloatArray | None,
    ) -> Trajectory:
        """The log that an axis would have had alone: its force less what moves the others."""
        mass, damping = matrices
        moving = self
        if positions is not None:
            moving = replace(self, speeds=tuple(np.diff(positions) / self.steps))
        log = self.log.axes[axis]
        steps = np.broadcast_to(self.steps, (len(log) - 1,))
        middle = log.time[:-1] + steps / 2
        moved = moving.beside(axis, mass, damping)
        # A force that acts at a time was sent a delay before.
        sent = np.interp(log.time + self.tables[0].signals.step / 2 + delay, middle, moved)
        return replace(log, force=log.force - sent)


@dataclass(frozen=True, kw_only=True)
class JointLog:
    """The regressions of all logs of a pose, with directions that the joint model refines."""

    parts: tuple[JointPart, ...]
    model: JointModel
    delay: float  # s
    doubt: float  # standard deviation of a delay that is not fitted, s

    @classmethod
    def of(cls, logs: Sequence[Trajectories], delay: float, room: float, doubt: float) -> JointLog:
        """Prepared at a delay, s, which may become as long as ``room``, and its deviation."""
        first = logs[0]
        driven = [(place, axis) for axis, place in enumerate(driving_logs(logs))]
        by_log = [[distinguishable_terms(each) for each in log.axes] for log in logs]
        models = [by_log[place][axis] for place, axis in driven]
        found = [
            [
                prepare(each, model, room, refine=False)
                for each, model in zip(log.axes, models, strict=True)
            ]
            for log in logs
        ]
        cut_off = min(found[place][axis].cut_off.frequency for place, axis in driven)
        parts: list[JointPart] = []
        for log, each in zip(logs, found, strict=True):
            tables = tuple(table.at_cut_off(cut_off) for table in each)
            low_pass = tables[0].low_pass
            speeds = tuple(low_pass.continued(table.signals.speed) for table in tables)
            parts.append(JointPart(log=log, tables=tables, speeds=speeds).held())
        model = JointModel(axes=first.names, coulomb=tuple(each.coulomb for each in models))
        prepared = cls(parts=tuple(parts), model=model, delay=delay, doubt=doubt)
        return prepared._refined()

    @property
    def apart(self) -> tuple[str, str] | None:
        """Two axes that never move in one log, so that nothing tells what couples them."""
        for one, other in self.model.pairs:
            if all(part.stands[one] or part.stands[other] for part in self.parts):
                return self.model.axes[one], self.model.axes[other]
        return None

    @property
    def logs(self) -> tuple[Trajectories, ...]:
        """The logs of the pose."""
        return tuple(part.log for part in self.parts)

    @property
    def count(self) -> int:
        """Number of axes."""
        return len(self.model.axes)

    @property
    def steps(self) -> float | FloatArray:
        """Length of the intervals of the first log, s."""
        return self.parts[0].steps

    @property
    def step(self) -> float:
        """Mean length of the intervals, s."""
        return self.parts[0].tables[0].signals.step

    def _refined(self) -> JointLog:
        """Directions and standstill with the help of the model that least squares find."""
        prepared, before = self, np.full(self.count, np.inf)
        for _ in range(_REFINEMENTS):
            values = prepared.solve()
            friction, _ = self.model.friction(values)
            if np.all(np.abs(friction - before) <= _SETTLED * np.abs(friction)):
                break
            parts = (each.turned(self.model, values, self.delay) for each in prepared.parts)
            before, prepared = friction, replace(prepared, parts=tuple(parts))
        return prepared

    def with_friction(self, there: tuple[bool, ...]) -> JointLog:
        """With the friction of these axes only."""

        def without(part: JointPart) -> JointPart:
            tables = tuple(
                table.with_model(replace(table.model, coulomb=rough))
                for table, rough in zip(part.tables, there, strict=True)
            )
            return replace(part, tables=tables)

        model = replace(self.model, coulomb=there)
        return replace(self, model=model, parts=tuple(map(without, self.parts)))

    def along(self, directions: tuple[tuple[float, ...], ...]) -> JointLog:
        """With further friction along these directions."""
        return replace(self, model=replace(self.model, directions=directions))

    def at_cut_off(self, frequency: float) -> JointLog:
        """At another cut-off of the filter, Hz, the directions of motion as they are."""
        parts = (
            replace(part, tables=tuple(each.at_cut_off(frequency) for each in part.tables))
            for part in self.parts
        )
        return replace(self, parts=tuple(parts))

    def solve(self) -> FloatArray:
        """Unknowns by filtered least squares, shape (p,)."""
        return Rows.of(self).solve()


def driving_logs(logs: Sequence[Trajectories]) -> tuple[int, ...]:
    """Which of the logs of a pose moves each axis most by a force of its own."""
    return tuple(
        int(np.argmax([np.std(log.axes[axis].position) * driven(log.axes[axis]) for log in logs]))
        for axis in range(len(logs[0].axes))
    )


def driven(axis: Trajectory) -> bool:
    """Whether a force moves an axis that is logged beside others."""
    return bool(np.ptp(axis.force) > 0 and np.ptp(axis.position) > 0)


@dataclass(frozen=True, slots=True)
class Rows:
    """Filtered rows of all axes, each over what its axis leaves, one time after another."""

    columns: FloatArray  # shape (p, rows), rows of all axes at one time beside each other
    target: FloatArray  # filtered force, shape (rows,)
    parasitic: FloatArray  # what noise of readings adds to the square of each column, shape (p,)
    scale: FloatArray  # what each axis was divided by, N

    def with_halves(self, model: JointModel) -> Rows:
        """With the antisymmetric parts of both matrices, which a device does not have."""
        pairs, across = model.pairs, model.across
        at = [*across, *(len(pairs) + place for place in across)]
        halves = self.columns[at]
        axis = np.arange(self.target.size) % len(model.axes)
        for place, half in zip(2 * across, halves, strict=True):
            half[axis == pairs[place][1]] *= -1
        parasitic = np.append(self.parasitic, self.parasitic[at])
        return replace(self, columns=np.concatenate((self.columns, halves)), parasitic=parasitic)

    @classmethod
    def of(
        cls, prepared: JointLog, positions: Sequence[Sequence[FloatArray]] | None = None
    ) -> Rows:
        """Columns of the measured motion, or of other positions: of each log (n,) an axis."""
        others = [None] * len(prepared.parts) if positions is None else positions
        found = [
            _rows(part, prepared.model, prepared.delay, each)
            for part, each in zip(prepared.parts, others, strict=True)
        ]
        columns = np.concatenate([each for each, _, _ in found], axis=1)
        target = np.concatenate([each for _, each, _ in found])
        scale = _rest(columns, target)
        columns, parasitic = columns / scale, sum(each for *_, each in found) / scale**2
        return cls(
            columns.reshape(len(columns), -1),
            (target / scale).ravel(),
            np.asarray(parasitic.sum(axis=1), dtype=np.float64),
            scale,
        )

    def solve(self) -> FloatArray:
        """Unknowns by least squares less what noise adds to the squares of columns, shape (p,)."""
        whole = self.columns @ self.columns.T
        squares = whole - np.diag(self.parasitic)
        # A column of nothing but noise, or of nothing, is told by what it leaves unknown.
        sizes = np.where(np.diag(squares) > 0, np.diag(squares), np.diag(whole))
        norms = np.sqrt(np.where(sizes > 0, sizes, 1.0))
        right = self.columns @ self.target / norms
        return np.linalg.lstsq(squares / np.outer(norms, norms), right)[0] / norms


def _rows(
    part: JointPart, model: JointModel, delay: float, positions: Sequence[FloatArray] | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(columns, shape (p, rows, axes); target, (rows, axes); noise of squares, (p, axes))."""
    tables, pairs = part.tables, model.pairs
    count, names, rows = len(tables), model.parameters, tables[0].columns.shape[1]
    if positions is None:
        motions = [table.signals.kinematics for table in tables]
    else:
        motions = [kinematics_of(each - np.mean(each), part.steps) for each in positions]
    columns = np.zeros((len(names), rows, count))
    parasitic = np.zeros((len(names), count))
    target = np.empty((rows, count))
    for axis, table in enumerate(tables):
        moving = HeldColumn.constant(table.motion.moving, part.steps)
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
        columns[names.index(f"force_offset_{model.axes[axis]}"), :, axis] = table.filtered(moving)
        target[:, axis] = table.force(delay)
    for place, direction in enumerate(model.directions, len(names) - len(model.directions)):
        columns[place] = part.rubbed(np.array(direction))
    return columns, target, parasitic


def _rest(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Rms of what each axis by itself leaves of its force, shape (axes,)."""
    left = np.empty(target.shape[1])
    for axis in range(target.shape[1]):
        own = columns[:, :, axis]
        used = own[np.any(own != 0, axis=1)]
        values = solve(used.T, target[:, axis])
        left[axis] = np.sqrt(np.mean((target[:, axis] - values @ used) ** 2))
    return np.maximum(left, np.finfo(float).eps * np.sqrt(np.mean(target**2, axis=0)))
