"""Forces that the model does not have, as filtered columns: what a residual is asked for.

Each kind is a few columns that follow any force of that kind closely enough to find it, and to give
mass and damping without it: powers of speed, bells of speed for friction that falls, waves of
position, and stop operators.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identification.device.device import Kind
from identification.estimators.low_pass import width_of
from identification.estimators.regression import Regression
from identification.estimators.zero_order_hold import HeldColumn
from identification.structure.hysteresis import stop_operators

FloatArray = NDArray[np.float64]
#: Widths of the bells of speed, parts of the fastest.
_BELLS = (0.03, 0.06, 0.12, 0.25)
#: Waves of position over the travel: of damping, ...
_DAMPING_WAVES = 8
#: ... and of force.
_WAVES = 16
#: Widths of the springs that yield, parts of the travel.
_WIDTHS = (0.15, 0.05, 0.015, 0.005, 0.0015)
#: Speeds and places at which slopes are taken.
_SPEEDS, _PLACES = 21, 65


@dataclass(frozen=True)
class Forces:
    """The kinds of force of one log.

    Attributes:
        table: its regression, direction of motion settled.
    """

    table: Regression

    @cached_property
    def fastest(self) -> float:
        """Fastest speed seen, smoothed, m/s."""
        return float(np.max(np.abs(self._speed)))

    def columns(self) -> dict[Kind, FloatArray]:
        """Filtered columns of each kind, shape (rows, its columns); none that is zero or wild."""
        moving, steps = self.table.motion.moving, self.table.signals.steps
        found: dict[Kind, FloatArray] = {}
        for kind, held in self._held():
            made = [self.table.filtered(HeldColumn.constant(each * moving, steps)) for each in held]
            found[kind] = np.stack(made, axis=1)
        return found

    def slopes(self, kind: Kind) -> FloatArray:
        """What each column of a kind adds to the slope of friction over speed, N·s/m a unit.

        Returns:
            Shape (speeds and places, columns); rest is the first row, and one row of zeros stands
            for a kind that is no static function of speed, or one that falls.
        """
        if kind == "drag":
            speed = np.linspace(0.0, 1.0, _SPEEDS)
            return np.stack((2 * speed, 3 * speed**2), axis=1) / self.fastest
        if kind == "place":
            place = np.quantile(self._place, np.linspace(0.01, 0.99, _PLACES))
            return np.stack(list(_waves(place, _DAMPING_WAVES)), axis=1) / self.fastest
        count = {"falling": len(_BELLS), "position": 1 + 2 * _WAVES, "memory": 1 + len(_WIDTHS)}
        return np.zeros((1, count[kind]))

    def stiffnesses(self) -> FloatArray:
        """What each column of memory adds to the stiffness before sliding, N/m a unit.

        Returns:
            Shape (states, columns): all springs yield, then the widest holds, then one more each.
        """
        travel = float(np.ptp(self.table.signals.position))
        springs = 1 / (np.array(_WIDTHS) * travel)
        held = np.tril(np.ones((len(_WIDTHS) + 1, len(_WIDTHS))), -1)
        return np.column_stack((np.full(len(held), 2 / travel), held * springs))

    @cached_property
    def _speed(self) -> FloatArray:
        return smooth_speed(self.table)

    @cached_property
    def _place(self) -> FloatArray:
        """Mean position of each interval, -1 to 1 over the travel."""
        position = self.table.signals.position
        middle, half = (position.max() + position.min()) / 2, np.ptp(position) / 2
        return ((position[1:] + position[:-1]) / 2 - middle) / half

    def _held(self) -> Iterator[tuple[Kind, list[FloatArray]]]:
        """Columns of each kind of force, one value an interval of the log."""
        position = self.table.signals.position
        unit = self._speed / self.fastest
        place, sense = self._place, self.table.motion.direction.mean()
        stops = stop_operators(position, [width * np.ptp(position) for width in _WIDTHS])
        yield "drag", [np.abs(unit) * unit, unit**3]
        yield "falling", [sense * np.exp(-((unit / width) ** 2)) for width in _BELLS]
        yield "place", [unit * wave for wave in _waves(place, _DAMPING_WAVES)]
        yield "position", [place, *_waves(place, _WAVES)]
        yield "memory", [place, *((stop[1:] + stop[:-1]) / 2 for stop in stops)]


def _waves(place: FloatArray, count: int) -> Iterator[FloatArray]:
    """Cosines and sines with 1 to ``count`` half periods from the middle to an end."""
    for number in range(1, count + 1):
        yield np.cos(number * np.pi * place)
        yield np.sin(number * np.pi * place)


def smooth_speed(table: Regression) -> FloatArray:
    """Velocity of each interval, smooth enough that its square is not mostly noise.

    The answer has shape (n - 1,), m/s (rad/s).
    """
    from scipy.ndimage import gaussian_filter1d

    width = width_of(table.cut_off.frequency) / table.signals.step
    return np.asarray(
        gaussian_filter1d(table.signals.speed, width, mode="nearest"), dtype=np.float64
    )
