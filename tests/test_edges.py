"""A design half a per cent beyond a condition of the certificate is refused, one within it passes.

Where the edges are is told by others: loops in z with 360 digits, and responses written out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from tests.reference import crossings
from tests.sampled_loops import Case, loop_along
from tests.sampled_reference import Sampled
from tune import CheckFailedError
from tune.certificate.certify import certify
from tune.documents.certified import AbsoluteStability
from tune.documents.profile import Design

#: How far from an edge, relative.
OFF = 0.005
STEP = 1e-3
AXIS = Case(mass=3.0, damping=10.0, sample_time=STEP, delay_samples=1.0)
#: Gain and extra samples of delay of the margin.
GAIN, EXTRA = 2.0, 1.0
MARGIN = {"name": "balanced", "gain": GAIN, "extra_delay_samples": 1}
WHOLE = (0.0, 0.25, 0.5, 0.75, 1.0)


def interval(value: float, low: float | None = None, high: float | None = None) -> dict[str, float]:
    return {"value": value, "low": low or value, "high": high or value}


def design(
    elements: dict[str, dict[str, Any]], *, device: dict[str, Any] | None = None, **more: Any
) -> Design:
    """A design of a bare device that states nothing more than it has to."""
    axis = {"sample_time": STEP, "mass": 3.0, "damping": 10.0, "delay": STEP} | (device or {})
    loop = more.pop("loop", {}) | {"sample_time": STEP, "extra_delay_samples": 1.0}
    whole: dict[str, dict[str, Any]] = {}
    for name, element in elements.items():
        margins = {"gain": GAIN, "extra_delay_samples": EXTRA, "passive": False}
        whole[name] = {
            **{"stiffness": 0.0, "damping": 0.0, "mass": 0.0},
            **{"perceived_steps": {}, "limited_by": {}, "ripple": 1e3},
            "motion": {"penetration": 0.01, "speed": 0.2, "acceleration": 2.0},
            **element,
            "margins": margins | element.get("margins", {}),
        }
    base = {"scene": "edges", "margin": MARGIN, "ripple_limit": 1e3}
    return Design.model_validate({**base, "device": axis, "loop": loop, "elements": whole} | more)


def said(made: Design, witnesses: dict[str, AbsoluteStability] | None = None) -> str:
    """What `certify` says against a design, nothing where it proves it."""
    try:
        certify(made, witnesses=witnesses)
    except CheckFailedError as error:
        return "\n".join(error.failures)
    return ""


def limit(case: Case, sizes: tuple[float, float, float]) -> float:
    """The least gain at which a pole of a loop is on the unit circle."""
    gains = crossings(loop_along(case, *(size or None for size in sizes)))
    return min((float(gain.mid()) for gain in gains), default=np.inf)


def limit_of_box(cases: list[Case], sizes: tuple[float, float, float]) -> float:
    """The same of many devices, at every part of the extra delay."""
    return min(limit(case.later(late), sizes) for case, late in product(cases, WHOLE))


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """One side of the box with a width.

    Attributes:
        device: keys of its file.
        cases: along the side.
        sizes: K, B and M, played times a factor.
        hand: where it is a hand that has a width.
    """

    device: dict[str, Any]
    cases: list[Case]
    sizes: tuple[float, float, float] = (1.0, 0.0, 0.0)
    hand: dict[str, Any] | None = None


def along(case: Case, name: str, low: float, high: float) -> list[Case]:
    return [replace(case, **{name: float(x)}) for x in np.linspace(low, high, 9)]


LAGGING = replace(AXIS, acceleration_filter_hz=20.0)
MODE = {"at_encoder": 0.8, "at_handle": -0.5}
SIDES = {
    "mass": Side(
        device={"mass": interval(3.0, low=2.4)},
        cases=along(AXIS, "mass", 2.4, 3.0),
        sizes=(0.0, 0.0, 1.0),
    ),
    "damping": Side(
        device={"damping": interval(10.0, low=8.0)}, cases=along(AXIS, "damping", 8.0, 10.0)
    ),
    "sample_time": Side(
        device={"sample_time": interval(STEP, high=1.2 * STEP)},
        cases=[
            replace(AXIS, sample_time=float(T), delay_samples=float(STEP / T))
            for T in np.linspace(STEP, 1.2 * STEP, 9)
        ],
    ),
    "delay": Side(
        device={"delay": interval(STEP, high=1.4 * STEP)},
        cases=along(AXIS, "delay_samples", 1.0, 1.4),
    ),
    "current_lag": Side(
        device={"current_lag": interval(2e-4, high=4e-4)},
        cases=along(AXIS, "current_lag", 2e-4, 4e-4),
    ),
    "mode": Side(
        device={
            "modes": [
                {"frequency_hz": interval(90.0, low=60.0), "damping_ratio": interval(0.05), **MODE}
            ]
        },
        cases=[replace(AXIS, modes=((f, 0.05, 0.8, -0.5),)) for f in np.linspace(60, 90, 9)],
    ),
    "position_stiffness": Side(
        device={"position_stiffness": interval(100.0, high=400.0)},
        cases=[replace(LAGGING, hand=(0.0, 0.0, float(k))) for k in np.linspace(100, 400, 9)],
        sizes=(0.0, 0.0, 1.0),
    ),
    "presliding_stiffness": Side(
        device={"presliding_stiffness": {"low": 100.0, "high": 400.0}},
        cases=[replace(LAGGING, hand=(0.0, 0.0, float(k))) for k in np.linspace(100, 400, 9)],
        sizes=(0.0, 0.0, 1.0),
    ),
    "hand": Side(
        device={},
        cases=[replace(LAGGING, hand=(0.1, 2.0, float(k))) for k in np.linspace(100, 400, 9)],
        sizes=(0.0, 0.0, 1.0),
        hand={"mass": interval(0.1), "damping": interval(2.0), "stiffness": interval(100.0, high=400.0)},
    ),
}


if __name__ == "__main__":
    for name, side in SIDES.items():
        l = [min(limit(c.later(e), side.sizes) for e in WHOLE) for c in side.cases]
        e = [min(limit(c.later(e), side.sizes) for c in side.cases) for e in WHOLE]
        print(name, l[0], min(l), l[-1], np.argmin(l), e)
