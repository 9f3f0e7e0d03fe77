"""The ten families on which estimators are measured.

The device is one like HomeRehab, 3 kg and 10 N·s/m at 1 kHz and one sample of delay, unless another
shows the imperfection better. Excitations are short and small, and noise is large beside them, so
that 95 % intervals of mass and damping are between about 0.01 and 10 %.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from datasets_synthetic import Clock, Faults, Hand, Rig, Servo, fit_to_limits, multisine, simulate
from identification import Hardware
from tests.simulated.family import Drive, Family

_COUNT = 2e-5  # m
#: Of the size of a count: quantisation is white, of variance count²/12.
_NOISE = Faults(position_noise=_COUNT)
_DEVICE = Rig(
    mass=3.0,
    damping=10.0,
    sample_time=0.001,
    delay=0.001,
    encoder_resolution=_COUNT,
    force_limit=28.0,
    name="handle",
)
_COARSE = replace(_DEVICE, encoder_resolution=5e-5)
_FINE = replace(_DEVICE, encoder_resolution=6e-6)
_RUBBING = replace(_DEVICE, coulomb_friction=0.8)
_DIRECTIONAL = replace(_RUBBING, damping_asymmetry=2.0, force_offset=0.2)
_SLOW = replace(_DEVICE, sample_time=0.011, delay=0.0)
_PROMPT = replace(_DEVICE, delay=0.0004)
#: 0.3 kg hung 0.5 m from an axle: 1.5 N·m and a little across, its zero being off the vertical.
_ARM = Rig(
    mass=0.05,
    damping=0.3,
    sample_time=0.001,
    delay=0.001,
    force_offset=0.2,
    gravity_sine=1.5,
    gravity_cosine=0.4,
    encoder_resolution=1e-3,
    force_limit=5.0,
    name="arm",
    axis="elbow",
    motion="rotary",
)
#: The servo: N/m, N·s/m and Hz; on 3 kg 5.8 Hz fast and damped by 0.6.
_PROPORTIONAL, _DERIVATIVE, _CUTOFF = 4000.0, 120.0, 100.0
#: The arm: torque of the slow swing, N·m, its frequency, Hz, and peak of the multisine, N·m.
_SWING, _SWING_RATE, _SHAKE = 1.2, 0.5, 1.5


def _open_loop(rig: Rig, samples: int, travel: float) -> Drive:
    """A multisine that moves the device through ``travel`` (half range, m) in open loop."""
    found = fit_to_limits(rig, multisine(rig, samples), travel=travel, force=rig.force_limit)
    return Drive(force=found.force, start=float(found.start[0]))


def _following(rig: Rig, samples: int, travel: float) -> Drive:
    """A servo on the path which a multisine would make the device take without friction.

    That path is slow enough to show damping and fast enough to show mass. There is no feed-forward:
    all force comes from the error, and so from the noise as well.
    """
    played = _open_loop(replace(rig, coulomb_friction=0.0), samples, travel)
    exact = replace(rig, coulomb_friction=0.0, encoder_resolution=0.0)
    path = simulate(exact, played.force, position=played.start).position
    servo = Servo(
        reference=path, stiffness=_PROPORTIONAL, damping=_DERIVATIVE, velocity_filter_hz=_CUTOFF
    )
    return Drive(force=np.zeros_like(path), start=played.start, servo=servo)


def _swung(samples: int) -> Drive:
    """A slow wide swing of the arm and a multisine on top, from where its gravity is nil.

    Wide, for sine, cosine and offset to differ; the offset is held against, as a log of a device
    that stays in place must.
    """
    time = float(_ARM.sample_time[0]) * np.arange(samples)
    swing = _SWING * np.sin(2 * np.pi * _SWING_RATE * time)
    force = swing + _SHAKE * multisine(_ARM, samples) + _ARM.force_offset[:, None]
    rest = -np.arctan2(_ARM.gravity_cosine[0], _ARM.gravity_sine[0])
    return Drive(force=force, start=float(rest))


def _once(drive: Callable[[], Drive]) -> Callable[[], Drive]:
    """The same drive, computed at the first use."""
    return lru_cache(maxsize=1)(drive)


_ALL = (
    Family(
        name="open-loop-white",
        rig=_DEVICE,
        drive=_once(lambda: _open_loop(_DEVICE, 4000, 0.005)),
        faults=_NOISE,
    ),
    # The start differs within a count; a vibration of a twentieth of one is all the noise.
    Family(
        name="encoder-only",
        rig=_COARSE,
        drive=_once(lambda: _open_loop(_COARSE, 4000, 0.015)),
        faults=Faults(position_noise=2.5e-6, start_spread=2.5e-5),
        hardware=Hardware.model_validate({"name": "handle", "encoder_resolution": 5e-5}),
    ),
    Family(
        name="closed-loop-measurement-noise",
        rig=_DEVICE,
        drive=_once(lambda: _following(_DEVICE, 4000, 0.03)),
        faults=Faults(position_noise=3e-5),
    ),
    # Neither the force's noise nor the tremor is logged.
    Family(
        name="closed-loop-force-noise",
        rig=_FINE,
        drive=_once(lambda: _following(_FINE, 4000, 0.03)),
        faults=Faults(position_noise=3e-6, force_noise=0.2),
        hand=Hand(tremor=0.2),
    ),
    Family(
        name="coulomb",
        rig=_RUBBING,
        drive=_once(lambda: _open_loop(_RUBBING, 4000, 0.01)),
        faults=_NOISE,
    ),
    Family(
        name="directional-friction",
        rig=_DIRECTIONAL,
        drive=_once(lambda: _open_loop(_DIRECTIONAL, 4000, 0.04)),
        faults=_NOISE,
    ),
    Family(
        name="alternating-steps",
        rig=_SLOW,
        drive=_once(lambda: _open_loop(_SLOW, 910, 0.02)),
        faults=_NOISE,
        clock=Clock(steps=(0.010, 0.012)),
        hardware=Hardware.model_validate({"name": "handle", "delay": 0.0}),
    ),
    Family(
        name="dropped-samples",
        rig=_DEVICE,
        drive=_once(lambda: _open_loop(_DEVICE, 4000, 0.01)),
        faults=_NOISE,
        clock=Clock(dropped=0.03),
    ),
    Family(
        name="fractional-delay",
        rig=_PROMPT,
        drive=_once(lambda: _open_loop(_PROMPT, 4000, 0.01)),
        faults=_NOISE,
    ),
    Family(
        name="offset-gravity",
        rig=_ARM,
        drive=_once(lambda: _swung(6000)),
        faults=Faults(position_noise=1e-3),
    ),
)

#: Every family, in the order to show them.
FAMILIES: Mapping[str, Family] = MappingProxyType({each.name: each for each in _ALL})
