"""Force ripple that an encoder's counts cause while the handle moves, by simulation."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.device import Hand, Rig, per_member
from datasets_synthetic.law import Controller
from datasets_synthetic.simulation import simulate

FloatArray = NDArray[np.float64]

#: The first part of a run is left out: the loop has to forget that its encoder began to round.
_SETTLING = 0.25
#: Speed at the start, and what is gained until the end, counts a sample. Never below one, and in
#: what is kept changing all the time over four whole numbers: the rounding then takes every value,
#: in no fixed order, and each of its lines sweeps the whole band at least four times.
_PACE, _GAIN = 2.3, 4.0 / (1 - _SETTLING)


def ripple_by_simulation(
    rig: Rig,
    controller: Controller,
    *,
    hand: Hand | None = None,
    samples: int = 4000,
    starts: int = 4,
) -> FloatArray:
    """Deviation of the force from that of the same loop without counts, N (N·m) rms, (batch,).

    A hand pushes the handle along at a few counts a sample, ever faster, with the force that the
    device, its effects and the hand's own impedance need for that. Each device is run with and
    without counts under the same push, from several places within a count. Coulomb friction and
    force limit are left out: the handle never turns, and the limit is not reached in what the
    ripple is for.

    Args:
        rig: the devices; each must have an encoder with counts.
        controller: effects, without a wall.
        hand: whose mass, damper and spring are on the handle.
        samples: of each run.
        starts: places within a count to start from.

    Raises:
        ValueError: a device that reads exactly, or a wall.
    """
    if np.any(rig.encoder_resolution == 0):
        raise ValueError(f"{rig.name} reads its position exactly: give it an encoder_resolution")
    if np.any(controller.side):
        raise ValueError("a wall gives no force outside: leave it out to measure its ripple inside")
    hand = hand or Hand()
    batch = max(rig.batch, controller.size(), *hand.sizes())
    which = np.repeat(np.arange(batch), starts)
    some = rig.members(which if rig.batch > 1 else np.zeros_like(which))
    free = replace(some, coulomb_friction=0.0, coulomb_asymmetry=0.0, force_limit=np.inf)
    gains, grip = controller.members(which), hand.members(which)
    count, step = free.encoder_resolution, free.sample_time
    pace, gain = _PACE * count / step, _GAIN * count / step / (samples * step)
    place = count * np.resize(np.arange(starts) / starts, which.size)
    push = _push(free, gains, grip, (place, pace, gain), samples)
    run = partial(
        simulate,
        force=np.zeros(samples),
        controller=gains,
        hand=grip,
        position=place,
        velocity=pace,
        push=push,
    )
    rough, smooth = (run(each).force for each in (free, replace(free, encoder_resolution=0.0)))
    kept = (rough - smooth)[:, round(_SETTLING * samples) :].reshape(batch, starts, -1)
    return np.sqrt(np.mean(kept**2, axis=(1, 2)))


def _push(
    rig: Rig,
    gains: Controller,
    hand: Hand,
    motion: tuple[FloatArray, FloatArray, FloatArray],
    samples: int,
) -> FloatArray:
    """Force for q = place + pace·t + gain·t²/2, N, shape (batch, n), delays left aside."""
    column = partial(per_member, batch=rig.batch)
    place, pace, gain = motion
    time = rig.sample_time[:, None] * np.arange(samples)
    q = place[:, None] + pace[:, None] * time + gain[:, None] * time**2 / 2
    v = pace[:, None] + gain[:, None] * time
    spring = rig.stiffness + column(gains.stiffness) + column(hand.stiffness)
    damper = rig.damping + column(gains.damping) + column(hand.damping)
    mass = rig.mass + column(gains.mass) + column(hand.mass)
    constant = rig.force_offset + mass * gain
    return constant[:, None] + spring[:, None] * q + damper[:, None] * v
