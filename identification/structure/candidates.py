"""The terms a log may ask for beyond mass and damping, as filtered columns for structure.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.estimators.regression import Regression
from identification.estimators.zero_order_hold import HeldColumn
from identification.structure.forces import smooth_speed
from identification.structure.stability_selection import Structure, suggest

FloatArray = NDArray[np.float64]


def structure_of(table: Regression, delay: float, *, rotary: bool, seed: int = 0) -> Structure:
    """Which terms one log asks for beyond mass and damping.

    Args:
        table: its regression, prepared with Coulomb friction in the model, which settles the
            direction of motion and where the device stands.
        delay: s, command to force.
        rotary: whether gravity may go with sine and cosine of the position.
        seed: of the random halves.
    """
    return suggest(candidate_columns(table, rotary=rotary), table.force(delay), seed=seed)


def candidate_columns(table: Regression, *, rotary: bool) -> dict[str, FloatArray]:
    """Every term of the equation of motion by its name, the simplest first, each shape (rows,).

    Where the device stands still every column is zero, as static friction takes up the rest.

    Args:
        table: the regression of one log.
        rotary: whether to offer sine and cosine of the position.
    """
    signals, motion = table.signals, table.motion
    position = signals.position

    def held(values: FloatArray) -> FloatArray:
        return table.filtered(HeldColumn.constant(values * motion.moving, signals.steps))

    def between(samples: FloatArray) -> FloatArray:
        return held((samples[1:] + samples[:-1]) / 2)

    columns = {
        "mass": table.columns[0],
        "damping": table.columns[1],
        "force_offset": held(np.ones_like(signals.speed)),
        "coulomb_friction": table.filtered(motion.direction),
        "position_stiffness": between(position),
        # The direction is a smooth one, so noise of the velocity is not rectified.
        "damping_asymmetry": held(motion.direction.mean() * signals.speed),
    }
    if rotary:
        columns["gravity_sine"] = between(np.sin(position))
        columns["gravity_cosine"] = between(np.cos(position))
    columns["quadratic_drag"] = held(np.abs(smooth_speed(table)) * signals.speed)
    return columns
