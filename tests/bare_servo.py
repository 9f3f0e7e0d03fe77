"""A motor under a position controller, with friction that no sign of the velocity describes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from identification import Trajectory

Array = NDArray[np.float64]

INERTIA, STEP, SAMPLES, SMALL_STEPS = 2.5e-5, 1e-3, 4000, 10
#: Corner of the controller's velocity, Hz.
CORNER = 60.0


def path(highest: float, size: float, seed: int) -> Array:
    """Thirty sines from 0.2 Hz to the highest, whose rms is ``size``, rad."""
    generator = np.random.default_rng(seed)
    time = np.arange(SAMPLES) * STEP
    whole = np.round(np.geomspace(0.2, highest, 30) * SAMPLES * STEP) / (SAMPLES * STEP)
    wave = sum(np.sin(2 * np.pi * each * time + generator.uniform(0, 2 * np.pi)) for each in whole)
    return np.asarray(size * wave / np.std(wave), dtype=np.float64)


def servo_log(
    reference: Array,
    *,
    coulomb: float,
    viscous: float,
    bent: float,
    over: float,
    saturating: bool,
    stiffness: float,
    noise: float,
    push: float = 0.0,
    lag: float = 0.0,
    told: bool = False,
) -> Trajectory:
    """A log, one sample late."""
    generator = np.random.default_rng(1)
    pushes = (push * generator.standard_normal(SAMPLES)).tolist()
    errors = (noise * generator.standard_normal(SAMPLES)).tolist()
    damping, part = 1.4 * math.sqrt(stiffness * INERTIA), 1 - math.exp(-2 * math.pi * CORNER * STEP)
    step, speed, place, torque = STEP / SMALL_STEPS, 0.0, 0.0, 0.0
    sent, last, smooth = 0.0, 0.0, 0.0
    force, position = np.zeros(SAMPLES), np.zeros(SAMPLES)
    for row, (wanted, error, pushed) in enumerate(
        zip(reference.tolist(), errors, pushes, strict=True)
    ):
        seen = place + error
        smooth += part * ((seen - last) / STEP - smooth)
        last = seen
        position[row], acting = seen, sent + pushed
        force[row] = sent = stiffness * (wanted - seen) - damping * smooth
        for _ in range(SMALL_STEPS):
            torque = acting if lag == 0 else torque + step / lag * (acting - torque)
            faded = math.exp(-abs(speed) / over)
            rubbing = coulomb + bent * (1 - faded if saturating else faded)
            holding = coulomb + (0.0 if saturating else bent)
            if speed == 0 and abs(torque) <= holding:
                continue
            sense = math.copysign(1.0, speed or torque)
            later = speed + step * (torque - sense * rubbing - viscous * speed) / INERTIA
            speed = 0.0 if speed * later < 0 and abs(torque) <= holding else later
            place += step * speed
    return Trajectory(
        time=np.arange(SAMPLES, dtype=np.float64) * STEP,
        force=force,
        position=position,
        reference=reference if told else None,
        motion="rotary",
    )
