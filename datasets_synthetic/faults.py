"""What disturbs a log: noise on the position, forces that act but are not logged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """What disturbs the log; numbers, or arrays of shape (batch,).

    Attributes:
        position_noise: rms of white noise added to the position before rounding, m (rad).
        force_noise: rms of a white force that acts but is not logged, held one sample, N (N·m).
        coloured_force: rms of a slower unlogged force, held one sample, N (N·m), ...
        correlation_time: ... whose correlation over a time t is exp(-t/correlation_time), s.
        start_spread: the device starts anywhere within this of its stated start, evenly, m (rad):
            where between two counts it stands is chance.
    """

    position_noise: float | FloatArray = 0.0
    force_noise: float | FloatArray = 0.0
    coloured_force: float | FloatArray = 0.0
    correlation_time: float | FloatArray = 0.1
    start_spread: float | FloatArray = 0.0

    def __post_init__(self) -> None:
        if np.any(np.asarray(self.correlation_time) <= 0):
            raise ValueError(f"correlation_time must be positive, not {self.correlation_time}")

    def sizes(self) -> list[int]:
        """Number of members each field describes."""
        noise = (self.position_noise, self.force_noise, self.start_spread)
        return [np.size(field) for field in (*noise, self.coloured_force, self.correlation_time)]
