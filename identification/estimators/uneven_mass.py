"""Mass of several axes that depends on their positions, as of an arm.

Each entry of Λ takes every product of one or two positions; Lagrange's equations give its forces.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from identification.estimators.joint import JointLog, JointPart, Rows
from identification.trajectory import FloatArray

#: Of what a constant Λ leaves over, mean square, one that depends on position leaves so much.
_LEFT = 0.4


def uneven_mass(prepared: JointLog) -> FloatArray | None:
    """Least and largest mass of each axis over the motion, (2, axes); None if Λ is constant."""
    rows, count = Rows.of(prepared), prepared.count
    places = [_places(part) for part in prepared.parts]
    found = [_further(part, place) for part, place in zip(prepared.parts, places, strict=True)]
    further = np.concatenate(found, axis=1) / rows.scale
    columns = np.vstack((rows.columns, further.reshape(len(further), -1)))
    values = np.linalg.lstsq(columns.T, rows.target)[0]
    plain = np.linalg.lstsq(rows.columns.T, rows.target)[0]
    left, before = (
        float(np.mean((rows.target - weights @ columns[: len(weights)]) ** 2))
        for weights in (values, plain)
    )
    if left > _LEFT * before:
        return None
    shapes = np.stack([np.prod(np.hstack(places)[list(at)], axis=0) for at in _shapes(count)])
    pairs = prepared.model.pairs
    added = values[len(rows.columns) :].reshape(len(shapes), len(pairs)).T @ shapes
    own = [pairs.index((axis, axis)) for axis in range(count)]
    masses = values[own, None] + added[own]
    return np.stack((masses.min(axis=1), masses.max(axis=1)))


def _shapes(count: int) -> list[tuple[int, ...]]:
    """Axes whose positions are multiplied."""
    powers = (1, 2)
    return [at for power in powers for at in combinations_with_replacement(range(count), power)]


def _places(part: JointPart) -> FloatArray:
    """Position in each interval, m, less its mean, shape (axes, n - 1)."""
    return np.stack(
        [
            (log.position[1:] + log.position[:-1]) / 2 - np.mean(log.position)
            for log in part.log.axes
        ]
    )


def _further(part: JointPart, place: FloatArray) -> FloatArray:
    """Filtered forces of each shape in each entry, shape (shapes * pairs, rows, axes)."""
    axes, found = range(len(place)), list[FloatArray]()
    for at in _shapes(len(place)):
        shape = np.prod(place[list(at)], axis=0)
        slopes = [
            sum(
                (
                    np.prod(place[[*at[:k], *at[k + 1 :]]], axis=0)
                    for k in range(len(at))
                    if at[k] == axis
                ),
                np.zeros_like(shape),
            )
            for axis in axes
        ]
        turned = sum(slope * speed for slope, speed in zip(slopes, part.speeds, strict=True))
        for one, other in combinations_with_replacement(axes, 2):
            kinetic = part.speeds[one] * part.speeds[other] * (0.5 if one == other else 1.0)
            forces = [-slope * kinetic for slope in slopes]
            for axis, beside in {(one, other), (other, one)}:
                forces[axis] = (
                    forces[axis] + shape * part.bends[beside] + turned * part.speeds[beside]
                )
            found.append(part.filtered(forces))
    return np.stack(found)
