"""Logs of any length with known truth, for timing: one simulated period, repeated.

Played over and over, a force moves a device with friction the same way in every period but the
first ones, a shift in place apart. So one period repeated is what the simulator would give for the
whole length, hundreds of times faster.
"""

from __future__ import annotations

import numpy as np

from datasets_synthetic import Clock, Rig, multisine, simulate
from identification import Trajectory

MASS, DAMPING, DELAY = 3.0, 10.0, 1e-3
_STEP, _FRICTION, _OFFSET, _PEAK = 1e-3, 0.8, 0.1, 14.0
#: Samples of a period, 5 s; what is left of the start after _SETTLE of them is e^(-33).
_PERIOD = 5_000
_SETTLE = 2
#: Uneven steps are spread over this part of a step, each way.
_SPREAD = 0.2
#: Noise of a reading, m.
_NOISE = 5e-6


def long_log(samples: int, *, uneven: bool = False, seed: int = 0) -> Trajectory:
    """A log with friction, offset, one sample time of delay and white noise of the reading."""
    rng = np.random.default_rng(seed)
    rig = Rig(
        mass=MASS,
        damping=DAMPING,
        delay=DELAY,
        sample_time=_STEP,
        coulomb_friction=_FRICTION,
        force_offset=_OFFSET,
    )
    spread = _SPREAD * rng.uniform(-1, 1, _PERIOD) if uneven else np.zeros(_PERIOD)
    steps = _STEP * (1 + spread)
    wave = multisine(rig, _PERIOD, fade=_STEP)[0]
    force = _PEAK * (wave - wave.mean()) + _OFFSET
    turns = _SETTLE + 1
    clock = Clock(steps=tuple(steps.tolist())) if uneven else None
    path = simulate(rig, np.append(np.tile(force, turns), force[0]), clock=clock).position[0]
    period = path[-_PERIOD - 1 :]
    count = -(-samples // _PERIOD)
    shift = (period[-1] - period[0]) * np.arange(count)
    position = (period[None, :-1] + shift[:, None]).ravel()[:samples]
    time = np.concatenate(([0.0], np.cumsum(np.tile(steps, count))))[:samples]
    return Trajectory(
        time=time,
        force=np.tile(force, count)[:samples],
        position=position + _NOISE * rng.standard_normal(samples),
        source=f"{samples} samples",
    )
