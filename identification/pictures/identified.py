"""Logs and the device they told, as one sheet: fit, residual, friction, intervals."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from identification.device.device import Device
from identification.fitting.one_log import LogFit
from identification.pictures.explained import explained_force, units_of
from identification.pictures.fit import draw_over_time, fit_title
from identification.pictures.friction import draw_friction
from identification.pictures.intervals import SYMBOLS, draw_intervals, knowledge
from identification.pictures.residual import draw_correlation, draw_spectrum
from identification.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

#: Inches.
_WIDTH, _OF_A_LOG, _LINE, _AXIS = 11.0, 6.5, 0.2, 0.9


def identified_picture(
    device: Device, fits: Sequence[LogFit], *, before: Device | None = None
) -> Figure:
    """Each log with fit, residual, its spectrum and correlation, and friction; then intervals.

    Args:
        device: as identified from the logs.
        fits: of the logs, at least one.
        before: the device as it was known before, to compare with; None for none.
    """
    from identification.figure import NotebookFigure

    lines = knowledge(device, fits, before)
    heights = [*(_OF_A_LOG for _ in fits), _AXIS + _LINE * len(lines)]
    figure = NotebookFigure(figsize=(_WIDTH, sum(heights)), layout="constrained")
    grid: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    parts: list[SubFigure] = list(grid[:, 0])
    for part, fit in zip(parts, fits, strict=False):
        _draw_log(part, device, fit)
    length, force = units_of(device)
    slow = f"{force}·s/{length}"
    units = {
        "mass": "kg" if length == "m" else "kg·m²" if length == "rad" else "kg (kg·m²)",
        "damping": "N·s/m (N·m·s/rad)" if "(" in length else slow,
        "coulomb_friction": force,
        "force_offset": force,
        "delay": "ms",
    }
    draw_intervals(parts[-1].subplots(1, len(SYMBOLS)), lines, units)
    return figure


def log_picture(trajectory: Trajectory) -> Figure:
    """Position and force of a log of which no device can be told."""
    from identification.figure import NotebookFigure

    figure = NotebookFigure(figsize=(_WIDTH, 4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(trajectory.time, trajectory.position, lw=1)
    above.set_ylabel("position, as logged")
    below.plot(trajectory.time, trajectory.force, lw=1, color="0.5")
    below.set_ylabel("force, as logged")
    below.set_xlabel("time, s")
    figure.suptitle(f"{trajectory.source}: no device can be told from it")
    return figure


def _draw_log(part: SubFigure, device: Device, fit: LogFit) -> None:
    """Over time on the left; spectrum, correlation and friction on the right."""
    known = explained_force(fit.trajectory, device, fit.estimate.delay)
    _, force = units_of(device)
    halves: Any = part.subfigures(1, 2, width_ratios=(1.5, 1))
    left, right = halves
    draw_over_time(left.subplots(3, 1, sharex=True), fit.trajectory, device, known)
    spectrum, correlation, friction = right.subplots(3, 1)
    draw_spectrum(spectrum, known, force)
    draw_correlation(correlation, known, fit.estimate)
    draw_friction(friction, fit.trajectory, device, fit.estimate, force)
    part.suptitle(f"{fit.trajectory.source}, {fit.method}. {fit_title(device, known)}", fontsize=10)
