"""A rigid device with held force and quantised encoder, run by a compiled guard."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.guard import Guard, Reply, enter, push
from tune import SafeProfile

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What happened in each period, shape (periods,), in SI units; place and speed are true."""

    place: FloatArray
    speed: FloatArray
    force: FloatArray
    touched: NDArray[np.bool_]
    statuses: tuple[str, ...]
    last: Reply


def played(
    guard: Guard,
    profile: SafeProfile,
    touched: Callable[[int, float], int],
    *,
    place: float,
    speed: float,
    periods: int,
    faces: Mapping[int, tuple[float, int]],
    push_of_hand: float = 0.0,
    wrong: Mapping[int, float] | None = None,
    missed: frozenset[int] = frozenset(),
    gain: Callable[[int, float], float] = lambda k, reading: 1.0,
) -> Run:
    """Let a device without dry friction go and call the guard in every period that is not missed.

    Elements come from the period and the reading; faces, (rest, side), are given whenever theirs
    are touched anew. What is wrong is added to the readings of some periods.
    """
    device, step = profile.device, profile.loop.sample_time
    m, b = device.mass.value, device.damping.value
    pole = math.exp(-b / m * step)
    lost = (1 - pole) / b  # speed that one newton gives in a period
    behind = round(profile.loop.extra_delay_samples)
    assert device.encoder_resolution is not None
    count = device.encoder_resolution.value
    guard.start()
    sent = [0.0] * (behind + 1)
    rows: list[tuple[float, float, float, bool]] = []
    statuses: list[str] = []
    reply, before = Reply(status="OK"), 0
    for k in range(periods):
        reading = round(place / count) * count + (wrong or {}).get(k, 0.0)
        asked = touched(k, reading)
        for elements, (rest, side) in faces.items():
            if elements & asked & ~before:
                guard.call(enter(elements, rest, side))
        before = asked
        if k not in missed:
            reply = guard.call(push(asked, k, reading, gain(k, reading)))
            if reply.status in {"LATE", "NOT_ENTERED"}:
                before = 0  # contacts were ended: they are entered again
        statuses.append(reply.status)
        sent = [*sent[1:], reply.force]
        rows.append((place, speed, reply.force, asked != 0))
        force = sent[0] + push_of_hand
        steady = force / b
        place += steady * step + (speed - steady) * lost * m
        speed = steady + (speed - steady) * pole
    found = np.array(rows)
    return Run(
        place=found[:, 0],
        speed=found[:, 1],
        force=found[:, 2],
        touched=found[:, 3] > 0,
        statuses=tuple(statuses),
        last=reply,
    )
