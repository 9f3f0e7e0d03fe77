"""Error against time, both logarithmic, one panel a case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.section import Cell, Section, at_the_front

#: Panels a row, and the size of one, inches.
_ACROSS, _WIDTH, _HEIGHT = 3, 4.4, 3.4
_OURS = "#c2410c"
#: Seen by people who do not tell red from green; in the order of the peers.
_PEERS = ("#1d4ed8", "#0f766e", "#6d28d9", "#475569", "#0891b2", "#65a30d", "#be185d")
_MARKS = ("s", "^", "v", "D", "P", "X", "<", ">", "p", "h", "*", "d", "8", "H", "1", "2")


def draw(section: Section, path: Path, cases: list[str] | None = None) -> None:
    """Write the picture of a section, of all its cases or of some."""
    cases = cases or section.cases
    methods = list(dict.fromkeys(cell.method for cell in section.cells))
    across = min(_ACROSS, len(cases))
    down = -(-len(cases) // across)
    figure: Any = Figure(figsize=(_WIDTH * across, _HEIGHT * down + 0.12 * len(methods)), dpi=110)
    figure.set_layout_engine("constrained")
    panels = np.atleast_1d(figure.subplots(down, across, squeeze=False)).ravel()
    for axes, case in zip(panels, cases, strict=False):
        _panel(axes, section, section.of(case), methods)
        axes.set_title(case, fontsize=9)
    for axes in panels[len(cases) :]:
        axes.set_axis_off()
    for axes in panels[0 : len(panels) : across]:
        axes.set_ylabel(section.error, fontsize=8)
    for axes in panels[max(0, len(cases) - across) : len(cases)]:
        axes.set_xlabel("time of the processor, s", fontsize=8)
    handles = {
        label: handle
        for axes in panels
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    shown = [method for method in methods if method in handles]
    figure.legend(
        [handles[method] for method in shown],
        shown,
        loc="outside lower center",
        ncols=4,
        fontsize=7.5,
        frameon=False,
    )
    figure.savefig(path)


def _panel(axes: Any, section: Section, cells: list[Cell], methods: list[str]) -> None:
    peers = [m for m in methods if not any(c.ours for c in section.cells if c.method == m)]
    ours = [m for m in methods if m not in peers]
    for cell in cells:
        if cell.seconds is None or cell.error is None:
            continue
        group = ours if cell.ours else peers
        index = group.index(cell.method)
        colour = _OURS if cell.ours else _PEERS[index % len(_PEERS)]
        axes.loglog(
            cell.seconds,
            max(cell.error, section.floor),
            linestyle="none",
            marker="o" if len(ours) == 1 and cell.ours else _MARKS[index % len(_MARKS)],
            markersize=7 if cell.ours else 5.5,
            color=colour,
            markerfacecolor="none" if cell.unsafe else colour,
            label=cell.method,
        )
    front: list[Cell] = []
    for cell in at_the_front(cells, section.floor):
        if not front or (cell.error or 0.0) < (front[-1].error or 0.0):
            front.append(cell)
    if len(front) > 1:
        axes.plot(
            [cell.seconds or np.nan for cell in front],
            [max(cell.error or 0.0, section.floor) for cell in front],
            color="#9ca3af",
            linewidth=0.8,
            zorder=0,
        )
    axes.grid(visible=True, which="major", color="#e5e7eb", linewidth=0.6)
    axes.tick_params(which="both", labelsize=7)
    axes.tick_params(axis="x", which="minor", labelbottom=False)
    low, high = axes.get_ylim()
    if high < 10 * low:
        axes.set_ylim(low / 2, high * 2)
