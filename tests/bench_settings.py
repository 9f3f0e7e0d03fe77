"""Settings of simulated benches, their exact limits, and the same loops as ``tune`` sees them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.sampled_bench import SampledBench
from tune import Filters, Loop
from tune.loop.plant import HandNumbers, ModeNumbers

FloatArray = NDArray[np.float64]

T = 0.001
DEVICE: dict[str, Any] = {"mass": 3.0, "damping": 10.0, "sample_time": T}
#: Along each effect alone, and along the paper's own setting.
RAYS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1000.0, 10.0, 1.0]])
FARTHEST = (3e5, 3e4, 300.0, 300.0)
#: What a bracket of the experiment, and its verdict near the limit, may be off: a third of 1 %.
CLOSE = 1 / 300


def exact_limits(bench: SampledBench) -> FloatArray:
    """Of the four rays."""
    rays = [(K, B, M) for K, B, M in RAYS.tolist()]
    return np.array([bench.limit(ray, high) for ray, high in zip(rays, FARTHEST, strict=True)])


MODE = (60.0, 0.02, 0.5, -1.2)
GRIP = (0.5, 8.0, 400.0)
SECOND: dict[str, Any] = {
    "velocity_filter_hz": 60.0,
    "acceleration_filter_hz": 40.0,
    "velocity_filter_order": 2,
    "filter_damping_ratio": 0.7071,
}


RIGID: tuple[dict[str, Any], ...] = (
    {},
    {"delay": 0.4 * T},
    {"delay": T},
    {"delay": 2.3 * T},
    {"delay": T, "hand": GRIP},
    {"delay": T, "velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0},
)
FLEXIBLE: tuple[dict[str, Any], ...] = (
    {"delay": T, "modes": (MODE,)},
    {"delay": T, "current_lag": 0.7 * T},
    {"delay": T, **SECOND},
    {"delay": T, "acceleration_filter_hz": 40.0, "acceleration_filter_order": 1},
    {"velocity_window_samples": 15},
    {"delay": 1.4 * T, "hand": GRIP, "modes": (MODE,), "current_lag": 0.3 * T, **SECOND},
)
EVERYTHING: dict[str, Any] = {
    "delay": 0.0,
    "current_lag": 0.0,
    "modes": ((60.0, 0.02, 0.0, 0.0),),
    "hand": (0.0, 0.0, 0.0),
    "velocity_filter_hz": np.inf,
    "acceleration_filter_hz": np.inf,
    "velocity_filter_order": 1,
    "acceleration_filter_order": 2,
    "filter_damping_ratio": 1.0,
    "velocity_window_samples": 1,
}


def loop_of(setting: dict[str, Any], device: dict[str, float] = DEVICE) -> Loop:
    """The same as ``tune`` sees it."""
    of = EVERYTHING | setting
    return Loop.from_numbers(
        **device,
        delay_samples=of["delay"] / T,
        filters=Filters(
            velocity_filter_hz=(
                None if np.isinf(of["velocity_filter_hz"]) else of["velocity_filter_hz"]
            ),
            acceleration_filter_hz=(
                None if np.isinf(of["acceleration_filter_hz"]) else of["acceleration_filter_hz"]
            ),
            velocity_filter_order=of["velocity_filter_order"],
            acceleration_filter_order=of["acceleration_filter_order"],
            filter_damping_ratio=of["filter_damping_ratio"],
            velocity_window_samples=(
                None if of["velocity_window_samples"] == 1 else of["velocity_window_samples"]
            ),
        ),
        modes=[
            ModeNumbers(frequency_hz=f, damping_ratio=z, at_encoder=e, at_handle=h)
            for f, z, e, h in setting.get("modes", ())
        ],
        hand=(
            None
            if "hand" not in setting
            else HandNumbers(**dict(zip(("mass", "damping", "stiffness"), of["hand"], strict=True)))
        ),
        current_lag=of["current_lag"],
    )
