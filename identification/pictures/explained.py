"""The force of a log beside the force that a device's numbers explain, both filtered alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.device.device import Device
from identification.estimators.estimate import Gravity, Model
from identification.estimators.least_squares import prepare
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
    """Force applied and force explained, through the filter of the least-squares estimator.

    Attributes:
        time: s, shape (rows,).
        applied: N, shape (rows,).
        explained: N, shape (rows,).
    """

    time: FloatArray
    applied: FloatArray
    explained: FloatArray

    @property
    def left(self) -> FloatArray:
        """What the model does not know, N, shape (rows,)."""
        return self.applied - self.explained

    @property
    def share(self) -> float:
        """Rms of what is left, part of the rms of the force."""
        return float(np.std(self.left) / np.std(self.applied))


def explained_force(
    trajectory: Trajectory, device: Device, delay: float | None = None
) -> Explained:
    """What the numbers of a device make of a log; nothing is fitted.

    Args:
        trajectory: a log of the device.
        device: as identified.
        delay: s, with which its numbers were found; None takes the device's.
    """
    late = device.delay.value if delay is None else delay
    model = _model(device)
    table = prepare(trajectory, model, late)
    values = [_value(device, name) for name in model.parameters]
    applied = table.force(late)
    return Explained(
        time=trajectory.time[table.first :][: applied.size],
        applied=applied,
        explained=np.array(values) @ table.columns,
    )


def units_of(device: Device) -> tuple[str, str]:
    """Units of length and force; both of each where nobody stated the motion."""
    if "motion" in device.missing:
        return "m (rad)", "N (N·m)"
    return ("m", "N") if device.motion == "linear" else ("rad", "N·m")


def _model(device: Device) -> Model:
    """The terms a device file states."""
    rubs = device.coulomb_friction.value > 0
    gravity: Gravity = "none"
    if device.gravity is not None:
        gravity = "pendulum"
    elif device.position_stiffness is not None:
        gravity = "proportional"
    directional = rubs and device.damping_by_direction is not None
    return Model(coulomb=rubs, offset=True, directional=directional, gravity=gravity)


def _value(device: Device, parameter: str) -> float:
    """A parameter of the model as the file states it."""
    damping, weight = device.damping_by_direction, device.gravity
    if parameter == "damping_asymmetry" and damping is not None:
        return (damping.forward.value - damping.backward.value) / 2
    if parameter.startswith("gravity_") and weight is not None:
        return weight.sine.value if parameter == "gravity_sine" else weight.cosine.value
    return float(getattr(device, parameter).value)
