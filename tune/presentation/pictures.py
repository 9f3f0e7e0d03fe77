"""Pictures of a profile: its elements in the stable region, what limits them, their answers."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification import legend_above
from tune.documents.profile import Design, ElementProfile, SafeProfile
from tune.documents.scene import UNITS, format_number
from tune.loop.loop import filters_of
from tune.loop.state_space import Corner, SampledLoop, corners_of, exponential
from tune.presentation.limits import (
    BLUE,
    Boundaries,
    draw_effect_uses,
    draw_limits,
    draw_region,
    draw_slice,
    set_small_title,
    short_name,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


FloatArray = NDArray[np.float64]

#: Samples followed, at least and at most; half periods or time constants that are looked at.
_FEWEST, _MOST, _PERIODS = 50, 3000, 5.0
#: Corners of the box that are followed beside the best estimate.
_CORNERS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Handle, rigid mass and force of the law inside of an element, SI, shape (devices, samples).

    Time has shape (samples,). The first device is the best estimate, the others are corners of its
    box. The sampled loop is followed with its delay and filters; the law is cut at the peak force,
    and a one-sided element only pushes. Friction, quantisation and hands are left out.
    """

    time: FloatArray
    position: FloatArray
    speed: FloatArray
    force: FloatArray


def step_response(design: Design, element: ElementProfile, force: float) -> Response:
    """Motion from rest under a constant force, N, where the encoder reads; the law is two-sided."""
    return _followed(design, element, pushed=force, speed=0.0, one_sided=False)


def impact_response(design: Design, element: ElementProfile) -> Response:
    """Motion of a free device that enters the element at the speed of its motion."""
    one_sided = element.one_sided and not element.fades
    return _followed(design, element, pushed=0.0, speed=element.motion.speed, one_sided=one_sided)


def _followed(
    design: Design, element: ElementProfile, *, pushed: float, speed: float, one_sided: bool
) -> Response:
    filters, device, sample_time = filters_of(design.loop), design.device, design.loop.sample_time
    values = (element.stiffness, element.damping, element.mass)
    limit, count = element.force_level or math.inf, _samples(design, element)

    def follow(place: Corner) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and force of one device from sample to sample."""
        loop = SampledLoop.of(place, filters, values)
        plant, free, command = loop.plant, loop.free, loop.command
        # The law enters in one place: what acts differs from what is free by column times command.
        column = (loop.pushed - free) @ command / (command @ command)
        outside = _outside(loop, place) * pushed
        state = np.zeros(len(loop.read))
        state[plant.speed] = speed
        if speed:
            # An element with a spring is entered where its law passes zero.
            before = element.damping / element.stiffness if element.stiffness else 0.0
            state[0] = -speed * before
            step = speed * place.sample_time
            state[loop.remembered] = loop.moving(loop.read @ state[:, None], step)[:, 0]
        rows = np.empty((count, 3))
        for row in range(count):
            force = float(np.clip(command @ state, -limit, limit))
            position = float(loop.read @ state)
            if one_sided:
                force = min(force, 0.0)
            rows[row] = position, state[plant.speed], force
            state = free @ state + column * force + outside
        return rows[:, 0], rows[:, 1], rows[:, 2]

    best = Corner(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=sample_time,
        delay=design.loop.extra_delay_samples * sample_time,
        position_stiffness=device.slope_at_zero,
        current_lag=0.0 if device.current_lag is None else device.current_lag.value,
        modes=tuple(
            (each.frequency_hz.value, each.damping_ratio.value, each.at_encoder)
            for each in device.modes
        ),
    )
    box = corners_of(device, device.simultaneous_box())
    places = [best, *box[:: max(1, len(box) // _CORNERS)][:_CORNERS]]
    position, rate, force = (np.stack(each) for each in zip(*map(follow, places), strict=True))
    time = np.arange(count, dtype=np.float64) * sample_time
    return Response(time=time, position=position, speed=rate, force=force)


def _samples(design: Design, element: ElementProfile) -> int:
    """Samples in which what the element does can be seen."""
    mass = max(design.device.mass.value + element.mass, 0.1 * design.device.mass.value)
    loss = max(design.device.damping.value + element.damping, 1e-3 * mass)
    span = mass / loss
    if element.stiffness > 0:
        span = math.pi * math.sqrt(mass / element.stiffness)
    return int(np.clip(_PERIODS * span / design.loop.sample_time, _FEWEST, _MOST))


def _outside(loop: SampledLoop, place: Corner) -> FloatArray:
    """What a constant force of 1 N where the encoder reads adds to the state in a sample."""
    plant = loop.plant
    size = len(plant.drive)
    drive = np.zeros(size)
    drive[plant.speed : 2 * plant.speed] = plant.read[: plant.speed] / place.mass
    augmented = np.zeros((size + 1, size + 1))
    augmented[:size, :size], augmented[:size, size] = plant.motion, drive
    added = np.zeros(len(loop.read))
    added[:size] = exponential(augmented * place.sample_time)[:size, size]
    return added


#: Inches of the picture of an element.
_WIDTH, _HEIGHT = 11.0, 6.2
#: Where the four pictures stand on their figure, in parts of it and of a picture.
_GRID = {"left": 0.095, "right": 0.925, "top": 0.85, "bottom": 0.085,
         "hspace": 0.55, "wspace": 0.42}  # fmt: skip
#: Of the continuous force, the step that is drawn; where no limit is stated, N.
_STEP, _WITHOUT_LIMIT = 0.1, 1.0
#: Inches: least height of the first picture, and what each effect adds once they are many.
_FIRST, _EFFECT = 4.6, 0.36
#: Elements that are drawn one by one, at most: a picture of more would be read by nobody.
_MOST_ELEMENTS = 12
#: Markers of the elements in the region, one after the other.
_MARKERS = "os^Dv<>pPX*h"
#: Names in one column of the legend, about.
_COLUMN = 6


def profile_picture(profile: Design, *, boundaries: Boundaries | None = None) -> Figure:
    """A bar an effect, the part of the limit that binds it, beside the stable region in (B, K).

    The boundaries are exact: the largest stiffness for each damping, for the best estimate of the
    device, for the worst corner of its box, and for that corner with the whole margin kept.

    Args:
        profile: certified or not.
        boundaries: of this profile; None computes them.
    """
    from identification import NotebookFigure

    figure = NotebookFigure(figsize=(_WIDTH, _overview_height(profile)))
    _draw_overview(figure, profile, boundaries or Boundaries.of(profile))
    return figure


def region_picture(
    profile: Design, *, boundaries: Boundaries | None = None, ax: Axes | None = None
) -> Figure:
    """Stable region in (B, K) without mass, with every element of a profile in it.

    Args:
        profile: certified or not.
        boundaries: of this profile; None computes them.
        ax: where to draw it; None makes a figure. Names are set where the axes are now.
    """
    from identification import NotebookFigure

    figure = NotebookFigure(figsize=(8.0, 4.2)) if ax is None else ax.get_figure(root=True)
    assert figure is not None
    if ax is None:
        ax = figure.add_axes((0.1, 0.12, 0.88, 0.73))
    _draw_places(ax, profile, boundaries or Boundaries.of(profile))
    return figure


def profile_sheet(profile: Design, verdict: str | None = None) -> Figure:
    """The overview, then each element with its slice of the region, limits, step and impact.

    Of more than twelve that play something the first are drawn, and the picture says so.

    Args:
        profile: certified or not.
        verdict: for the title; None says what is proved of a certified profile, and of another
            which margin is asked for.
    """
    from identification import NotebookFigure

    names = shown_elements(profile)
    heights = [_overview_height(profile), *[_HEIGHT] * len(names)]
    figure = NotebookFigure(figsize=(_WIDTH, sum(heights)))
    grid: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    parts: list[SubFigure] = list(grid[:, 0])
    boundaries = Boundaries.of(profile)
    for part, name in zip(parts[1:], names, strict=True):
        _draw_element(part, profile, name, boundaries)
    _draw_overview(parts[0], profile, boundaries, verdict=verdict, note=words_of_shown(profile))
    return figure


def shown_elements(profile: Design) -> list[str]:
    """Elements that are drawn one by one: the first of those that play something."""
    return _playing(profile)[:_MOST_ELEMENTS]


def words_of_shown(profile: Design) -> str:
    """Which elements are drawn one by one, in words; "" where all are."""
    many = len(_playing(profile))
    words = f"of {many} elements the first {_MOST_ELEMENTS} are drawn one by one"
    return words if many > _MOST_ELEMENTS else ""


def _playing(profile: Design) -> list[str]:
    elements = profile.elements.items()
    return [name for name, each in elements if each.stiffness or each.damping or each.mass]


def _overview_height(profile: Design) -> float:
    effects = sum(len(element.limited_by) for element in profile.elements.values())
    return max(_FIRST, 1.2 + _EFFECT * effects)


def _draw_overview(
    figure: Figure | SubFigure,
    profile: Design,
    boundaries: Boundaries,
    *,
    verdict: str | None = None,
    note: str = "",
) -> None:
    """Region and perceived steps on a figure or a part of one, with a note below the title."""
    height = _overview_height(profile)
    grid = {"left": 0.075, "right": 0.985, "top": 1 - 0.85 / height, "bottom": 0.5 / height}
    grid |= {"left": 0.165, "wspace": 0.2, "width_ratios": (1.25, 1.0)}
    left, right = figure.subplots(1, 2, gridspec_kw=grid)
    title = f"{short_name(profile.scene)} on {short_name(profile.device.name)}"
    title += f": {_verdict(profile) if verdict is None else verdict}"
    figure.suptitle(title, fontsize=11, y=1 - 0.12 / height)
    if note:
        figure.text(0.5, 1 - 0.42 / height, note, fontsize=9, ha="center", va="bottom")
    draw_effect_uses(left, profile)
    _draw_places(right, profile, boundaries)


def _verdict(profile: Design) -> str:
    """What is proved of a certified profile; of another, the margin that is asked for."""
    late = profile.margin.extra_delay_samples
    margin = f"every gain up to {profile.margin.gain:g} with {late} extra sample{'s' * (late != 1)}"
    return f"safe for {margin}" if isinstance(profile, SafeProfile) else f"margin: {margin}"


def _draw_places(axes: Axes, profile: Design, boundaries: Boundaries) -> None:
    """The region for M = 0 and every element; open marks lie in planes of their own mass."""
    units, elements = UNITS[profile.device.motion], profile.elements
    dampings = [element.damping for element in elements.values()]
    ends = (min(0.0, *dampings), max(0.0, *dampings))
    highest = max(element.stiffness for element in elements.values())
    draw_region(axes, boundaries, 0.0, ends, highest, units)
    set_small_title(axes, "region for M = 0; open marks lie in planes of their own mass")
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


def element_picture(design: Design, name: str, *, boundaries: Boundaries | None = None) -> Figure:
    """Region slice at the element's own mass, what limits it, and its step and impact responses."""
    from identification import NotebookFigure

    figure = NotebookFigure(figsize=(_WIDTH, _HEIGHT))
    _draw_element(figure, design, name, boundaries or Boundaries.of(design))
    return figure


def _draw_element(
    figure: Figure | SubFigure, design: Design, name: str, boundaries: Boundaries
) -> None:
    units, element = UNITS[design.device.motion], design.elements[name]
    (region, limits), (step, impact) = figure.subplots(2, 2, gridspec_kw=_GRID)
    draw_slice(region, boundaries, element, units)
    draw_limits(limits, design, name, units)
    _draw_step(step, design, element, units)
    _draw_impact(impact, design, element, units)
    sizes = ", ".join(
        f"{symbol} = {format_number(getattr(element, effect))} {units[effect]}"
        for symbol, effect in (("K", "stiffness"), ("B", "damping"), ("M", "mass"))
        if getattr(element, effect)
    )
    figure.suptitle(f"{short_name(name)}: {sizes or 'nothing'}", fontsize=11, y=0.99)


def _draw_step(axes: Axes, design: Design, element: ElementProfile, units: dict[str, str]) -> None:
    """Position under a constant force, or speed where nothing brings the handle back."""
    limit = design.device.force_limit
    force = _STEP * limit.continuous if limit and limit.continuous else _WITHOUT_LIMIT
    found = step_response(design, element, force)
    sprung = element.stiffness > 0
    _draw_devices(axes, found, found.position if sprung else found.speed)
    axes.set_ylabel(f"position, {units['length']}" if sprung else f"speed, {units['speed']}")
    set_small_title(axes, f"step: {force:.3g} {units['force']} on the handle; friction left out")


def _draw_impact(
    axes: Axes, design: Design, element: ElementProfile, units: dict[str, str]
) -> None:
    """Force of the element on a free device that enters it, and its speed."""
    found, limit = impact_response(design, element), design.device.force_limit
    _draw_devices(axes, found, found.force)
    if limit is not None:
        most = max(float(np.max(np.abs(found.force))), 1e-12)
        for level, words, dashes in (
            (limit.continuous, "continuous force", ":"),
            (limit.peak, "peak force", "--"),
        ):
            if level < 3 * most:
                axes.axhline(-level, color="k", lw=0.9, ls=dashes)
                axes.axhline(level, color="k", lw=0.9, ls=dashes, label=words)
    axes.set_ylabel(f"force, {units['force']}")
    beside = axes.twinx()
    beside.plot(found.time, found.speed[0], color=BLUE, lw=1)
    beside.set_ylabel(f"speed, {units['speed']}", color=BLUE)
    beside.tick_params(axis="y", labelcolor=BLUE, labelsize=8)
    legend_above(axes)
    title = f"impact at {element.motion.speed:g} {units['speed']}, no hand"
    set_small_title(axes, title + (", pushes only" if element.one_sided else ""))


def _draw_devices(axes: Axes, found: Response, values: np.ndarray) -> None:
    """Corners of the box light, the best estimate dark."""
    for row, line in enumerate(values[1:]):
        label = None if row else "corners of the box"
        axes.plot(found.time, line, color="#56B4E9", lw=0.7, label=label)
    axes.plot(found.time, values[0], color="k", lw=1.3, label="best estimate")
    axes.axhline(0, color="0.7", lw=0.5, zorder=0)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("time, s")
    legend_above(axes)
