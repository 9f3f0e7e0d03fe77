"""The simulated device that tests change one property of at a time, and its motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import Rig

FloatArray = NDArray[np.float64]

T = 0.001
M, B = 3.0, 10.0


def rig(**changes: Any) -> Rig:
    """3 kg and 10 N·s/m at 1 kHz, but for what is changed."""
    values: dict[str, Any] = {"mass": M, "damping": B, "sample_time": T}
    return Rig(**values | changes)


def clock(samples: int, step: float = T) -> FloatArray:
    return step * np.arange(samples, dtype=np.float64)


def step_response(time: FloatArray, mass: float = M, damping: float = B) -> FloatArray:
    """Position t after a unit force is switched on; zero before."""
    after = np.maximum(time, 0.0)
    return (after + mass / damping * np.expm1(-damping / mass * after)) / damping
