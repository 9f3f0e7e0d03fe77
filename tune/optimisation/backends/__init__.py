"""Solvers that propose. What they propose is never trusted: `limits` checks it exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.backends.program import Program

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rank:
    """What is raised at one rank, and between which ends.

    Attributes:
        weights: of the logarithms of steps in the sum that is maximised, shape (unknowns,).
        lower: of log-sizes, shape (unknowns,); equal to ``upper`` where a size is fixed.
        upper: of log-sizes, shape (unknowns,).
        routh: judge stability by Routh's ratios at the full gain instead of by the exact reach,
            for they are smooth where two branches of its boundary meet. Some solvers always do.
    """

    weights: FloatArray
    lower: FloatArray
    upper: FloatArray
    routh: bool = False


class Backend(Protocol):
    """One solver."""

    @property
    def name(self) -> str:
        """What it is called where a profile says who found the answer."""
        ...

    def propose(self, program: Program, rank: Rank, start: FloatArray) -> FloatArray | None:
        """Log-sizes, shape (unknowns,), from a start of that shape; None where it gave up."""
        ...
