"""Limits of linear loops found at the simulated bench against exact ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import Controller, Hand, Rig, Vibration
from tests.bench_settings import (
    CLOSE,
    DEVICE,
    EVERYTHING,
    FLEXIBLE,
    RAYS,
    RIGID,
    exact_limits,
    loop_of,
)
from tests.sampled_bench import SampledBench
from tests.simulated.experiment import EFFECTS, limit_by_experiment
from tune import Effects, largest, safe_gain


@pytest.mark.parametrize("setting", RIGID + FLEXIBLE, ids=lambda each: "+".join(each) or "ideal")
def test_tune_and_the_eigenvalues_of_one_sample_agree(setting: dict[str, Any]) -> None:
    loop = loop_of(setting)
    ours = [float(largest(loop, name, Effects())) for name in EFFECTS]
    ours.append(float(safe_gain(loop, Effects(stiffness=1000.0, damping=10.0, mass=1.0))))
    np.testing.assert_allclose(ours, exact_limits(SampledBench(**DEVICE, **setting)), rtol=1e-8)


@pytest.mark.parametrize("settings", [RIGID, pytest.param(FLEXIBLE, marks=pytest.mark.long)])
def test_the_limit_of_a_linear_loop_is_found_at_the_bench(
    settings: tuple[dict[str, Any], ...],
) -> None:
    """K, B, M and (1000, 10, 1)·s of every setting, all in one batch."""
    exact = np.concatenate([exact_limits(SampledBench(**DEVICE, **each)) for each in settings])
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
