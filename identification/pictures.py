"""A picture of how well mass, damping and friction explain a log."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from identification.device import Device
from identification.estimators import least_squares
from identification.estimators.model import Model
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def fit_picture(trajectory: Trajectory, device: Device) -> Figure:
    """Position, and the force applied beside the force that the device's numbers explain.

    Both forces went through the filter of the least-squares estimator. What is left between them is
    what the model does not know.

    Args:
        trajectory: a log of the device.
        device: as identified; nothing is fitted here.
    """
    from matplotlib.figure import Figure

    model = Model(coulomb=device.coulomb_friction.value > 0, offset=True)
    table = least_squares.prepare(trajectory, model, device.delay.value)
    values = [getattr(device, name).value for name in model.parameters]
    applied = table.force(device.delay.value)
    explained = table.columns @ np.array(values)
    time = trajectory.time[table.first :][: applied.size]
    length, force = ("m", "N") if device.motion == "linear" else ("rad", "N·m")
    figure = Figure(figsize=(11, 6), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    top.plot(trajectory.time, trajectory.position, lw=1)
    top.set_ylabel(f"position, {length}")
    middle.plot(time, applied, lw=2, color="0.7", label="applied")
    middle.plot(time, explained, lw=1, color="tab:green", label="m·q̈ + b·q̇ + Fc·sign(q̇) + f0")
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
