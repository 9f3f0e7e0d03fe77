"""Clarabel, as far as it is used here."""

from typing import Any

from numpy import float64
from numpy.typing import NDArray

class Cone: ...

class ZeroConeT(Cone):
    def __init__(self, dim: int) -> None: ...

class NonnegativeConeT(Cone):
    def __init__(self, dim: int) -> None: ...

class SecondOrderConeT(Cone):
    def __init__(self, dim: int) -> None: ...

class PSDTriangleConeT(Cone):
    def __init__(self, dim: int) -> None: ...

class DefaultSettings:
    verbose: bool
    equilibrate_enable: bool

class SolverStatus:
    Solved: SolverStatus
    AlmostSolved: SolverStatus

class Solution:
    x: list[float]
    status: SolverStatus

class DefaultSolver:
    def __init__(
        self,
        P: Any,
        q: NDArray[float64],
        A: Any,
        b: NDArray[float64],
        cones: list[Cone],
        settings: DefaultSettings,
    ) -> None: ...
    def solve(self) -> Solution: ...
