"""Pictures of a profile: where its elements lie in the stable region, and what they feel like.

One file: panels that are laid out together.
"""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tune.documents.effects import UNITS, format_number
from tune.documents.profile import Design, SafeProfile
from tune.presentation.boundaries import Boundaries
from tune.presentation.element_picture import HEIGHT, WIDTH, draw_element, shorten_name
from tune.presentation.labels import place_labels
from tune.presentation.slices import draw_region

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

#: Inches: least height of the first picture, and what each effect adds once they are many.
_FIRST, _EFFECT = 4.6, 0.28
#: Elements that are drawn one by one, at most: a picture of more would be read by nobody.
MOST_ELEMENTS = 12
#: Reasons that are no limit, in words.
_WHY = {"wanted": "as wanted", "not-perceptible": "not perceptible"}


def profile_picture(profile: Design, *, boundaries: Boundaries | None = None) -> Figure:
    """Stable region in (B, K) with every element in it, beside the perceived steps of each effect.

    The boundaries are exact: the largest stiffness for each damping, for the best estimate of the
    device, for the worst corner of its box, and for that corner with the whole margin kept.

    Args:
        profile: certified or not.
        boundaries: of the same profile; None computes them.
    """
    from identification import NotebookFigure

    figure = NotebookFigure(figsize=(WIDTH, overview_height(profile)))
    draw_overview(figure, profile, boundaries or Boundaries.of(profile))
    return figure


def profile_sheet(profile: Design, verdict: str | None = None) -> Figure:
    """The overview, then each element with its slice of the region, limits, step and impact.

    Of more than `MOST_ELEMENTS` that play something the first are drawn, and the picture says so.

    Args:
        profile: certified or not.
        verdict: for the title; None says what is proved of a certified profile, and of another
            which margin is asked for.
    """
    from identification import NotebookFigure

    names = shown_elements(profile)
    heights = [overview_height(profile), *(HEIGHT for _ in names)]
    figure = NotebookFigure(figsize=(WIDTH, sum(heights)))
    grid: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    parts: list[SubFigure] = list(grid[:, 0])
    boundaries = Boundaries.of(profile)
    for part, name in zip(parts[1:], names, strict=True):
        draw_element(part, profile, name, boundaries)
    draw_overview(parts[0], profile, boundaries, verdict=verdict, note=words_of_shown(profile))
    return figure


def shown_elements(profile: Design) -> list[str]:
    """Names of the elements that are drawn one by one: those that play something, the first."""
    return _playing(profile)[:MOST_ELEMENTS]


def words_of_shown(profile: Design) -> str:
    """Which elements are drawn one by one, in words; "" where all are."""
    playing = len(_playing(profile))
    if playing <= MOST_ELEMENTS:
        return ""
    return f"of {playing} elements the first {MOST_ELEMENTS} are drawn one by one"


def _playing(profile: Design) -> list[str]:
    """Names of the elements that play something."""
    return [
        name
        for name, element in profile.elements.items()
        if element.stiffness or element.damping or element.mass
    ]


def overview_height(profile: Design) -> float:
    """Inches that the overview needs for the effects it shows."""
    effects = sum(len(element.limited_by) for element in profile.elements.values())
    return max(_FIRST, 1.2 + _EFFECT * effects)


def draw_overview(
    figure: Figure | SubFigure,
    profile: Design,
    boundaries: Boundaries,
    *,
    verdict: str | None = None,
    note: str = "",
) -> None:
    """Draw region and perceived steps on a figure or a part of one, with a note below the title."""
    height = overview_height(profile)
    left, right = figure.subplots(
        1,
        2,
        gridspec_kw={
            "left": 0.075,
            "right": 0.985,
            "top": 1 - 0.85 / height,
            "bottom": 0.5 / height,
            "wspace": 0.16 + 0.018 * max(map(len, _effects(profile))),
        },
    )
    title = f"{shorten_name(profile.scene)} on {shorten_name(profile.device.name)}"
    figure.suptitle(
        f"{title}: {_verdict(profile) if verdict is None else verdict}",
        fontsize=11,
        y=1 - 0.12 / height,
    )
    if note:
        figure.text(0.5, 1 - 0.42 / height, note, fontsize=9, ha="center", va="bottom")
    _draw_steps(right, profile)
    _draw_places(left, profile, boundaries)


def _verdict(profile: Design) -> str:
    """What is proved of a certified profile; of another, the margin that is asked for."""
    late = profile.margin.extra_delay_samples
    margin = f"every gain up to {profile.margin.gain:g} with {late} extra sample{'s' * (late != 1)}"
    return f"safe for {margin}" if isinstance(profile, SafeProfile) else f"margin: {margin}"


def _draw_places(axes: Axes, profile: Design, boundaries: Boundaries) -> None:
    """The region for M = 0 and every element; open circles lie in planes of their own mass."""
    units, elements = UNITS[profile.device.motion], profile.elements
    dampings = [element.damping for element in elements.values()]
    draw_region(
        axes,
        boundaries,
        0.0,
        (min(0.0, *dampings), max(0.0, *dampings)),
        max(element.stiffness for element in elements.values()),
        units,
    )
    axes.set_title("region for M = 0; elements with a mass lie in other planes: open circles",
                   fontsize=8, loc="left", pad=16)  # fmt: skip
    labels: list[tuple[float, float, str]] = []
    for name, element in elements.items():
        if not (element.stiffness or element.damping or element.mass):
            continue
        fill = "none" if element.mass else "black"
        axes.scatter(
            [element.damping],
            [element.stiffness],
            s=25,
            facecolors=fill,
            edgecolors="k",
            clip_on=False,
            zorder=5,
        )
        note = shorten_name(name) + (
            f", M = {element.mass:.2g} {units['mass']}" if element.mass else ""
        )
        labels.append((element.damping, element.stiffness, note))
    left_out = len(labels) - len(place_labels(axes, labels))
    if left_out:
        named = "names have" if left_out > 1 else "name has"
        axes.set_title(f"{axes.get_title(loc='left')}\n{left_out} {named} no room",
                       fontsize=8, loc="left", pad=16)  # fmt: skip


def _effects(profile: Design) -> list[str]:
    """Element and effect of everything that a scene asked for."""
    return [
        f"{shorten_name(name)} {effect}"
        for name, element in profile.elements.items()
        for effect in element.limited_by
    ]


def _draw_steps(axes: Axes, profile: Design) -> None:
    units = UNITS[profile.device.motion]
    labels = _effects(profile)
    steps: list[float] = []
    words: list[str] = []
    for element in profile.elements.values():
        for effect, reason in element.limited_by.items():
            steps.append(element.perceived_steps.get(effect, 0.0))
            value: float = getattr(element, effect)
            size = f"{format_number(value)} {units[effect]}" if value else "not played"
            words.append(f" {size}, {_WHY.get(reason, f'limited by {reason}')}")
    places = np.arange(len(labels))[::-1]
    axes.barh(places, steps, color="tab:green", alpha=0.6)
    axes.axvline(1, color="k", lw=0.8, ls=":")
    axes.set_yticks(places, labels, fontsize=8)
    for place, step, word in zip(places, steps, words, strict=True):
        axes.text(step, float(place), word, va="center", fontsize=7)
    axes.set_xlim(0, 2.2 * max([*steps, 1.0]))
    axes.set_xlabel("steps a hand can tell apart")
