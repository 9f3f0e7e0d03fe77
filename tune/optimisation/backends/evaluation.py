"""One program with one stage, evaluated without overhead: a solver asks some dozens of times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tune.optimisation.backends import Stage
    from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]


class Evaluation:
    """Objective and constraints at one point z = (log-sizes, t); the last answer is kept.

    Attributes:
        slope: gradient of the objective, shape (unknowns + 1,).
        constraints: at most 0 where kept, shape (constraints,); stability first, heights last.
        jacobian: their slopes, shape (constraints, unknowns + 1).
    """

    def __init__(self, program: Program, stage: Stage) -> None:
        count = program.lower.size + 1
        function = program.functions.evaluate_all if stage.routh else program.functions.evaluate
        rest = int(function.numel_out(2))
        self._reach = program.reach
        self._stable = 0 if stage.routh else self._reach.size
        self._z = np.full(count, np.nan)
        self._parameters = parameters_of(program, stage)
        self._value = np.empty(1)
        self._rest = np.empty(rest)
        # CasADi stores by columns.
        self._columns = np.empty((count, rest))
        self.slope: FloatArray = np.empty(count)
        self.constraints: FloatArray = np.empty(self._stable + rest)
        self.jacobian: FloatArray = np.zeros((self._stable + rest, count))
        self._buffer, self._evaluate = function.buffer()
        for place, given in enumerate((self._z, self._parameters)):
            self._buffer.set_arg(place, memoryview(cast("Any", given)))
        for place, answer in enumerate((self._value, self.slope, self._rest, self._columns)):
            self._buffer.set_res(place, memoryview(cast("Any", answer)))

    @property
    def value(self) -> float:
        """Of the objective, to be minimised."""
        return float(self._value[0])

    def at(self, z: FloatArray) -> Evaluation:
        """Itself, evaluated at z."""
        if not np.array_equal(z, self._z):
            self._z[:] = z
            self._evaluate()
            self.constraints[self._stable :] = self._rest
            self.jacobian[self._stable :] = self._columns.T
            if self._stable:
                stable, slopes = self._reach.at(np.exp(z[:-1]))
                self.constraints[: self._stable] = stable
                self.jacobian[: self._stable, :-1] = slopes
        return self


def parameters_of(program: Program, stage: Stage) -> FloatArray:
    """The parameters of the compiled functions: those of the problem, then those of the stage."""
    return np.concatenate([program.parameters, stage.active, stage.floors, stage.weights])
