"""A picture of how well mass, damping and friction explain a log."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from identification.device.device import Device
from identification.estimators import least_squares
from identification.estimators.model import Gravity, Model
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def fit_picture(trajectory: Trajectory, device: Device, *, delay: float | None = None) -> Figure:
    """Position, and the force applied beside the force that the device's numbers explain.

    Both forces went through the filter of the least-squares estimator. What is left between them is
    what the model does not know.

    Args:
        trajectory: a log of the device.
        device: as identified; nothing is fitted here.
        delay: s, with which its numbers were found; None takes the device's, which is at least one
            sample.
    """
    from identification.figure import NotebookFigure

    late = device.delay.value if delay is None else delay
    model = _model(device)
    table = least_squares.prepare(trajectory, model, late)
    values = [_value(device, name) for name in model.parameters]
    applied = table.force(late)
    explained = np.array(values) @ table.columns
    time = trajectory.time[table.first :][: applied.size]
    length, force = ("m", "N") if device.motion == "linear" else ("rad", "N·m")
    if "motion" in device.missing:
        length, force = "m (rad)", "N (N·m)"
    figure = NotebookFigure(figsize=(11, 6), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    top.plot(trajectory.time, trajectory.position, lw=1)
    top.set_ylabel(f"position, {length}")
    middle.plot(time, applied, lw=2, color="0.7", label="applied")
    middle.plot(time, explained, lw=1, color="tab:green", label="explained by the model")
    middle.set_ylabel(f"force, {force}")
    middle.legend(loc="upper right", fontsize=8)
    bottom.plot(time, applied - explained, lw=0.8, color="tab:orange")
    bottom.set_ylabel(f"unexplained, {force}")
    bottom.set_xlabel("time, s")
    figure.suptitle(
        f"{device.name}: m = {device.mass.value:.4g}, b = {device.damping.value:.4g}, "
        f"Fc = {device.coulomb_friction.value:.3g}; unexplained "
        f"{np.std(applied - explained) / np.std(applied):.1%} of the force"
    )
    return figure


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
