"""Limits of linear loops found at the simulated bench against exact ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Controller, Hand, Rig, Vibration
from tests.reference import Case, crossings, loop_along
from tests.simulated.experiment import limit_by_experiment

FloatArray = NDArray[np.float64]

T = 0.001
DEVICE: dict[str, Any] = {"mass": 3.0, "damping": 10.0, "sample_time": T}
#: Along each effect alone, and along the paper's own setting.
RAYS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1000.0, 10.0, 1.0]])
#: What a bracket of the experiment, and its verdict near the limit, may be off: a third of 1 %.
CLOSE = 1 / 300


def exact_limits(setting: dict[str, Any]) -> FloatArray:
    """Along the four rays, where a pole of the sampled loop reaches the circle, in 360 digits."""
    plain = {name: value for name, value in setting.items() if name != "delay"}
    case = Case(**DEVICE, **plain, delay_samples=setting.get("delay", 0.0) / T)
    rays = [[size or None for size in ray] for ray in RAYS.tolist()]
    return np.array([float(crossings(loop_along(case, *ray))[0].mid()) for ray in rays])


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


@pytest.mark.parametrize("settings", [RIGID, pytest.param(FLEXIBLE, marks=pytest.mark.long)])
def test_the_limit_of_a_linear_loop_is_found_at_the_bench(
    settings: tuple[dict[str, Any], ...],
) -> None:
    """K, B, M and (1000, 10, 1)·s of every setting, all in one batch."""
    exact = np.concatenate([exact_limits(each) for each in settings])
    each_ray = np.repeat(np.arange(len(settings)), len(RAYS))

    def values(name: str) -> NDArray[Any]:
        """One a member, shape (members,) or (members, numbers)."""
        chosen = [each.get(name, EVERYTHING[name]) for each in settings]
        return np.array(chosen)[each_ray]

    f, z, e, h = values("modes")[:, 0].T
    mode = Vibration(frequency_hz=f, damping_ratio=z, at_encoder=e, at_handle=h)
    mass, damping, stiffness = values("hand").T
    K, B, M = np.tile(RAYS, (len(settings), 1)).T
    kept = [name for name in EVERYTHING if "_" in name and name != "current_lag"]
    filters: dict[str, Any] = {name: values(name) for name in kept}
    found = limit_by_experiment(
        Rig(
            **DEVICE,
            delay=values("delay"),
            current_lag=values("current_lag"),
            modes=() if settings is RIGID else (mode,),
        ),
        Controller(stiffness=K, damping=B, mass=M, **filters),
        hand=Hand(mass=mass, damping=damping, stiffness=stiffness),
        between=(exact / 31, exact * 4.3),  # so that the exact limit is no special gain
        samples=3000,
        trials=20,
        rounds=3,
    )
    assert np.all(found.width < CLOSE)
    np.testing.assert_allclose(found.middle, exact, rtol=CLOSE)
