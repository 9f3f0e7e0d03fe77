"""Figures that notebooks show as pictures when they are the last expression of a cell."""

from __future__ import annotations

from io import BytesIO
from typing import Any

from matplotlib.figure import Figure


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
