"""Figures that notebooks show as pictures, and legends that hide nothing of them."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class NotebookFigure(Figure):
    """A matplotlib figure made without pyplot that knows its own picture.

    Notebooks draw a plain Figure only after pyplot was loaded; without, they print its name.
    """

    def _repr_png_(self) -> bytes:
        """The picture as a PNG file: the name is IPython's protocol."""
        stream = BytesIO()
        picture: Any = self  # matplotlib types its keyword arguments only in part
        picture.savefig(stream, format="png")
        return stream.getvalue()


def legend_above(axes: Axes) -> None:
    """A legend of one line above the axes, where it hides nothing."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
        ncols=4,
        fontsize=7,
        frameon=False,
        columnspacing=1.2,
        handlelength=1.5,
    )
