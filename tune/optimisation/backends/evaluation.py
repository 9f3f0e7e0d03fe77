"""A program evaluated without overhead: a solver asks some dozens of times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tune.optimisation.backends import Rank
    from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]


class Evaluation:
    """Objective and constraints at one point y of log-sizes; the last answer is kept.

    Attributes:
        value: minus the weighted sum of the logarithms of steps.
        slope: its gradient, shape (unknowns,).
        constraints: at most 0 where kept, shape (constraints,).
        jacobian: their slopes, shape (constraints, unknowns).
    """

    def __init__(self, program: Program, rank: Rank) -> None:
        count = program.signs.size
        function = program.functions.smooth_all if rank.routh else program.functions.smooth
        smooth = int(function.numel_out(0))
        self._program = program
        self._weights = rank.weights
        # Routh's ratios stand for the reach of stability.
        self._reach = None if rank.routh else program.reach
        total = smooth + (0 if self._reach is None else self._reach.size)
        self._y = np.full(count, np.nan)
        plain = None if rank.routh else program.plain
        self._parameters = np.ascontiguousarray(program.parameters[:plain])
        self._smooth = np.empty(smooth)
        # CasADi stores by columns.
        self._columns = np.empty((count, smooth))
        self.value = np.nan
        self.slope: FloatArray = np.empty(count)
        self.constraints: FloatArray = np.empty(total)
        self.jacobian: FloatArray = np.zeros((total, count))
        self._buffer, self._evaluate = function.buffer()
        for place, given in enumerate((self._y, self._parameters)):
            self._buffer.set_arg(place, memoryview(cast("Any", given)))
        for place, answer in enumerate((self._smooth, self._columns)):
            self._buffer.set_res(place, memoryview(cast("Any", answer)))

    def at(self, y: FloatArray) -> Evaluation:
        """Itself, evaluated at log-sizes y, shape (unknowns,)."""
        if not np.array_equal(y, self._y):
            self._y[:] = y
            sizes = np.exp(y)
            value, slope = self._program.product(sizes, self._weights)
            self.value, self.slope[:] = -value, -slope
            if self._smooth.size:
                self._evaluate()
            self.constraints[: self._smooth.size] = self._smooth
            self.jacobian[: self._smooth.size] = self._columns.T
            if self._reach is not None:
                values, slopes = self._reach.at(sizes)
                self.constraints[self._smooth.size :] = values
                self.jacobian[self._smooth.size :] = slopes
        return self
