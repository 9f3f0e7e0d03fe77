"""Walls on axes under friction that the model lacks, integrated as in `friction_rigs`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tests.simulated.friction_rigs import COUNT, SUBSTEPS, Friction, Recorded, State, T, advance
from tune import SafeProfile

#: Seconds played. In the last part the handle moves by at most so many counts, or less than in the
#: part half-way: near the end of a margin a swing dies out slowly.
_SECONDS, _PART, _COUNTS, _LESS = 6.0, 0.15, 20.0, 0.9
#: m, from which the handle is let go.
_START = 0.004


def settled(
    friction: Friction,
    logs: Sequence[Recorded],
    profiles: Sequence[SafeProfile],
    element: str,
    *,
    gain: float,
    late: int,
) -> NDArray[np.bool_]:
    """Whether each device comes to rest when let go inside a spring and damper about zero.

    Args:
        friction: of all devices.
        logs: the devices.
        profiles: one for each, with one velocity filter of first order or none.
        element: which of their elements.
        gain: times stiffness and damping.
        late: samples of delay beside the device's own.
    """
    mass, damping, coulomb = (
        np.array([getattr(log, name) for log in logs]) for name in ("mass", "damping", "coulomb")
    )
    stiffness, damper = (
        gain * np.array([getattr(each.elements[element], name) for each in profiles])
        for name in ("stiffness", "damping")
    )
    pole = np.array(
        [np.exp(-2 * np.pi * (each.loop.velocity_filter_hz or np.inf) * T) for each in profiles]
    )
    zero = np.zeros(len(logs))
    state = State(
        position=zero + _START, velocity=zero.copy(), bundle=zero.copy(), bristle=zero.copy()
    )
    waiting = [zero] * (1 + late)
    last = np.rint(state.position / COUNT) * COUNT
    speed = zero
    count = round(_SECONDS / T)
    course = np.zeros((count, len(logs)))
    for k in range(count):
        course[k] = state.position
        reading = np.rint(state.position / COUNT) * COUNT
        speed = pole * speed + (1 - pole) * (reading - last) / T
        last = reading
        waiting.append(-stiffness * reading - damper * speed)
        force = waiting.pop(0)
        for _ in range(SUBSTEPS):
            advance(state, friction, mass, damping, coulomb, force, T / SUBSTEPS)
    part = round(_PART * count)
    end, half_way = np.ptp(course[-part:], axis=0), np.ptp(course[count // 2 :][:part], axis=0)
    return (end <= _COUNTS * COUNT) | (end < _LESS * half_way)
