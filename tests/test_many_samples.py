"""Logs of ten million samples, and logs given in another order."""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest
from scipy.signal import lfilter

from identification import (
    Device,
    ForceLimit,
    Hardware,
    IdentificationError,
    Trajectory,
    identify,
    quantity,
)
from tests.stress_identification import ALLOWED, drawn

_SAMPLES = 10_000_000
#: m, of the encoder; its noise is this part of it.
_COUNT, _NOISE = 2e-6, 0.3


def _long_log(seed: int) -> tuple[Trajectory, Hardware, float, float]:
    """A log of 0.1 to 10 kg under six sines, with true mass and damping; positions are exact."""
    rng = np.random.default_rng([77, seed])
    m = 10 ** rng.uniform(-1, 1)
    b = m * 10 ** rng.uniform(-0.5, 1.5)
    T = 10 ** rng.uniform(-4, -3)
    delay = int(rng.integers(0, 3))
    time = np.float64(T) * np.arange(_SAMPLES)
    force = np.zeros(_SAMPLES)
    for frequency in 10 ** rng.uniform(-1, 1.5, 6):
        force += np.sin(2 * np.pi * frequency * time + rng.uniform(0, 6))
    force *= 5 / np.abs(force).max()
    late = np.concatenate((np.zeros(delay), force))[:_SAMPLES]
    decay = np.exp(-b * T / m)
    slow = m / b * (1 - decay)
    speed = lfilter([0, (1 - decay) / b], [1, -decay], late)
    moved = np.cumsum(late / b * (T - slow) + speed * slow)
    counts = np.concatenate(([0], moved[:-1])) / _COUNT + _NOISE * rng.standard_normal(_SAMPLES)
    place = np.asarray(_COUNT * np.round(counts), dtype=np.float64)
    hardware = Hardware(
        name="long",
        motion="linear",
        sample_time=quantity(T),
        delay=quantity(delay * T) if seed % 2 else None,
        encoder_resolution=quantity(_COUNT),
        force_limit=ForceLimit(continuous=6, peak=7),
    )
    return Trajectory(time=time, force=force, position=place, motion="linear"), hardware, m, b


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_ten_million_samples_are_read_right(seed: int) -> None:
    log, hardware, mass, damping = _long_log(seed)
    found = identify(log, hardware=hardware).device
    for interval, true in ((found.mass, mass), (found.damping, damping)):
        assert interval.low < true < interval.high
        assert interval.high - interval.low < 2e-3 * true


def _parts(seed: int) -> tuple[list[Trajectory], Hardware] | None:
    """A drawn log in three unequal parts, None where it is refused or too short."""
    try:
        log, hardware, _, _ = drawn(seed)
        cuts = (0, len(log) // 5, len(log) * 11 // 20, len(log))
        return [log.part(slice(*ends)) for ends in pairwise(cuts)], hardware
    except IdentificationError:
        return None


def _found(parts: list[Trajectory], hardware: Hardware) -> Device | None:
    try:
        return identify(parts, hardware=hardware, allow=ALLOWED).device
    except IdentificationError:
        return None


@pytest.mark.parametrize(
    "seed", [4, *(pytest.param(s, marks=pytest.mark.long) for s in range(60) if s != 4)]
)
def test_logs_in_another_order_say_the_same(seed: int) -> None:
    drawn_parts = _parts(seed)
    if drawn_parts is None:
        assert seed != 4
        return
    parts, hardware = drawn_parts
    found = [_found([parts[k] for k in order], hardware) for order in permutations(range(3))]
    assert seed != 4 or found[0] is not None
    for other in found[1:]:
        assert (other is None) == (found[0] is None)
        if other is not None and found[0] is not None:
            assert other.mass == found[0].mass
            assert other.damping == found[0].damping
