"""IPOPT through CasADi, with exact derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import HEIGHTS, Stage
from tune.optimisation.backends.evaluation import parameters_of
from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]

#: An interior point method wants to start away from the boundary: this much lower, in log-sizes.
_RETREAT = 1.0


class Ipopt:
    """Interior-point proposals; they end a little beyond or before the boundary."""

    name = "ipopt"

    def propose(self, program: Program, stage: Stage, start: FloatArray) -> FloatArray | None:
        """See `tune.optimisation.backends.Backend`. Bounded to 150 iterations and 2 s."""
        count = start.size
        inside = np.clip(start - _RETREAT, program.lower, program.upper)
        answer = program.functions.ipopt(
            x0=np.append(inside, min(0.0, stage.start)),
            p=parameters_of(program, stage),
            lbx=np.append(program.lower, HEIGHTS[0]),
            ubx=np.append(program.upper, HEIGHTS[1]),
            lbg=-np.inf,
            ubg=0.0,
        )
        proposal = np.asarray(answer["x"], dtype=np.float64).ravel()[:count]
        return proposal if np.all(np.isfinite(proposal)) else None
