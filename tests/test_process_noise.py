"""A force that no log knows, seen in the lowest lines of what a fit of positions leaves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from datasets_synthetic import Faults
from identification import LogRefusedError, Method, identify
from identification.estimators.estimate import process_noise_covariance
from tests.fleet_hardware import data_sheet, log_of
from tests.simulated.fleet import random_devices

MASS, RATE, STEP, ROWS = 2.0, 3.0, 1e-3, 3000
NOISE, FORCE = 2e-6, 0.02  # m, N
_FLEET = 40


def _drifts(count: int, rng: np.random.Generator) -> np.ndarray:
    """Positions under white forces held one sample each, by the exponential of the motion."""
    both = np.zeros((3, 3))
    both[:2] = [[0, 1, 0], [0, -RATE, 1 / MASS]]
    moved = expm(both * STEP)
    state, places = np.zeros((2, count)), np.zeros((count, ROWS))
    for row in range(1, ROWS):
        state = moved[:2, :2] @ state + np.outer(moved[:2, 2], rng.normal(0, FORCE, count))
        places[:, row] = state[0]
    return places


def _columns() -> np.ndarray:
    """Mass and damping under a slow sine, then start velocity and position."""
    time = np.arange(ROWS) * STEP
    sine = np.sin(2 * np.pi * 1.3 * time)
    return np.stack([sine, np.cumsum(sine) * STEP, (1 - np.exp(-RATE * time)) / RATE, 0 * time + 1])


def _fits(force: bool, count: int = 150) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimates, what is added to their covariance, and that of position noise alone."""
    rng = np.random.default_rng(5)
    columns = _columns()
    measured = rng.normal(0, NOISE, (count, ROWS))
    if force:
        measured += _drifts(count, rng)
    values = np.linalg.lstsq(columns.T, measured.T)[0].T
    added = np.stack(
        [
            process_noise_covariance(columns, rest, 2, mass=MASS, rate=RATE, step=STEP)
            for rest in measured - values @ columns
        ]
    )
    return values[:, :2], added, NOISE**2 * np.linalg.inv(columns @ columns.T)[:2, :2]


def test_what_is_added_is_the_scatter_that_the_force_makes() -> None:
    values, added, white = _fits(force=True)
    scatter = np.cov(values.T) - white
    ratio = np.diag(np.mean(added, axis=0)) / np.diag(scatter)
    # The scatter of 150 is known to 12 %.
    assert ratio == pytest.approx([1.0, 1.0], abs=0.35)
    # Drift rules: without it an interval would be a fraction of what it must be.
    assert np.all(np.diag(scatter) > 10 * np.diag(white))


def test_without_such_a_force_little_is_added() -> None:
    _, added, white = _fits(force=False)
    relative = added[:, [0, 1], [0, 1]] / np.diag(white)
    assert np.mean(relative[:, 1] == 0) > 0.3
    assert np.all(np.median(relative, axis=0) < 0.3)


def _coverage(seeds: range, force_noise: float, method: Method) -> np.ndarray:
    """Part of random devices whose mass and damping are within their intervals."""
    inside: list[tuple[bool, bool]] = []
    for seed in seeds:
        fleet = random_devices(_FLEET, seed, samples=5000)
        faults = Faults(position_noise=1e-6, force_noise=force_noise)
        recording, rig = fleet.logs(faults=faults, seed=seed), fleet.rig
        for member in range(rig.batch):
            log, hardware = log_of(recording, member), data_sheet(fleet, member)
            try:
                device = identify(log, hardware=hardware, method=method).device
            except LogRefusedError:
                continue
            truths = (float(rig.mass[member]), float(rig.damping[member]))
            found = (device.mass, device.damping)
            near = [f.low <= t <= f.high for f, t in zip(found, truths, strict=True)]
            inside.append((near[0], near[1]))
    assert len(inside) > 0.9 * _FLEET * len(seeds)
    return np.mean(inside, axis=0)


@pytest.mark.long
def test_intervals_of_output_error_hold_under_a_force_the_log_does_not_know() -> None:
    """Without what is added 85 % of masses and 75 % of dampings."""
    assert np.all(_coverage(range(1), 1e-3, "output-error") >= 0.92)


@pytest.mark.long
@pytest.mark.parametrize("method", ["auto", "output-error"])
@pytest.mark.parametrize("force_noise", [0.0, 1e-3, 1e-2])
def test_intervals_hold_under_any_such_force(force_noise: float, method: Method) -> None:
    """320 devices each: half of them with friction, encoders from 1 to 50 micrometres."""
    assert np.all(_coverage(range(1, 9), force_noise, method) >= 0.94)
