"""Labels beside points of a picture, placed so that none falls on another."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal

from matplotlib.transforms import Bbox

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

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
)
#: Farther than this, points, a line leads from the label to its point.
_FAR = 20


def place_labels(
    axes: Axes, labels: Sequence[tuple[float, float, str]], *, fontsize: float = 8
) -> list[Annotation]:
    """Write a label near each point, off every other label and every point, inside of the axes.

    Where the axes are must be settled: no layout may move them afterwards.

    Args:
        axes: drawn and scaled as it will stay.
        labels: (x, y, text) in the data of the axes.
        fontsize: points.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = axes.get_figure(root=True)
    assert figure is not None
    renderer = FigureCanvasAgg(figure).get_renderer()
    frame = axes.get_window_extent()
    taken = [_around(axes, x, y) for x, y, _ in labels]
    found: list[Annotation] = []
    for x, y, text in labels:
        label = axes.annotate(
            text, (x, y), xytext=(6, 3), textcoords="offset points", fontsize=fontsize
        )
        for across, up, where in _places():
            label.set_horizontalalignment(where)
            label.set_position((across, up))
            box = label.get_window_extent(renderer).padded(_GAP)
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1
            inside = inside and frame.y0 <= box.y0 and box.y1 <= frame.y1
            if inside and not any(box.overlaps(other) for other in taken):
                break
        taken.append(label.get_window_extent(renderer))
        if max(abs(value) for value in label.get_position()) > _FAR:
            axes.annotate(
                "",
                (x, y),
                xytext=label.get_position(),
                textcoords="offset points",
                arrowprops={"arrowstyle": "-", "color": "0.6", "lw": 0.6},
            )
        found.append(label)
    return found


def _around(axes: Axes, x: float, y: float) -> Bbox:
    """The pixels that a point takes up."""
    across, up = (float(each) for each in axes.transData.transform((x, y)))
    return Bbox.from_extents(across - 3, up - 3, across + 3, up + 3)


def _places() -> Iterator[tuple[float, float, Literal["left", "right"]]]:
    """Offsets that are tried, the nearest first, and how the text is aligned there."""
    for distance in _DISTANCES:
        for across, up in _DIRECTIONS:
            yield distance * across, distance * up, "left" if across > 0 else "right"
