"""How a device in an element answers a constant force, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tune.loop.loop import Filters
from tune.loop.state_space import Corner, SampledLoop

FloatArray = NDArray[np.float64]


def step_response(
    place: Corner, filters: Filters, gains: tuple[float, float, float], force: float, samples: int
) -> FloatArray:
    """Motion, shape (samples,), m, from rest under a constant force, N, where the encoder reads.

    Gains are K, B and M. Without K it is the speed of the rigid mass, m/s. The sampled loop is
    followed with delay and filters; limits of force, friction, counts and hands are left out.
    """
    loop = SampledLoop.of(place, filters, gains)
    plant, size = loop.plant, len(loop.plant.drive)
    drive = np.zeros(size)
    drive[plant.speed : 2 * plant.speed] = plant.read[: plant.speed] / place.mass
    # The state with a one below it, so that one matrix advances it and pushes.
    advance = np.eye(len(loop.read) + 1)
    advance[:-1, :-1] = loop.pushed
    advance[:size, -1] = replace(plant, drive=drive).held(place.sample_time)[1] * force
    states = np.eye(len(advance))[:, -1:]
    while states.shape[1] < samples:
        states = np.hstack([states, advance @ states])
        advance = advance @ advance
    motion = loop.read @ states[:-1] if gains[0] else states[plant.speed]
    return np.asarray(np.nan_to_num(motion[:samples]), dtype=np.float64)
