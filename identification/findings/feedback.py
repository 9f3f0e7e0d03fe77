"""Is the logged force a function of the position, as a controller makes it?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.linear import solve, unit_columns
from identification.findings.force_balance import ForceBalance
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Rows before now that predict now: a controller with two filters has as many.
_LAGS = 4
#: Samples looked at; more add time, not truth.
_MOST = 1 << 15
#: A prediction this much finer than the signal is rounding, not news.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """How well a virtual spring and damper explain the force, and how the device does.

    Attributes:
        stiffness: K of F = -K·q - B·q̇ + constant, N/m.
        damping: B, N·s/m.
        unexplained: share of the force's mean square the law leaves over.
        plant_unexplained: the same of mass, damping, friction and offset.
        model_unexplained: the same of these and the gravity that the estimate has.
        answer: share of what is new in the force that the reading of the same sample explains:
            nought in open loop, where the next force does not know the last reading's noise.
    """

    stiffness: float
    damping: float
    unexplained: float
    plant_unexplained: float
    model_unexplained: float
    answer: float


def law_of(trajectory: Trajectory, balance: ForceBalance) -> Law:
    """The controller that would have logged this.

    Args:
        trajectory: the log.
        balance: its rows, the force without delay or with: slow rows do not mind.
    """
    columns = np.stack((balance.position, balance.velocity, np.ones_like(balance.time)), axis=1)
    weights = solve(columns, balance.force)
    power = float(np.var(balance.force))
    left = balance.force - columns @ weights
    plant = model = float(np.mean(balance.unexplained() ** 2)) / power
    if balance.gravity != "none":
        model = float(np.mean(balance.unexplained(balance.carried) ** 2)) / power
    return Law(
        stiffness=-float(weights[0]),
        damping=-float(weights[1]),
        unexplained=float(np.mean(left**2)) / power,
        plant_unexplained=plant,
        model_unexplained=model,
        answer=_answer(trajectory),
    )


def _answer(trajectory: Trajectory) -> float:
    """Squared correlation of what is new in the force with what is new in the position.

    New is what the rows before do not predict (partial correlation at lag zero).
    """
    middle = max(0, (len(trajectory) - _MOST) // 2)
    part = slice(middle, middle + _MOST)
    force = trajectory.force[part] - np.mean(trajectory.force[part])
    place = trajectory.position[part] - np.mean(trajectory.position[part])
    rows = force.size - _LAGS
    columns = [
        column[_LAGS - lag : _LAGS - lag + rows]
        for column in (force, place)
        for lag in range(1, _LAGS + 1)
    ]
    columns += [force[_LAGS:], place[_LAGS:]]
    unit, _ = unit_columns(np.stack(columns).T)
    # Below the diagonal of R nothing is left, so its last columns hold what is new, turned.
    news: FloatArray = np.asarray(np.linalg.qr(unit, mode="r"), dtype=np.float64)[-2:, -2:]
    first, both, second = float(news[0, 0]), float(news[0, 1]), float(news[1, 1])
    if abs(first) <= _ROUNDING or np.hypot(both, second) <= _ROUNDING:
        return 0.0
    return both**2 / (both**2 + second**2)
