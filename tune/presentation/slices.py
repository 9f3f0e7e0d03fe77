"""Stable region in the plane of damping and stiffness, cut at the mass that an element plays."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification import legend_above
from tune.documents.effects import format_number
from tune.documents.profile import ElementProfile
from tune.presentation.boundaries import Boundaries

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

#: Dampings at which the boundaries are computed.
_PLACES = 160
#: What is drawn goes this much beyond what is played or may be.
_BEYOND = 1.15


def draw_region(
    axes: Axes,
    boundaries: Boundaries,
    mass: float,
    damping: tuple[float, float],
    stiffness: float,
    units: dict[str, str],
) -> None:
    """Three boundaries at one mass, on axes that grow as the square root.

    Args:
        axes: to draw on.
        boundaries: of the device.
        mass: of the plane, kg.
        damping: least and largest that have to be seen, N·s/m.
        stiffness: largest that has to be seen, N/m.
        units: of the effects.
    """
    least, most = _range(boundaries, mass, damping)
    grid = _spread(least, most)
    best = boundaries.at_best(grid, mass)
    worst = boundaries.at_worst(grid, mass)
    safe = boundaries.with_margin(grid, mass)
    axes.set_xscale("function", functions=(_root, _square))
    axes.set_yscale("function", functions=(_root, _square))
    axes.fill_between(grid, best, color="0.9", lw=0, label="stable, best estimate")
    axes.plot(grid, worst, color="tab:orange", lw=1.2, label="worst corner of the box")
    axes.fill_between(
        grid, safe, color="tab:green", alpha=0.35, lw=0, label="with the whole margin"
    )
    top = _BEYOND * max(float(np.max(safe)), stiffness) or float(np.max(best))
    axes.set_xlim(least, most)
    axes.set_ylim(0, top if top > 0 else 1.0)
    axes.set_xlabel(f"virtual damping B, {units['damping']}")
    axes.set_ylabel(f"virtual stiffness K, {units['stiffness']}")
    axes.tick_params(labelsize=7)
    axes.locator_params(nbins=6)
    axes.ticklabel_format(style="plain", useOffset=False)
    legend_above(axes)


def draw_slice(
    axes: Axes, boundaries: Boundaries, element: ElementProfile, units: dict[str, str]
) -> None:
    """The plane of one element, its place, and how far from it the boundary of the margin is."""
    K, B, M = element.stiffness, element.damping, element.mass
    draw_region(axes, boundaries, M, (min(B, 0.0), max(B, 0.0)), K, units)
    to_stiffness = float(boundaries.with_margin(np.array(B), M))
    to_damping = boundaries.damping_with_margin(K, B, M)
    words: list[str] = []
    top = float(axes.get_ylim()[1])
    if to_stiffness > K:
        axes.plot([B, B], [K, min(to_stiffness, top)], color="k", lw=0.9, ls=":")
        words.append(f"K up to {format_number(to_stiffness)} {units['stiffness']}")
    if to_damping > B:
        end = min(to_damping, float(axes.get_xlim()[1]))
        axes.plot([B, end], [K, K], color="k", lw=0.9, ls=":", clip_on=False)
        words.append(f"B up to {format_number(to_damping)} {units['damping']}")
    axes.plot([B], [K], "ko", ms=6, clip_on=False, zorder=5)
    left = " or ".join(words) or "nothing"
    axes.set_title(
        f"plane M = {M:.3g} {units['mass']}, the element alone\n"
        f"left to the whole margin, dotted: {left}",
        fontsize=8,
        loc="left",
        pad=16,
    )


def _range(
    boundaries: Boundaries, mass: float, damping: tuple[float, float]
) -> tuple[float, float]:
    """Dampings from the least that is stable, or zero, to the largest with the whole margin."""
    most = boundaries.damping_with_margin(0.0, damping[1], mass)
    return _BEYOND * damping[0], _BEYOND * max(most, damping[1], 0.1 * boundaries.damping)


def _spread(least: float, most: float) -> FloatArray:
    """Places that are even on the axes."""
    return _square(np.linspace(_root(np.array(least)), _root(np.array(most)), _PLACES))


def _root(values: FloatArray) -> FloatArray:
    return np.sign(values) * np.sqrt(np.abs(values))


def _square(values: FloatArray) -> FloatArray:
    return np.sign(values) * np.square(values)
