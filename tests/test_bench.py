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
    T,
    exact_limits,
    loop_of,
)
from tests.sampled_bench import SampledBench
from tests.simulated.experiment import EFFECTS, limit_by_experiment
from tune import Effects, largest, safe_gain


@pytest.mark.parametrize(
    ("setting", "printed"),
    [
        ({}, (20_011, 6_013, 6.01)),
        ({"delay": T}, (6_673, 2_493, 3.71)),
        ({"delay": 2 * T}, (4_006, 1_615, 3.33)),
        ({"velocity_filter_hz": 50.0, "acceleration_filter_hz": 50.0}, (20_011, 6_068, 38.7)),
        (
            {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 50.0, "delay": T},
            (6_673, 2_148, 14.7),
        ),
        (
            {"velocity_filter_hz": 20.0, "acceleration_filter_hz": 20.0, "delay": T},
            (6_673, 2_110, 34.1),
        ),
        ({"velocity_window_samples": 15}, (20_011, 891, 6.01)),
    ],
)
def test_exact_limits_are_the_printed_ones(
    setting: dict[str, Any], printed: tuple[float, float, float]
) -> None:
    exact = exact_limits(SampledBench(**DEVICE, **setting))[:3]
    assert [float(f"{value:.3g}") if value < 100 else round(value) for value in exact] == [*printed]


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


def test_a_limit_outside_the_range_is_said_to_be_outside() -> None:
    found = limit_by_experiment(
        Rig(mass=[3.0, 3.0], damping=10.0, sample_time=T),
        Controller(stiffness=1.0),
        between=(np.array([30_000.0, 2000.0]), np.array([60_000.0, 9000.0])),
        trials=5,
        rounds=2,
        samples=2000,
    )
    assert found.high[0] <= 30_000.0  # every gain that was asked for lasts
    assert (found.low[1], found.high[1]) == (9000.0, np.inf)
    assert found.width[1] == np.inf
    with pytest.raises(ValueError, match="must be positive and rising"):
        limit_by_experiment(Rig(**DEVICE), Controller(stiffness=1.0), between=(2.0, 1.0))
