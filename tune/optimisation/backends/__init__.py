"""Solvers that propose. What they propose is never trusted: `limits` checks it exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One step of the lexicographic climb.

    Attributes:
        active: 1 for unknowns that must reach the common height t, shape (unknowns,).
        floors: heights that must be kept, shape (unknowns,).
        weights: of (heights..., t) in what is maximised, shape (unknowns + 1,).
        start: t to begin with.
        routh: judge stability by Routh's ratios at the full gain instead of by the exact reach,
            for they are smooth where two branches of its boundary meet. Some solvers always do.
    """

    active: FloatArray
    floors: FloatArray
    weights: FloatArray
    start: float = 0.0
    routh: bool = False


#: Least and largest height a solver looks at, steps.
HEIGHTS = (-1e3, 1e3)


class Backend(Protocol):
    """One solver."""

    name: str

    def propose(self, program: Program, stage: Stage, start: FloatArray) -> FloatArray | None:
        """Log-sizes, shape (unknowns,), from a start of that shape; None where it gave up."""
        ...
