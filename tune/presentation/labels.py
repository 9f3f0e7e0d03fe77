"""Labels beside points of a picture, placed so that none falls on another."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from matplotlib.path import Path
from matplotlib.transforms import Bbox

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

#: Offset of a label in points of a typographer, and how its text is aligned there.
Place = tuple[float, float, Literal["left", "right"]]
_POINTS_PER_INCH = 72.0
#: Pixels between a label and what it keeps off.
_GAP = 4.0
#: Distances from the point that are tried, points of a typographer, and directions at each.
_DISTANCES = (6, 14, 24, 36, 50, 66, 84, 104)
_DIRECTIONS = (
    (1.0, 0.4),
    (1.0, -0.6),
    (-1.0, 0.4),
    (-1.0, -0.6),
    (0.3, 1.0),
    (0.3, -1.2),
    (-0.6, 1.0),
    (-0.6, -1.2),
    (0.8, 0.8),
    (-0.8, 0.8),
)
#: Farther than this, points, a line leads from the label to its point.
_FAR = 20


def place_labels(
    axes: Axes, labels: Sequence[tuple[float, float, str]], *, fontsize: float = 8
) -> list[Annotation]:
    """Write a label near each point, off all other labels, points and lines, inside of the axes.

    Where the axes are must be settled: no layout may move them afterwards. A label for which there
    is no room is not written.

    Args:
        axes: drawn and scaled as it will stay.
        labels: (x, y, text) in the data of the axes.
        fontsize: points.

    Returns:
        The labels that are written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = axes.get_figure(root=True)
    assert figure is not None
    renderer = FigureCanvasAgg(figure).get_renderer()
    points = [_around(axes, x, y) for x, y, _ in labels]
    room = _Room(frame=axes.get_window_extent(), points=points)
    pixels = figure.dpi / _POINTS_PER_INCH
    found: list[Annotation] = []
    for x, y, text in labels:
        label = axes.annotate(
            text, (x, y), xytext=(0, 0), textcoords="offset points", fontsize=fontsize
        )
        across, up = (float(each) for each in axes.transData.transform((x, y)))
        place = room.place(label.get_window_extent(renderer), (across, up), pixels)
        if place is None:
            label.remove()
            continue
        across, up, where = place
        label.set_horizontalalignment(where)
        label.set_position((across, up))
        if max(abs(across), abs(up)) > _FAR:
            axes.annotate(
                "",
                (x, y),
                xytext=(across, up),
                textcoords="offset points",
                arrowprops={"arrowstyle": "-", "color": "0.6", "lw": 0.6},
            )
        found.append(label)
    return found


@dataclass(slots=True, kw_only=True)
class _Room:
    """What is taken inside of axes, in pixels: points, labels, and lines from one to the other."""

    frame: Bbox
    points: list[Bbox]
    labels: list[Bbox] = field(default_factory=list[Bbox])
    lines: list[Path] = field(default_factory=list[Path])

    def place(self, size: Bbox, point: tuple[float, float], pixels: float) -> Place | None:
        """Take the first place that is free for a label; None where none is.

        Places whose line crosses no label are sought first.

        Args:
            size: of the label, its text beginning at the point.
            point: that it belongs to.
            pixels: to a point of a typographer.
        """
        for crossing in (False, True):
            for across, up, where in _places():
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


def _around(axes: Axes, x: float, y: float) -> Bbox:
    """The pixels that a point takes up."""
    across, up = (float(each) for each in axes.transData.transform((x, y)))
    return Bbox.from_extents(across - 3, up - 3, across + 3, up + 3)


def _places() -> Iterator[Place]:
    """Offsets that are tried, the nearest first, and how the text is aligned there."""
    for distance in _DISTANCES:
        for across, up in _DIRECTIONS:
            yield distance * across, distance * up, "left" if across > 0 else "right"
