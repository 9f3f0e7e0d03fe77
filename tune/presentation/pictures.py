"""Pictures of a profile: its elements in the stable region, and what limits them."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from identification import Device, counted, draw_directions, legend_above
from tune.documents.profile import Design, SafeProfile
from tune.documents.scene import UNITS
from tune.presentation.limits import (
    draw_effect_uses,
    draw_limits,
    draw_region,
    draw_slice,
    set_small_title,
    short_name,
)
from tune.presentation.tables import plain_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

#: Inches of a sheet and of an element on it; of one of an element's two pictures alone.
_WIDTH, _HEIGHT, _SMALL = 11.0, 3.2, (4.6, 2.8)
#: Where the two pictures of an element stand on a sheet, in parts of it and of a picture.
_GRID = {"left": 0.095, "right": 0.985, "top": 0.76, "bottom": 0.14, "wspace": 0.36}
#: Inches: least height of the first picture, and what each effect adds once they are many.
_FIRST, _EFFECT = 4.6, 0.36
#: Elements that are drawn one by one, at most: a picture of more would be read by nobody.
_MOST_ELEMENTS = 12
#: Markers of the elements in the region, one after the other.
_MARKERS = "os^Dv<>pPX*h"
#: Names in one column of the legend, about; letters of a title.
_COLUMN, _TITLE = 6, 90


def profile_picture(profile: Design) -> Figure:
    """A bar an effect, the part of the limit that binds it, beside the stable region in (B, K).

    The boundaries are exact: the largest stiffness for each damping, for the best estimate of the
    device, for the worst corner of its box, and for that corner with the whole margin kept. Of
    elements that are alike the first is drawn. The profile is certified or not.
    """
    from identification import NotebookFigure

    profile = profile.one_of_each()
    figure = NotebookFigure(figsize=(_WIDTH, _overview_height(profile)))
    _draw_overview(figure, profile)
    return figure


def region_picture(profile: Design, *, ax: Axes | None = None) -> Figure:
    """Stable region in (B, K) without mass, with every element of a profile in it.

    Args:
        profile: certified or not.
        ax: where to draw it; None makes a figure. Names are set where the axes are now.
    """
    from identification import NotebookFigure

    if ax is None:
        ax = NotebookFigure(figsize=(8.0, 4.2)).add_axes((0.1, 0.12, 0.88, 0.73))
    figure = ax.get_figure(root=True)
    assert figure is not None
    _draw_places(ax, profile.one_of_each())
    return figure


def profile_sheet(profile: Design, verdict: str | None = None) -> Figure:
    """The overview, then each element with its slice of the region and its limits.

    Of more than twelve that play something the first are drawn, and the picture says so. Of several
    axes the end is what is felt of mass and damping in every direction, alone and in each element.

    Args:
        profile: certified or not.
        verdict: for the title; None says what is proved of a certified profile, and of another
            which margin is asked for.
    """
    from identification import NotebookFigure

    profile = profile.one_of_each()
    names = shown_elements(profile)
    felt = _felt_devices(profile, names)
    heights = [_overview_height(profile), *[_HEIGHT] * (len(names) + bool(felt))]
    figure = NotebookFigure(figsize=(_WIDTH, sum(heights)))
    grid: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    parts: list[SubFigure] = list(grid[:, 0])
    if felt:
        last = parts.pop()
        draw_directions(last, felt)
        last.subplots_adjust(bottom=0.2, top=0.8)
    for part, name in zip(parts[1:], names, strict=True):
        left, right = part.subplots(1, 2, gridspec_kw=_GRID)
        draw_slice(left, profile, name)
        draw_limits(right, profile, name)
        part.suptitle(short_name(sizes_in_words(profile, name), _TITLE), fontsize=11, y=0.985)
    _draw_overview(parts[0], profile, verdict=verdict, note=words_of_shown(profile))
    return figure


def _felt_devices(profile: Design, names: list[str]) -> dict[str, Device]:
    """A device of several axes alone and with what each element adds to it; {} of one axis."""
    device = profile.device
    if device.axes is None or device.poses is None:
        return {}
    found, eye = {"alone": device}, np.eye(len(device.axes))
    for name in names:
        element = profile.elements[name]
        if element.one_sided or not (element.mass or element.damping):
            continue
        poses = tuple(
            pose.model_copy(
                update={
                    which: (np.array(getattr(pose, which)) + getattr(element, which) * eye).tolist()
                    for which in ("mass", "damping")
                }
            )
            for pose in device.poses
        )
        found[short_name(name)] = device.model_copy(update={"poses": poses})
    return found


def shown_elements(profile: Design) -> list[str]:
    """Elements that are drawn one by one: the first of those that play something."""
    return _playing(profile)[:_MOST_ELEMENTS]


def words_of_shown(profile: Design) -> str:
    """Which elements are drawn one by one, in words; "" where all are."""
    many = len(_playing(profile))
    words = f"of {many} elements the first {_MOST_ELEMENTS} are drawn one by one"
    return words if many > _MOST_ELEMENTS else ""


def _playing(profile: Design) -> list[str]:
    return [name for name, element in profile.elements.items() if element.acting]


def _overview_height(profile: Design) -> float:
    effects = sum(len(element.limited_by) for element in profile.elements.values())
    return max(_FIRST, 1.2 + _EFFECT * effects)


def _draw_overview(
    figure: Figure | SubFigure, profile: Design, *, verdict: str | None = None, note: str = ""
) -> None:
    """Region and perceived steps on a figure or a part of one, with a note below the title."""
    height = _overview_height(profile)
    grid = {"left": 0.165, "right": 0.985, "top": 1 - 0.85 / height, "bottom": 0.5 / height}
    grid |= {"wspace": 0.2, "width_ratios": (1.25, 1.0)}
    left, right = figure.subplots(1, 2, gridspec_kw=grid)
    title = f"{short_name(profile.scene)} on {short_name(profile.device.name)}"
    title += f": {_verdict(profile) if verdict is None else verdict}"
    figure.suptitle(title, fontsize=11, y=1 - 0.12 / height)
    if note:
        figure.text(0.5, 1 - 0.42 / height, note, fontsize=9, ha="center", va="bottom")
    draw_effect_uses(left, profile)
    _draw_places(right, profile)


def _verdict(profile: Design) -> str:
    """What is proved of a certified profile; of another, the margin that is asked for."""
    late = counted(profile.margin.extra_delay_samples, "extra sample")
    margin = f"every gain up to {profile.margin.gain:g} with {late}"
    return f"safe for {margin}" if isinstance(profile, SafeProfile) else f"margin: {margin}"


def _draw_places(axes: Axes, profile: Design) -> None:
    """The region for M = 0 and every element; open marks lie in planes of their own mass."""
    units, elements = UNITS[profile.device.motion], profile.elements
    dampings = [element.damping for element in elements.values()]
    ends = (min(0.0, *dampings), max(0.0, *dampings))
    highest = max(element.stiffness for element in elements.values())
    draw_region(axes, profile, 0.0, ends, highest)
    legend_above(axes)
    words = "region for M = 0; open marks lie in planes of their own mass"
    set_small_title(axes, words, pad=16)  # above the legend
    told = axes.get_legend()
    points = [
        axes.scatter(
            [elements[name].damping],
            [elements[name].stiffness],
            s=32,
            marker=marker,
            facecolors="none" if elements[name].mass else "black",
            edgecolors="k",
            clip_on=False,
            zorder=5,
            label=short_name(name)
            + (f", M = {elements[name].mass:.2g} {units['mass']}" if elements[name].mass else ""),
        )
        for name, marker in zip(_playing(profile), cycle(_MARKERS), strict=False)
    ]
    if points:
        many = 1 + (len(points) > _COLUMN)
        own = axes.legend(handles=points, loc="best", fontsize=7, framealpha=0.6, ncols=many)
        own.set_zorder(4)  # below the marks, which it may have no room beside
    if told is not None:
        axes.add_artist(told)  # what the boundaries are stays told above


def element_pictures(design: Design, name: str) -> tuple[Figure, Figure]:
    """The plane of one element, and a bar a limit of it."""
    from identification import NotebookFigure

    plane, limits = NotebookFigure(figsize=_SMALL), NotebookFigure(figsize=_SMALL)
    draw_slice(plane.add_axes((0.17, 0.17, 0.8, 0.67)), design, name)
    draw_limits(limits.add_axes((0.27, 0.1, 0.71, 0.74)), design, name)
    return plane, limits


def sizes_in_words(design: Design, name: str) -> str:
    """An element and its effects with their units."""
    units, element = UNITS[design.device.motion], design.elements[name]
    sizes = ", ".join(
        f"{symbol} = {plain_number(getattr(element, effect))} {units[effect]}"
        for symbol, effect in (("K", "stiffness"), ("B", "damping"), ("M", "mass"))
        if getattr(element, effect)
    )
    return f"{name}: {sizes or 'nothing'}"
