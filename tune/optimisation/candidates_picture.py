"""Candidates as one picture: the perceived steps of every effect, a bar for each candidate."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification import Motion
    from tune.optimisation.candidates import CandidateEffect

#: Of the height of an effect that its bars take up.
_FILLED = 0.8
#: Times the longest bar that the axis is, for the sizes beside the bars.
_ROOM = 1.15


def candidates_picture(rows: Sequence[CandidateEffect], motion: Motion) -> Figure:
    """Perceived steps of each effect with each candidate, their values beside the bars.

    Args:
        rows: of `compare_candidates`, at least one.
        motion: of the device, which gives the units.
    """
    from identification import NotebookFigure, legend_above
    from tune.documents.effects import UNITS

    units = UNITS[motion]
    names = list(dict.fromkeys(row.candidate for row in rows))
    effects = list(dict.fromkeys((row.element, row.effect) for row in rows))
    figure = NotebookFigure(figsize=(8, 0.6 + 0.9 * len(effects)), layout="constrained")
    axes = figure.subplots()
    height = _FILLED / len(names)
    for place, name in enumerate(names):
        mine = [row for row in rows if row.candidate == name]
        lines = np.array([effects.index((row.element, row.effect)) for row in mine])
        steps = [row.steps.value for row in mine]
        at = -lines + _FILLED / 2 - height * (place + 0.5)
        axes.barh(at, steps, height=0.9 * height, label=name)
        for row, line, step in zip(mine, at.tolist(), steps, strict=True):
            axes.text(step, line, f" {row.value:.4g}", va="center", fontsize=6)
    axes.axvline(1, color="k", lw=0.8, ls=":")
    names_of_rows = [f"{element} {effect}, {units[effect]}" for element, effect in effects]
    axes.set_yticks([-k for k in range(len(effects))], names_of_rows, fontsize=8)
    axes.set_xlim(0, _ROOM * max(1.0, *(row.steps.value for row in rows)))
    axes.set_xlabel("steps a hand can tell apart; their sizes beside the bars")
    legend_above(axes)
    return figure
