"""What each part of a scene costs against the same scene without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from benchmarks.row import Row, timed_in_turn, with_unit
from benchmarks.scenes import Case, case, certificate, description, proposal
from identification import Mode, quantity
from tune.loop.loop import Filters

WALL: dict[str, Any] = {"wall": {"stiffness": "max"}}
DAMPED: dict[str, Any] = {"wall": {"stiffness": "max", "damping": "max"}}
BLOCK: dict[str, Any] = {"wall": {"stiffness": "max", "damping": "max", "mass": "max"}}
PAIR: dict[str, Any] = {**DAMPED, "water": {"damping": "max"}}
PLAIN = Filters()

_MODE = Mode(
    frequency_hz=quantity(80.0), damping_ratio=quantity(0.05), at_encoder=0.3, at_handle=-0.5
)
_NO_FORCE: dict[str, Any] = {"force_limit": None}
_NO_ENCODER: dict[str, Any] = {"encoder_resolution": None}
_LATE: dict[str, Any] = {"delay": quantity(1e-3, 1e-3, 2e-3)}
_JITTER: dict[str, Any] = {"sample_time": quantity(1e-3, 0.99e-3, 1.01e-3)}
_WEIGHED: dict[str, Any] = {"mass": quantity(3.0), "covariance": None}
_HAND = {"mass": 0.3, "damping": 8.0, "stiffness": 500.0}
_GRIPS = {
    "mass": {"value": 0.3, "low": 0.1, "high": 1.0},
    "damping": {"value": 8.0, "low": 3.0, "high": 20.0},
    "stiffness": {"value": 500.0, "low": 100.0, "high": 1500.0},
}


#: What a scene may ask for or a device may have: with it and without.
PARTS: dict[str, tuple[Case, Case]] = {
    "damping beside a spring": (case(DAMPED), case(WALL)),
    "a velocity filter": (case(DAMPED), case(DAMPED, filters=PLAIN)),
    "mass and its filter beside K and B": (case(BLOCK), case(DAMPED)),
    "a second element apart": (case(PAIR), case(DAMPED)),
    "the two felt together": (case(PAIR, together=[["wall", "water"]]), case(PAIR)),
    "a rank of its own for each of the two": (
        case({**DAMPED, "water": {"damping": "max", "priority": 2}}, together=[["wall", "water"]]),
        case(PAIR, together=[["wall", "water"]]),
    ),
    "a known hand": (case(DAMPED, hand=_HAND), case(DAMPED)),
    "any grip": (case(DAMPED, hand=_GRIPS), case(DAMPED, hand=_HAND)),
    "a mode": (case(DAMPED, device={"modes": (_MODE,)}), case(DAMPED)),
    "a delay interval": (case(DAMPED, device=_LATE), case(DAMPED)),
    "a sample time interval": (case(DAMPED, device=_JITTER), case(DAMPED)),
    "an interval of the mass": (case(DAMPED), case(DAMPED, device=_WEIGHED)),
    "a force limit": (case(DAMPED), case(DAMPED, device=_NO_FORCE)),
    "an encoder": (case(DAMPED), case(DAMPED, device=_NO_ENCODER)),
    "an encoder, one spring": (case(WALL), case(WALL, device=_NO_ENCODER)),
    "the wider margin": (case(DAMPED, margin="conservative"), case(DAMPED, margin="firm")),
}


def rows() -> Iterator[Row]:
    """Of each part: the proposal and the certificate, beside those without it."""
    for part, cases in PARTS.items():
        calls: dict[str, list[Callable[[], object]]] = {"propose": [], "certify": []}
        for chosen in cases:
            task = chosen.task()
            solved = proposal(chosen, task)
            design = description(chosen, task, solved)
            calls["propose"].append(partial(proposal, chosen, task))
            calls["certify"].append(certificate(chosen, task, solved, design))
        for what, pair in calls.items():
            beside, without = timed_in_turn(pair, 5)
            more = beside.middle - without.middle
            yield Row.of(
                f"{what} with {part}",
                beside,
                f"{'+' if more >= 0 else '-'}{with_unit(abs(more))}, "
                f"{beside.middle / without.middle:.2g} times",
                f"{with_unit(without.middle)} without",
            )
