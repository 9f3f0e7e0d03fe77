"""How a device in an element answers a constant force, sample by sample."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tune.documents.profile import Design, ElementProfile
from tune.loop.loop import filters_of
from tune.loop.state_space import Corner, SampledLoop

FloatArray = NDArray[np.float64]

#: Samples followed, at least and at most; half periods or time constants that are looked at.
_FEWEST, _MOST, _PERIODS = 50, 3000, 5.0


def step_response(
    design: Design, element: ElementProfile, force: float
) -> tuple[FloatArray, FloatArray]:
    """(time, motion), s and m, shape (samples,) each, from rest under a constant force, N.

    It acts where the encoder reads, on the best estimate of the device. Motion is the handle's
    position; of an element without stiffness the speed of the rigid mass, m/s. The sampled loop is
    followed with its delay and filters; the law is cut at the peak force. Friction, counts and
    hands are left out.
    """
    device, sample_time = design.device, design.loop.sample_time
    place = Corner(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=sample_time,
        delay=design.loop.extra_delay_samples * sample_time,
        position_stiffness=device.slope_at_zero,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        modes=tuple(
            (each.frequency_hz.value, each.damping_ratio.value, each.at_encoder)
            for each in device.modes
        ),
    )
    values = (element.stiffness, element.damping, element.mass)
    loop = SampledLoop.of(place, filters_of(design.loop), values)
    plant, free, command = loop.plant, loop.free, loop.command
    # The law enters in one place: what acts differs from what is free by column times command.
    column = (loop.pushed - free) @ command / (command @ command)
    size, limit = len(plant.drive), element.force_level or math.inf
    drive = np.zeros(size)
    drive[plant.speed : 2 * plant.speed] = plant.read[: plant.speed] / place.mass
    outside = np.zeros(len(loop.read))
    outside[:size] = replace(plant, drive=drive).held(sample_time)[1] * force
    seen = loop.read if element.stiffness else np.eye(len(loop.read))[plant.speed]
    state, motion = np.zeros(len(loop.read)), np.empty(_samples(design, element))
    for row in range(motion.size):
        motion[row] = seen @ state
        commanded = min(max(float(command @ state), -limit), limit)
        state = free @ state + column * commanded + outside
    return np.arange(motion.size, dtype=np.float64) * sample_time, np.nan_to_num(motion)


def _samples(design: Design, element: ElementProfile) -> int:
    """Samples in which what the element does can be seen."""
    mass = max(design.device.mass.value + element.mass, 0.1 * design.device.mass.value)
    span = mass / max(design.device.damping.value + element.damping, 1e-3 * mass)
    if element.stiffness > 0:
        span = math.pi * math.sqrt(mass / element.stiffness)
    return int(np.clip(_PERIODS * span / design.loop.sample_time, _FEWEST, _MOST))
