"""IPOPT through CasADi, with exact derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends import Rank
from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]

#: An interior point method wants to start away from the boundary: this much lower, in log-sizes.
_RETREAT = 1.0


class Ipopt:
    """Interior-point proposals; they end a little beyond or before the boundary."""

    name = "ipopt"

    def propose(self, program: Program, rank: Rank, start: FloatArray) -> FloatArray | None:
        """Log-sizes, shape (unknowns,), from a start of that shape; None where it gave up.

        It stops after 150 iterations or 2 s.
        """
        answer = program.functions.ipopt(
            x0=np.clip(start - _RETREAT, rank.lower, rank.upper),
            p=np.concatenate([program.parameters, rank.weights]),
            lbx=rank.lower,
            ubx=rank.upper,
            lbg=-np.inf,
            ubg=0.0,
        )
        proposal = np.asarray(answer["x"], dtype=np.float64).ravel()
        return proposal if np.all(np.isfinite(proposal)) else None
