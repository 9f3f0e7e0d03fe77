"""Pictures of a profile: its elements in the stable region, what limits them, their answers."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.path import Path
from matplotlib.transforms import Bbox
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
    from matplotlib.text import Annotation


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
#: Offset of a label in points of a typographer, and how its text is aligned there.
_Place = tuple[float, float, Literal["left", "right"]]
_POINTS_PER_INCH = 72.0
#: Pixels between a label and what it keeps off.
_GAP = 4.0
#: Distances from the point that are tried, points of a typographer, and directions at each.
_DISTANCES = (6, 14, 24, 36, 50, 66, 84, 104)
_DIRECTIONS = ((1.0, 0.4), (1.0, -0.6), (-1.0, 0.4), (-1.0, -0.6), (0.3, 1.0),
               (0.3, -1.2), (-0.6, 1.0), (-0.6, -1.2), (0.8, 0.8), (-0.8, 0.8))  # fmt: skip
#: Farther than this, points, a line leads from the label to its point.
_FAR = 20


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
    """The region for M = 0 and every element; open circles lie in planes of their own mass."""
    units, elements = UNITS[profile.device.motion], profile.elements
    dampings = [element.damping for element in elements.values()]
    ends = (min(0.0, *dampings), max(0.0, *dampings))
    highest = max(element.stiffness for element in elements.values())
    draw_region(axes, boundaries, 0.0, ends, highest, units)
    title = "region for M = 0; open circles lie in planes of their own mass"
    set_small_title(axes, title)
    labels: list[tuple[float, float, str]] = []
    for name in _playing(profile):
        B, K, M = elements[name].damping, elements[name].stiffness, elements[name].mass
        fill = "none" if M else "black"
        axes.scatter([B], [K], s=25, facecolors=fill, edgecolors="k", clip_on=False, zorder=5)
        labels.append((B, K, short_name(name) + (f", M = {M:.2g} {units['mass']}" if M else "")))
    left_out = len(labels) - len(place_labels(axes, labels))
    if left_out:
        named = "names have" if left_out > 1 else "name has"
        set_small_title(axes, f"{title}\n{left_out} {named} no room")


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


def place_labels(axes: Axes, labels: Sequence[tuple[float, float, str]]) -> list[Annotation]:
    """Write a label near each point, off all other labels, points and lines, inside of the axes.

    Where the axes are must be settled: no layout may move them afterwards. Labels are (x, y, text)
    in the data of the axes; those for which there is no room are neither written nor returned.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = axes.get_figure(root=True)
    assert figure is not None
    renderer = FigureCanvasAgg(figure).get_renderer()
    places = [axes.transData.transform((x, y)) for x, y, _ in labels]
    points = [Bbox.from_extents(x - 3, y - 3, x + 3, y + 3) for x, y in places]
    room = _Room(frame=axes.get_window_extent(), points=points)
    pixels = figure.dpi / _POINTS_PER_INCH
    found: list[Annotation] = []
    for x, y, text in labels:
        label = axes.annotate(text, (x, y), xytext=(0, 0), textcoords="offset points", fontsize=8)
        across, up = (float(each) for each in axes.transData.transform((x, y)))
        place = room.place(label.get_window_extent(renderer), (across, up), pixels)
        if place is None:
            label.remove()
            continue
        across, up, where = place
        label.set_horizontalalignment(where)
        label.set_position((across, up))
        if max(abs(across), abs(up)) > _FAR:
            arrow = {"arrowstyle": "-", "color": "0.6", "lw": 0.6}
            end, unit = (across, up), "offset points"
            axes.annotate("", (x, y), xytext=end, textcoords=unit, arrowprops=arrow)
        found.append(label)
    return found


@dataclass(slots=True, kw_only=True)
class _Room:
    """What is taken inside of axes, in pixels: points, labels, and lines from one to the other."""

    frame: Bbox
    points: list[Bbox]
    labels: list[Bbox] = field(default_factory=list[Bbox])
    lines: list[Path] = field(default_factory=list[Path])

    def place(self, size: Bbox, point: tuple[float, float], pixels: float) -> _Place | None:
        """Take the first place that is free for a label of a size that begins at a point.

        Places whose line crosses no label are sought first; None where no place is free. Pixels are
        those of a point of a typographer.
        """
        for crossing in (False, True):
            for distance, (right, above) in product(_DISTANCES, _DIRECTIONS):
                across, up = distance * right, distance * above
                where = "left" if right > 0 else "right"
                left = across * pixels - (size.width if where == "right" else 0.0)
                box = size.translated(left, up * pixels)
                far = max(abs(across), abs(up)) > _FAR
                end = (point[0] + across * pixels, point[1] + up * pixels)
                line = Path([point, end]) if far else None
                if self._free(box.padded(_GAP), line, crossing=crossing):
                    self.labels.append(box)
                    self.lines += [line] if line else []
                    return across, up, where
        return None

    def _free(self, box: Bbox, line: Path | None, *, crossing: bool) -> bool:
        """Whether a label and its line are free; with ``crossing``, lines may cross labels."""
        inside = self.frame.x0 <= box.x0 and box.x1 <= self.frame.x1
        inside = inside and self.frame.y0 <= box.y0 and box.y1 <= self.frame.y1
        if not inside or any(box.overlaps(other) for other in (*self.points, *self.labels)):
            return False
        if crossing:
            return True
        crossed = line and any(line.intersects_bbox(each, filled=False) for each in self.labels)
        return not crossed and not any(
            each.intersects_bbox(box, filled=False) for each in self.lines
        )
