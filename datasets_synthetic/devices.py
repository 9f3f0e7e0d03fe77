"""Devices as simulation truth: the values of a Device, without their intervals."""

from __future__ import annotations

import numpy as np

from datasets_synthetic.rig import Rig
from datasets_synthetic.vibration import Vibration
from identification import Device, load_device


def rig_of(device: Device) -> Rig:
    """One rig whose truth is the value of every quantity the device states.

    A device without encoder resolution is read exactly; one without force limit has no limit.
    """
    resolution, limit = device.encoder_resolution, device.force_limit
    return Rig(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=device.sample_time.value,
        coulomb_friction=device.coulomb_friction.value,
        force_offset=device.force_offset.value,
        delay=device.delay.value,
        stiffness=0.0 if device.position_stiffness is None else device.position_stiffness.value,
        gravity_sine=0.0 if device.gravity is None else device.gravity.sine.value,
        gravity_cosine=0.0 if device.gravity is None else device.gravity.cosine.value,
        encoder_resolution=0.0 if resolution is None else resolution.value,
        force_limit=np.inf if limit is None else limit.peak,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        modes=tuple(
            Vibration(
                frequency_hz=mode.frequency_hz.value,
                damping_ratio=mode.damping_ratio.value,
                at_encoder=mode.at_encoder,
                at_handle=mode.at_handle,
            )
            for mode in device.modes
        ),
        name=device.name,
        axis=device.axis,
        motion=device.motion,
    )


def named_rig(name: str) -> Rig:
    """The rig of a named device or device file. Raises InvalidInputError."""
    return rig_of(load_device(name))
