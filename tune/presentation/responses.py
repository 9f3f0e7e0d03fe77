"""Response of an element to a step of force and to an impact, on the device and its box's corners.

The sampled loop is followed from sample to sample with its delay and filters; the law is cut at the
peak force, and a one-sided element only pushes. Friction, quantisation and hands are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.profile import Design, ElementProfile
from tune.loop.filters import filters_of
from tune.loop.state_space import Corner, SampledLoop, corners_of, exponential

FloatArray = NDArray[np.float64]

#: Samples followed, at least and at most; half periods or time constants that are looked at.
_FEWEST, _MOST, _PERIODS = 50, 3000, 5.0
#: Corners of the box that are followed beside the best estimate.
_CORNERS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Motion of the device inside of an element, each of shape (devices, samples).

    The first device is the best estimate, the others are corners of its box.

    Attributes:
        time: s, shape (samples,).
        position: of the handle, m.
        speed: of the rigid mass, m/s.
        force: of the law, N.
    """

    time: FloatArray
    position: FloatArray
    speed: FloatArray
    force: FloatArray


def step_response(design: Design, element: ElementProfile, force: float) -> Response:
    """Motion under a constant force on the device, from rest on the boundary of the element.

    Args:
        design: device and filters.
        element: whose law acts, two-sided.
        force: N, outwards of the mechanism, where the encoder reads.
    """
    return _followed(design, element, pushed=force, speed=0.0, one_sided=False)


def impact_response(design: Design, element: ElementProfile) -> Response:
    """Motion of a free device that enters the element at the speed of its motion."""
    one_sided = element.one_sided and not element.fades
    return _followed(design, element, pushed=0.0, speed=element.motion.speed, one_sided=one_sided)


def _followed(
    design: Design, element: ElementProfile, *, pushed: float, speed: float, one_sided: bool
) -> Response:
    filters = filters_of(design.loop)
    device = design.device
    values = (element.stiffness, element.damping, element.mass)
    limit = element.force_level or math.inf
    before = element.damping / element.stiffness if element.stiffness else 0.0
    acts = (limit, before, one_sided)
    count = _samples(design, element)
    best = Corner(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=design.loop.sample_time,
        delay=design.loop.extra_delay_samples * design.loop.sample_time,
        position_stiffness=device.slope_at_zero,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        modes=tuple(
            (mode.frequency_hz.value, mode.damping_ratio.value, mode.at_encoder)
            for mode in device.modes
        ),
    )
    box = corners_of(device, device.simultaneous_box())
    places = [best, *box[:: max(1, len(box) // _CORNERS)][:_CORNERS]]
    found = [
        _run(place, SampledLoop.of(place, filters, values), count, pushed, speed, *acts)
        for place in places
    ]
    position, rate, force = (np.stack(each) for each in zip(*found, strict=True))
    time = np.arange(count, dtype=np.float64) * design.loop.sample_time
    return Response(time=time, position=position, speed=rate, force=force)


def _samples(design: Design, element: ElementProfile) -> int:
    """Samples in which what the element does can be seen."""
    mass = max(design.device.mass.value + element.mass, 0.1 * design.device.mass.value)
    loss = max(design.device.damping.value + element.damping, 1e-3 * mass)
    span = mass / loss
    if element.stiffness > 0:
        span = math.pi * math.sqrt(mass / element.stiffness)
    return int(np.clip(_PERIODS * span / design.loop.sample_time, _FEWEST, _MOST))


def _run(
    place: Corner,
    loop: SampledLoop,
    count: int,
    pushed: float,
    speed: float,
    limit: float,
    before: float,
    one_sided: bool,  # noqa: FBT001 - one of two laws
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, speed and force of one device from sample to sample."""
    plant, free, command = loop.plant, loop.free, loop.command
    # The law enters in one place: what acts differs from what is free by column times command.
    column = (loop.pushed - free) @ command / (command @ command)
    outside = _outside(loop, place) * pushed
    state = np.zeros(len(loop.read))
    state[plant.speed] = speed
    if speed:
        # An element with a spring is entered where its law passes zero.
        state[0] = -speed * before
        state[loop.remembered] = loop.moving(loop.read @ state[:, None], speed * place.sample_time)[
            :, 0
        ]
    rows = np.empty((count, 3))
    for row in range(count):
        force = float(np.clip(command @ state, -limit, limit))
        place_now = float(loop.read @ state)
        if one_sided:
            force = min(force, 0.0)
        rows[row] = place_now, state[plant.speed], force
        state = free @ state + column * force + outside
    return rows[:, 0], rows[:, 1], rows[:, 2]


def _outside(loop: SampledLoop, place: Corner) -> FloatArray:
    """What a constant force of 1 N where the encoder reads adds to the state in a sample."""
    plant = loop.plant
    size = len(plant.drive)
    drive = np.zeros(size)
    drive[plant.speed : 2 * plant.speed] = plant.read[: plant.speed] / place.mass
    augmented = np.zeros((size + 1, size + 1))
    augmented[:size, :size], augmented[:size, size] = plant.motion, drive
    added = np.zeros(len(loop.read))
    added[:size] = exponential(augmented * place.sample_time)[:size, size]
    return added
