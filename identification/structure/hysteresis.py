"""Hysteresis by Prandtl-Ishlinskii stop operators: springs that yield at a limit.

A spring that yields once it is stretched by its width is the stop operator of Prandtl and
Ishlinskii (Visintin, Differential Models of Hysteresis, 1994, chapter III); a sum of some of them
follows cables, bearings before they slide, and other friction that remembers where it came from.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def stop_operators(position: FloatArray, widths: Sequence[float]) -> FloatArray:
    """Stretch of each spring over its width, -1 to 1, from rest at the first sample.

    Args:
        position: m, shape (n,).
        widths: m, positive; how far each spring stretches before it yields.

    Returns:
        Shape (widths, n).
    """
    moves = np.diff(position).tolist()
    courses: list[FloatArray] = []
    for width in widths:
        stretch, course = 0.0, [0.0]
        for move in moves:
            stretch = min(max(stretch + move, -width), width)
            course.append(stretch)
        courses.append(np.array(course) / width)
    return np.stack(courses)
