"""What drives the device in one log: the delayed force and the terms beside mass and damping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.held_response import Gain, HeldResponse
from identification.estimators.regression import Regression
from identification.estimators.rows import Signals
from identification.estimators.zero_order_hold import Commands, HeldColumn, mean_step

FloatArray = NDArray[np.float64]

#: Longest delay looked for, sample times; a longer one is to be stated.
MOST_SAMPLES = 4
#: Fastest |p| searched, per sample: there nothing of a motion is left after one, and no log tells a
#: faster one. A bound that a device may reach would be taken for its rate.
_FASTEST = 50.0
#: Fastest growth searched, per log: e^50 exceeds any travel.
_GROWTH = 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Inputs of one log; the delay is given, or one more nonlinear parameter.

    Attributes:
        commands: forces as logged.
        terms: columns of the terms beside mass and damping.
        moving: 1, or 0 where the device stands, shape (n - 1,).
        steps: of the log, s: one number, or shape (n - 1,).
        delay: s, or None if it is fitted.
    """

    commands: Commands
    terms: tuple[HeldColumn, ...]
    moving: FloatArray
    steps: float | FloatArray
    delay: float | None

    @classmethod
    def of(cls, table: Regression, delay: float | None) -> Drive:
        """Inputs as a prepared regression knows them."""
        return cls(
            commands=table.signals.commands,
            terms=table.held_terms(table.motion),
            moving=table.motion.moving,
            steps=table.signals.steps,
            delay=delay,
        )

    @classmethod
    def bare(cls, signals: Signals, delay: float | None) -> Drive:
        """The force alone, as if the device never stood."""
        return cls(
            commands=signals.commands,
            terms=(),
            moving=np.ones(signals.speed.size),
            steps=signals.steps,
            delay=delay,
        )

    def inputs(self, delay: float) -> tuple[HeldColumn, ...]:
        """Force, then the terms, where they act."""
        return (self.commands.after(delay).times(self.moving), *self.terms)

    def slope_by_delay(self, device: HeldResponse, delay: float) -> Gain:
        """What the force adds in each interval, differentiated by its delay."""
        force = self.commands.after(delay)
        later = device.slope_by_delay(force, float(self.commands.value[0]))
        return Gain(velocity=later.velocity * self.moving, distance=later.distance * self.moving)

    @property
    def rates(self) -> tuple[float, float]:
        """p searched, 1/s."""
        step = mean_step(self.steps)
        return -_GROWTH / step / self.moving.size, _FASTEST / step

    @property
    def delays(self) -> tuple[float, float]:
        """Delays searched, s."""
        return 0.0, MOST_SAMPLES * mean_step(self.steps)
