"""Planned force as a table for the controller, and a picture of it and its predicted motion."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

from identification.planning.excitation import Excitation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Significant digits: a nanosecond in three minutes, and more than the force was rounded to.
_DIGITS = 12


def force_text(excitation: Excitation) -> str:
    """One row a sample; the force of each is held until the next, the first and last are zero."""
    rows = zip(excitation.time.tolist(), excitation.best.force.tolist(), strict=True)
    lines = (f"{time:.{_DIGITS}g},{force + 0.0:.{_DIGITS}g}" for time, force in rows)
    return "\n".join(("time,force", *lines)) + "\n"


def excitation_picture(excitation: Excitation) -> Figure:
    """Force, predicted position and predicted speed over time, each between its limits."""
    from identification.figure import NotebookFigure

    spec, best = excitation.spec, excitation.best
    length, force = ("m", "N") if spec.motion == "linear" else ("rad", "N·m")
    motion = best.prediction.motion
    figure = NotebookFigure(figsize=(11, 7), layout="constrained")
    rows = (
        (f"force, {force}", best.force, spec.force),
        (f"position, {length}", motion.position, spec.travel),
        (f"velocity, {length}/s", motion.velocity, spec.speed),
    )
    for axes, (label, column, limit) in zip(
        figure.subplots(len(rows), 1, sharex=True), rows, strict=True
    ):
        axes.plot(excitation.time, column, lw=1)
        for side in (-1, 1) if limit is not None else ():
            axes.axhline(side * (limit or 0.0), color="tab:red", lw=1, ls="--")
        axes.set_ylabel(label)
    figure.axes[1].set_title(
        "\n".join(
            f"{each.words}: up to {each.travel:.2g} {length}" for each in excitation.worst[1:]
        ),
        fontsize=8,
        loc="left",
    )
    figure.axes[-1].set_xlabel("time, s")
    figure.suptitle(
        f"{spec.name}, axis {spec.axis}: {best.family}, {best.description}; predicted 95 % "
        f"interval of mass ± {excitation.mass:.2g}, of damping ± {excitation.damping:.2g}"
    )
    return figure
