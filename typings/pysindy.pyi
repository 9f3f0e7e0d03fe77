# What haptune uses of pysindy, which ships no types.
import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

class SSR:
    history_: list[_Array]
    err_history_: list[float]
    def __init__(
        self,
        *,
        alpha: float,
        kappa: float,
        criteria: str,
        max_iter: int,
        unbias: bool,
    ) -> None: ...
    def fit(self, x_: _Array, y: _Array) -> SSR: ...
