"""Encoder, force limit, noise and seeds of the simulator, batches, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from datasets_synthetic import Controller, Faults, Rig, simulate
from tests.plain_rigs import B, T, clock, rig, step_response


def test_encoder_rounds_to_whole_counts() -> None:
    force = np.full(1000, 4.0)
    exact = simulate(rig(), force).position[0]
    read = simulate(rig(encoder_resolution=6e-6), force).position[0]
    np.testing.assert_allclose(read / 6e-6, np.rint(read / 6e-6), atol=1e-9)
    assert np.max(np.abs(read - exact)) <= 3e-6 * (1 + 1e-9)
    assert np.std(read - exact) == pytest.approx(6e-6 / np.sqrt(12), rel=0.1)


def test_force_is_logged_and_applied_as_limited() -> None:
    limited = simulate(rig(force_limit=2.0), np.full(400, 5.0))
    np.testing.assert_array_equal(limited.force, 2.0)
    np.testing.assert_allclose(
        limited.position[0], 2.0 * step_response(clock(400)), rtol=1e-9, atol=1e-15
    )
    closed = simulate(
        rig(force_limit=2.0), np.zeros(100), controller=Controller(stiffness=1e4), position=0.01
    )
    assert closed.force[0, 0] == -2.0


def test_noise_has_the_stated_size_and_place() -> None:
    quiet = simulate(rig(), np.zeros(20_000)).position[0]
    noisy = simulate(rig(), np.zeros(20_000), faults=Faults(position_noise=1e-4)).position[0]
    assert np.std(noisy - quiet) == pytest.approx(1e-4, rel=0.03)
    light = Rig(mass=0.01, damping=B, sample_time=T)  # comes to rest within a sample or so
    pushed = simulate(light, np.zeros((400, 400)), faults=Faults(force_noise=0.5))
    assert not np.any(pushed.force)
    wandered = np.std(pushed.position[:, -1])
    assert wandered == pytest.approx(0.5 * T / B * np.sqrt(400), rel=0.12)


def test_same_seed_same_log_other_seed_other_log() -> None:
    faults = Faults(position_noise=1e-5, force_noise=0.1)
    first, again, other = (
        simulate(rig(), np.ones(300), faults=faults, seed=seed).position for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(first, again)
    assert np.all(first[0] != other[0])
    spread = simulate(rig(), np.ones((3, 300)), faults=faults, seed=7).position
    np.testing.assert_array_equal(spread[0], first[0])
    assert np.all(spread[0] != spread[1])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": 0.0}, "mass must be positive, not 0"),
        ({"delay": -1e-3}, "delay must be finite and not negative, not -0.001"),
        ({"damping": np.nan}, "damping must be finite, not nan"),
        ({"encoder_resolution": np.inf}, "encoder_resolution must be finite and not negative"),
        ({"force_limit": np.nan}, "force_limit must be positive"),
    ],
)
def test_impossible_devices_are_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rig(**changes)
