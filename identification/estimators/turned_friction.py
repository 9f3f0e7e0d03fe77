"""Coulomb friction of several axes along directions that are no axis, as of joints and motors.

The filtered rows take friction along one direction after another, each that which explains most of
what is left, as long as it is told from nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from identification.estimators.joint import JointLog, Rows
from identification.estimators.joint_fits import JointEstimate, fit_jointly
from identification.trajectory import FloatArray

#: Deviations from nothing of a friction that is told, ...
_CLEAR = 4.0
#: ... all of which together leave this part of what was left at most, rms.
_MUCH_LEFT = 0.95
#: Directions for each axis at most.
_MOST = 2
#: Directions looked at lie so far apart in the plane of each two axes, degrees; from the best of
#: them on, steps of this length, then of half of it, until they are so short.
_APART, _FIRST, _FINEST = 15, 0.1, 0.01
#: Of a column at least this part is told from those known; less is rounding.
_NEWS = 1e-3
#: Times looked at, evenly spaced; more add time, not truth.
_TIMES = 1 << 14


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnedFriction:
    """Friction along directions that are no axis, and what logs say with it."""

    prepared: JointLog  # with the directions
    before: JointEstimate  # without them
    estimate: JointEstimate  # with them; what it leaves over widens it
    left: float  # rms of what is left over, as part of what was

    @property
    def strongest(self) -> tuple[tuple[float, ...], float]:
        """The direction, a unit vector, motion along which meets most friction, and that, N."""
        directions = np.array(self.prepared.model.directions)
        met = np.abs(directions @ directions.T) @ self.estimate.values[-len(directions) :]
        return tuple(directions[np.argmax(met)].tolist()), float(np.max(met))


def turned_friction(prepared: JointLog, before: JointEstimate) -> TurnedFriction | None:
    """Friction that moves an entry of Λ or D by more than its deviation; None without it."""
    method = "least-squares" if before.method == "output-error" else before.method
    first = rest = _Rest.of(prepared)
    found = before
    for _ in range(_MOST * prepared.count):
        tried = rest.prepared.along((*rest.prepared.model.directions, rest.direction()))
        estimate = fit_jointly(tried, method)
        value, deviation = estimate.told(tried.model.parameters[-1])
        if value <= _CLEAR * deviation:
            break
        rest, found = _Rest.of(tried), estimate
    shift = np.zeros(len(found.values))
    entries = slice(0, 2 * len(prepared.model.pairs))
    shift[entries] = found.values[entries] - before.values[entries]
    harmless = bool(np.all(shift[entries] ** 2 <= np.diag(before.covariance)[entries]))
    if harmless or rest.size > _MUCH_LEFT * first.size:
        return None
    left = rest.size / first.size
    widened = found.covariance + left**2 * np.outer(shift, shift)
    found = replace(found, covariance=widened)
    return TurnedFriction(prepared=rest.prepared, before=before, estimate=found, left=left)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rest:
    """What filtered rows leave over."""

    prepared: JointLog
    known: FloatArray  # orthonormal columns of some times, shape (rows, p)
    left: FloatArray  # what they leave of the force, shape (rows,)
    scale: FloatArray  # what each axis was divided by, N

    @classmethod
    def of(cls, prepared: JointLog) -> _Rest:
        rows = Rows.of(prepared)
        known = np.linalg.qr(_thinned(rows.columns, prepared.count).T)[0]
        target = _thinned(rows.target, prepared.count)
        left = target - known @ (known.T @ target)
        return cls(prepared=prepared, known=known, left=left, scale=rows.scale)

    @property
    def size(self) -> float:
        """Its norm, N."""
        return float(np.linalg.norm(self.left.reshape(-1, self.scale.size) * self.scale))

    def direction(self) -> tuple[float, ...]:
        """The unit vector along which friction explains most of it."""
        units = np.eye(self.scale.size)
        turns = np.radians(np.arange(0, 180, _APART))
        tried = [
            np.cos(turn) * one + np.sin(turn) * other
            for one, other in combinations(units, 2)
            for turn in turns
        ]
        best, most, step = units[0], -np.inf, _FIRST
        while step > _FINEST:
            tried = [each / np.linalg.norm(each) for each in tried]
            explained = [self._explained(each) for each in tried]
            if max(explained) > most:
                best, most = tried[int(np.argmax(explained))], max(explained)
            else:
                step /= 2
            tried = [best + step * each for each in (*units, *-units)]
        return tuple(best.tolist())

    def _explained(self, direction: FloatArray) -> float:
        """What friction along a direction explains; less than nothing if it would push."""
        rubbed = [part.rubbed(direction) for part in self.prepared.parts]
        column = _thinned((np.concatenate(rubbed) / self.scale).ravel(), self.scale.size)
        news = column - self.known @ (self.known.T @ column)
        size = max(np.linalg.norm(news), _NEWS * np.linalg.norm(column), np.finfo(float).tiny)
        return float(news @ self.left / size)


def _thinned(columns: FloatArray, axes: int) -> FloatArray:
    """Columns of shape (..., rows) at some times only."""
    by_time = columns.reshape(*columns.shape[:-1], -1, axes)
    every = 1 + by_time.shape[-2] // _TIMES
    return by_time[..., ::every, :].reshape(*columns.shape[:-1], -1)
