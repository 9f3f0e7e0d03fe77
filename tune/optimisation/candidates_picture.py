"""Candidates as one picture: the perceived steps of every effect, a bar for each candidate."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tune.optimisation.candidates import CandidateEffect

#: Of the height of an effect that its bars take up.
_FILLED = 0.8


def candidates_picture(rows: Sequence[CandidateEffect]) -> Figure:
    """Perceived steps of each effect with each candidate, their values beside the bars.

    Args:
        rows: of `compare_candidates`, at least one.
    """
    from identification import NotebookFigure

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
    axes.set_yticks([-k for k in range(len(effects))], [" ".join(pair) for pair in effects])
    axes.set_xlabel("steps a hand can tell apart")
    axes.legend(fontsize=7)
    return figure
