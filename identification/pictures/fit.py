"""A picture of how well mass, damping and friction explain a log, over time."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from identification.device.device import Device
from identification.pictures.explained import Explained, explained_force, units_of
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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

    known = explained_force(trajectory, device, delay)
    figure = NotebookFigure(figsize=(11, 6), layout="constrained")
    draw_over_time(figure.subplots(3, 1, sharex=True), trajectory, device, known)
    figure.suptitle(fit_title(device, known))
    return figure


def fit_title(device: Device, known: Explained) -> str:
    """Name, mass, damping and friction of a device, and what they leave of the force."""
    return (
        f"{device.name}: m = {device.mass.value:.4g}, b = {device.damping.value:.4g}, "
        f"Fc = {device.coulomb_friction.value:.3g}; unexplained {known.share:.1%} of the force"
    )


def draw_over_time(
    axes: Sequence[Axes], trajectory: Trajectory, device: Device, known: Explained
) -> None:
    """Position, force and what is left of it, on three axes that share their time."""
    from identification.figure import legend_above

    length, force = units_of(device)
    top, middle, bottom = axes
    top.plot(trajectory.time, trajectory.position, lw=1)
    top.set_ylabel(f"position, {length}")
    middle.plot(known.time, known.applied, lw=2, color="0.7", label="applied")
    middle.plot(
        known.time, known.explained, lw=1, color="tab:green", label="explained by the model"
    )
    middle.set_ylabel(f"force, {force}")
    legend_above(middle)
    bottom.plot(known.time, known.left, lw=0.8, color="tab:orange")
    bottom.set_ylabel(f"unexplained, {force}")
    bottom.set_xlabel("time, s")
