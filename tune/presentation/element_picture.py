"""One element of a profile: its place in the stable region, its limits, its step and its impact."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from identification import legend_above
from tune.documents.effects import UNITS, format_number
from tune.documents.profile import Design, ElementProfile
from tune.presentation.boundaries import Boundaries
from tune.presentation.limits import Use, uses_of
from tune.presentation.responses import Response, impact_response, step_response
from tune.presentation.slices import draw_slice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

#: Inches.
WIDTH, HEIGHT = 11.0, 6.2
#: Where the four pictures stand on their figure, in parts of it and of a picture.
_GRID = {
    "left": 0.095,
    "right": 0.925,
    "top": 0.85,
    "bottom": 0.085,
    "hspace": 0.55,
    "wspace": 0.42,
}
#: Letters of a name.
_SHORT = 28
#: Of the continuous force, the step that is drawn; where no limit is stated, N.
_STEP, _WITHOUT_LIMIT = 0.1, 1.0
#: A part of a limit beyond which more than rounding is used.
_BEYOND = 1.001
#: Bars are drawn up to this many times a limit.
_LONGEST = 1.25


def element_picture(design: Design, name: str, *, boundaries: Boundaries | None = None) -> Figure:
    """Region slice at the element's own mass, what limits it, and its step and impact responses.

    Args:
        design: a profile, or what was judged.
        name: of the element.
        boundaries: of the same design; None computes them.
    """
    from identification import NotebookFigure

    figure = NotebookFigure(figsize=(WIDTH, HEIGHT))
    draw_element(figure, design, name, boundaries or Boundaries.of(design))
    return figure


def draw_element(
    figure: Figure | SubFigure, design: Design, name: str, boundaries: Boundaries
) -> None:
    """Draw the picture of one element on a figure or a part of one."""
    units, element = UNITS[design.device.motion], design.elements[name]
    (region, limits), (step, impact) = figure.subplots(2, 2, gridspec_kw=_GRID)
    draw_slice(region, boundaries, element, units)
    _draw_limits(limits, design, name, units)
    _draw_step(step, design, element, units)
    _draw_impact(impact, design, element, units)
    figure.suptitle(f"{shorten_name(name)}: {_sizes(element, units)}", fontsize=11, y=0.99)


def shorten_name(name: str) -> str:
    """A name as a picture has room for it, without what matplotlib would take for a formula."""
    plain = name.replace("$", r"\$")
    return plain if len(plain) <= _SHORT else f"{plain[: _SHORT - 1]}…"


def _sizes(element: ElementProfile, units: dict[str, str]) -> str:
    acting = (
        f"{symbol} = {format_number(getattr(element, effect))} {units[effect]}"
        for symbol, effect in (("K", "stiffness"), ("B", "damping"), ("M", "mass"))
        if getattr(element, effect)
    )
    return ", ".join(acting) or "nothing"


def _draw_limits(axes: Axes, design: Design, name: str, units: dict[str, str]) -> None:
    """A bar a limit, full where it is used up; those that bind are dark."""
    uses = uses_of(design, name, units)
    places = -np.arange(len(uses))
    axes.barh(
        places,
        [min(use.part, _LONGEST) for use in uses],
        height=0.62,
        color=[_color(use) for use in uses],
    )
    axes.axvline(1, color="k", lw=1)
    for place, use in zip(places, uses, strict=True):
        binds = f": limits {' and '.join(use.binds)}" if use.binds else ""
        axes.text(0.01, float(place), use.words + binds, va="center", fontsize=7)
    axes.set_yticks(places, [use.limit for use in uses], fontsize=8)
    axes.set_xlim(0, _LONGEST)
    axes.set_xticks([0, 0.5, 1], ["0", "half", "used up"], fontsize=7)
    others = ", ".join(
        f"{effect} {reason}"
        for effect, reason in element_reasons(design, name).items()
        if reason in {"wanted", "range", "stability", "not-perceptible"}
    )
    axes.set_title(
        "part of each limit that is used" + (f"\nbesides: {others}" if others else ""),
        fontsize=8,
        loc="left",
    )


def _color(use: Use) -> str:
    """Color of a bar: beyond its limit, at what binds, or neither."""
    if use.part > _BEYOND:
        return "tab:red"
    return "#74c476" if use.binds else "#d3e6d3"


def element_reasons(design: Design, name: str) -> dict[str, str]:
    """What limits each effect of an element."""
    return {effect: str(reason) for effect, reason in design.elements[name].limited_by.items()}


def _draw_step(axes: Axes, design: Design, element: ElementProfile, units: dict[str, str]) -> None:
    """Position under a constant force, or speed where nothing brings the handle back."""
    limit = design.device.force_limit
    force = _STEP * limit.continuous if limit and limit.continuous else _WITHOUT_LIMIT
    found = step_response(design, element, force)
    sprung = element.stiffness > 0
    _draw_devices(axes, found, found.position if sprung else found.speed)
    what = f"position, {units['length']}" if sprung else f"speed, {units['speed']}"
    axes.set_ylabel(what)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("time, s")
    axes.set_title(
        f"step: {force:.3g} {units['force']} on the handle; friction left out",
        fontsize=8,
        loc="left",
        pad=16,
    )


def _draw_impact(
    axes: Axes, design: Design, element: ElementProfile, units: dict[str, str]
) -> None:
    """Force of the element on a free device that enters it, and its speed."""
    found = impact_response(design, element)
    limit = design.device.force_limit
    _draw_devices(axes, found, found.force)
    if limit is not None:
        most = max(float(np.max(np.abs(found.force))), 1e-12)
        for level, words, dashes in (
            (limit.continuous, "continuous force", ":"),
            (limit.peak, "peak force", "--"),
        ):
            if level < 3 * most:
                for side in (-1, 1):
                    axes.axhline(
                        side * level,
                        color="tab:red",
                        lw=0.8,
                        ls=dashes,
                        label=words if side > 0 else None,
                    )
    axes.set_ylabel(f"force, {units['force']}")
    axes.tick_params(labelsize=8)
    axes.set_xlabel("time, s")
    beside = axes.twinx()
    beside.plot(found.time, found.speed[0], color="tab:blue", lw=1)
    beside.set_ylabel(f"speed, {units['speed']}", color="tab:blue")
    beside.tick_params(axis="y", labelcolor="tab:blue", labelsize=8)
    legend_above(axes)
    axes.set_title(
        f"impact at {element.motion.speed:g} {units['speed']}, no hand"
        + (", pushes only" if element.one_sided else ""),
        fontsize=8,
        loc="left",
        pad=16,
    )


def _draw_devices(axes: Axes, found: Response, values: np.ndarray) -> None:
    """Corners of the box light, the best estimate dark."""
    for row, line in enumerate(values[1:]):
        axes.plot(
            found.time, line, color="#9ecae1", lw=0.7, label=None if row else "corners of the box"
        )
    axes.plot(found.time, values[0], color="k", lw=1.3, label="best estimate")
    axes.axhline(0, color="0.7", lw=0.5, zorder=0)
    legend_above(axes)
