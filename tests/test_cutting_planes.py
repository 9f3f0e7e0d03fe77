"""Kelley's method on functions whose largest value is known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from tune.optimisation.linear_programs import maximise

_ENDS = [(-2.0, 2.0), (-2.0, 2.0)]


def _edge(place: Sequence[float]) -> float:
    """Concave, with an edge along x = y; largest, 1, at (0.5, 0.5)."""
    x, y = place
    return 1 - abs(x - y) - 0.3 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)


def _edge_slopes(place: Sequence[float]) -> list[float]:
    x, y = place
    side = math.copysign(1.0, x - y)
    return [-side - 0.6 * (x - 0.5), side - 0.6 * (y - 0.5)]


@pytest.mark.parametrize("start", [(-1.5, 1.0), (1.9, -1.9), (0.0, 0.0)])
def test_the_largest_value_on_an_edge_is_found(start: tuple[float, float]) -> None:
    found = maximise(_edge, _edge_slopes, start, _ENDS, radius=0.5, gain=1e-4)
    assert _edge(found) > 1 - 1e-3


@pytest.mark.parametrize("fall", [0.1, 1.0])
def test_a_cliff_does_not_hide_the_rise_before_it(fall: float) -> None:
    """The function rises towards x = -0.3 and falls just beyond, where it rises towards zero."""

    def value(place: Sequence[float]) -> float:
        x = place[0]
        return -0.14 * x if x >= -0.3 else 0.042 - fall + 0.12 * (x + 0.3)

    def slopes(place: Sequence[float]) -> list[float]:
        return [-0.14 if place[0] >= -0.3 else 0.12]

    found = maximise(value, slopes, [0.0], [(-2.0, 2.0)], radius=0.46, gain=1e-3)
    assert value(found) > 0.042 - 3e-3
