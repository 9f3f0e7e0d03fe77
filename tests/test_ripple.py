"""Encoder ripple: closed form against known values, integration and a time simulation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from tune.certificate.polynomial import Point, Setting
from tune.certificate.ripple import ripple_by_integration
from tune.effects import Effects
from tune.loop import Filters, Loop
from tune.ripple import force_ripple
from tune.stability import is_stable


def _homerehab(delay: int, cutoff: float | None) -> Loop:
    return Loop.from_numbers(
        mass=3.0,
        damping=10.0,
        sample_time=1e-3,
        delay_samples=delay,
        filters=Filters(velocity_hz=cutoff, acceleration_hz=cutoff),
    )


@pytest.mark.parametrize(
    ("delay", "cutoff", "printed"),
    [
        (0, None, "4.6"),
        (1, None, "4.2"),
        (2, None, "4.3"),
        (0, 50.0, "0.15"),
        (1, 50.0, "0.15"),
        (1, 20.0, "0.026"),
    ],
)
def test_known_ripple_of_one_kilogram(delay: int, cutoff: float | None, printed: str) -> None:
    """m = 3 kg, b = 10 N·s/m, T = 1 ms, M = 1 kg, 6 µm encoder, to the digits printed."""
    ripple = float(force_ripple(_homerehab(delay, cutoff), Effects(mass=1.0), 6e-6))
    assert f"{ripple:.2g}" == printed


def _effects(values: NDArray[np.floating]) -> Effects:
    return Effects(stiffness=values[0] or None, damping=values[1], mass=values[2])


@pytest.mark.parametrize("seed", range(40))
def test_closed_form_against_integration_around_the_circle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mass, step = 10 ** rng.uniform(-1.3, 1.3), 10 ** rng.uniform(-3.5, -2.5)
    damping = mass / 10 ** rng.uniform(-2, 0)
    delay = int(rng.integers(0, 4))
    cutoffs = [None if rng.random() < 0.3 else float(rng.uniform(10, 0.3 / step)) for _ in range(2)]
    filters = Filters(velocity_hz=cutoffs[0], acceleration_hz=cutoffs[1])
    loop = Loop.from_numbers(
        mass=mass, damping=damping, sample_time=step, delay_samples=delay, filters=filters
    )
    wanted = np.array([0.2 * damping / step, 2 * damping, 0.3 * mass])
    values = np.where(rng.random(3) < 0.7, wanted, 0.0)
    effects = _effects(values)
    while not is_stable(loop, effects):
        values = values / 2
        effects = _effects(values)
    closed = float(force_ripple(loop, effects, 1e-5))
    point = Point(mass=mass, damping=damping, sample_time=step, delay_samples=delay)
    setting = Setting(
        stiffness=values[0],
        damping=values[1],
        mass=values[2],
        velocity_filter_hz=cutoffs[0],
        acceleration_filter_hz=cutoffs[1],
    )
    assert closed == pytest.approx(ripple_by_integration(point, setting, 1e-5), rel=1e-4)


def test_closed_form_against_a_long_noisy_run() -> None:
    """White noise of one count's variance through the difference equation of the loop itself."""
    mass, damping, step, stiffness = 3.0, 10.0, 1e-3, 1000.0
    decay = np.exp(-damping * step / mass)
    delta = damping * step / mass
    gain = mass / damping**2
    numerator = gain * np.array([decay - 1 + delta, 1 - (1 + delta) * decay])
    plant = np.array([1.0, -1 - decay, decay])
    # u = -K(q + n), q = G u: n to u is -K·D/(D + K·N).
    closed = plant + stiffness * np.array([0.0, *numerator])
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 6e-6 / np.sqrt(12), 2_000_000)
    force = np.asarray(lfilter(-stiffness * plant, closed, noise))[10_000:]
    ours = float(force_ripple(_homerehab(0, None), Effects(stiffness=stiffness), 6e-6))
    assert ours == pytest.approx(float(np.std(force)), rel=0.01)
