"""The columns of the force terms beside mass and damping, as they act between samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.model import Model
from identification.estimators.motion import Motion
from identification.estimators.zero_order_hold import HeldColumn

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """Columns in the order of ``model.parameters[2:]``, zero where the device stands.

    Attributes:
        columns: force per unit of parameter, n - 1 intervals each.
        mean_speed: s of the model, m/s; 0 where friction does not differ by direction.
    """

    columns: tuple[HeldColumn, ...]
    mean_speed: float


def terms(model: Model, motion: Motion, position: FloatArray, steps: float | FloatArray) -> Terms:
    """Columns of a model on one log.

    Terms that depend on speed or position are taken as their mean over each interval: what they
    change inside of it moves the device by a part (ωT)²/12 of their own effect.

    Args:
        model: which columns.
        motion: direction and standstill.
        position: m, shape (n,).
        steps: of the log, s: one number, or shape (n - 1,).
    """
    moving = motion.moving
    columns = [motion.direction] if model.coulomb else []
    columns += [HeldColumn.constant(moving, steps)] if model.offset else []
    mean_speed = 0.0
    if model.directional:
        speed = motion.direction.mean() * np.diff(position) / steps
        mean_speed = float(np.sum(speed) / max(np.sum(moving), 1.0))
        columns.append(HeldColumn.constant((speed - mean_speed) * moving, steps))
    if model.gravity == "proportional":
        columns.append(HeldColumn.constant(_middle(position) * moving, steps))
    if model.gravity == "pendulum":
        columns.append(HeldColumn.constant(_middle(np.sin(position)) * moving, steps))
        columns.append(HeldColumn.constant(_middle(np.cos(position)) * moving, steps))
    return Terms(columns=tuple(columns), mean_speed=mean_speed)


def others(
    model: Model,
    motion: Motion,
    position: FloatArray,
    steps: float | FloatArray,
    values: Mapping[str, float],
) -> FloatArray:
    """Mean over each interval of all terms but Coulomb friction, as if nothing stood, N.

    Args:
        model: which terms.
        motion: direction of motion; that it may stand is left out.
        position: m, shape (n,).
        steps: of the log, s.
        values: of the parameters by name.
    """
    columns = terms(model, motion.released(), position, steps).columns
    total = np.zeros(motion.moving.size)
    for name, held in zip(model.parameters[2:], columns, strict=True):
        if name != "coulomb_friction" and values[name] != 0:
            total += values[name] * held.mean()
    return total


def _middle(column: FloatArray) -> FloatArray:
    """Mean over each interval."""
    return (column[1:] + column[:-1]) / 2
