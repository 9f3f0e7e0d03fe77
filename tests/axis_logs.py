"""Logs of an exact axis like HomeRehab, and what identify says of them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import (
    ForceLimit,
    Hardware,
    Identification,
    LogRefusedError,
    Trajectory,
    identify,
    quantity,
)
from identification.findings import CODES
from tests.exact_axis import Axis, counted, multisine, positions

Array = NDArray[np.float64]
STEP = 1e-3
COUNT = 6e-6
HARDWARE = Hardware(
    name="homerehab",
    motion="linear",
    sample_time=quantity(STEP),
    delay=quantity(STEP),
    encoder_resolution=quantity(COUNT),
    force_limit=ForceLimit(continuous=14.0, peak=28.0),
)
NAMES = ("mass", "damping", "coulomb_friction", "force_offset")


def log(force: Array, position: Array, step: float = STEP, **kind: Any) -> Trajectory:
    time: Array = np.arange(force.size) * np.float64(step)
    return Trajectory(time=time, force=force, position=position, **{"motion": "linear", **kind})


@cache
def homerehab(
    coulomb: float = 0.0,
    *,
    disturbance: float = 0.0,
    noise: float = 0.0,
    runs: int = 5,
    samples: int = 20000,
    seed: int = 0,
) -> tuple[Trajectory, ...]:
    """m = 3 kg, b = 10 N·s/m, delay 1 ms, ±50 mm, at most 14 N, counts of 6 um."""
    generator = np.random.default_rng(seed)
    axis = Axis(coulomb=coulomb, delay=STEP)
    force = multisine(generator, samples=samples, runs=runs, axis=axis)
    push = disturbance * generator.standard_normal(force.shape)
    place = positions(axis, force, disturbance=push)
    place = counted(place + noise * generator.standard_normal(force.shape), COUNT)
    return tuple(log(force[:, i], place[:, i]) for i in range(runs))


def codes(found: Identification | LogRefusedError) -> set[str]:
    return {finding.code for finding in found.findings}


def refused(trajectory: Trajectory, **options: Any) -> set[str]:
    with pytest.raises(LogRefusedError) as caught:
        identify(trajectory, **options)
    for finding in caught.value.findings:
        assert finding.code in CODES
        assert finding.seen
        assert finding.needed
        assert finding.remedy
    assert caught.value.findings[0].severity == "refusal"
    return {f.code for f in caught.value.findings if f.severity == "refusal"}


def holds(found: Identification, truth: dict[str, float]) -> NDArray[np.bool_]:
    inside: list[bool] = []
    for name, value in truth.items():
        interval = getattr(found.device, name)
        inside.append(interval.low <= value <= interval.high)
    return np.array(inside)
