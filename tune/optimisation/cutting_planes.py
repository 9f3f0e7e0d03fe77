"""Kelley's cutting-plane method in few coordinates, within a trust region.

For functions that are smooth but for edges where one limit takes over from another: a maximum on
an edge is met by the tangents of both sides. Each point adds a plane above the function; the next
point is where the lowest of them is highest, no further than the trust region reaches. J. E.
Kelley, The cutting-plane method for solving convex programs, J. SIAM 8 (1960) 703.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.linear_program import solve_linear_program

FloatArray = NDArray[np.float64]

#: Points at most; ten are usual.
_MOST = 30
#: The trust region ends the search where it is this small, and shrinks or grows by so much.
_SMALLEST, _SHRINKS, _GROWS = 2e-3, 0.4, 2.0
#: Part of the rise to the best point that a plane must explain to be a bound there. Clear of 1,
#: which rounding would decide where the function is nearly straight.
_EXPLAINS = 0.9


def maximise(
    value: Callable[[Sequence[float]], float],
    slopes: Callable[[Sequence[float]], Sequence[float]],
    start: Sequence[float],
    ends: Sequence[tuple[float, float]],
    *,
    radius: float,
    gain: float,
) -> list[float]:
    """Maximise a function by cutting planes from a start; the best point met is returned.

    Args:
        value: to be made large; minus infinity where a point is not good.
        slopes: its gradient at a point.
        start: a good point.
        ends: of each coordinate.
        radius: of the trust region at first, in each coordinate.
        gain: a search ends where the planes promise less.
    """
    low, high = (np.array(side) for side in zip(*ends, strict=True))
    best = np.clip(np.array(start), low, high)
    most = value(best.tolist())
    planes = [(best, most, np.array(slopes(best.tolist())))]
    for _ in range(_MOST):
        near = np.maximum(low, best - radius), np.minimum(high, best + radius)
        place, promised = _highest(planes, best, most, *near)
        if promised < most + gain or radius < _SMALLEST:
            break
        found = value(place.tolist())
        if np.isfinite(found):
            planes.append((place, found, np.array(slopes(place.tolist()))))
        if found > most:
            radius *= _GROWS if found - most > 0.5 * (promised - most) else 1.0
            best, most = place, found
        else:
            radius = _SHRINKS * max(float(np.max(np.abs(place - best))), _SMALLEST)
    return best.tolist()


def _highest(
    planes: Sequence[tuple[FloatArray, float, FloatArray]],
    best: FloatArray,
    most: float,
    low: FloatArray,
    high: FloatArray,
) -> tuple[FloatArray, float]:
    """Where the lowest plane is highest between two corners, and how high.

    A plane that passes below the best point is no bound there, for the function is not concave
    everywhere and may jump: it is left out, and the trust region keeps away from where it was seen.
    """
    count = best.size
    planes = [
        (place, height, slope)
        for place, height, slope in planes
        if slope @ (best - place) >= _EXPLAINS * (most - height)
    ]
    rows = np.array([np.append(-slope, 1.0) for _, _, slope in planes])
    heights = np.array([height - slope @ place for place, height, slope in planes])
    at_best = heights + np.array([slope @ best for _, _, slope in planes])
    heights += np.maximum(most - at_best, 0.0)
    answer = solve_linear_program(
        np.append(np.zeros(count), -1.0),
        rows,
        (np.full(len(rows), -np.inf), heights),
        (np.append(low, -np.inf), np.append(high, np.inf)),
    )
    if answer is None:
        return best, most
    return answer[:-1], float(answer[-1])
