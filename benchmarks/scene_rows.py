"""What each part of a scene costs against the same scene without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """Something a scene may ask for or a device may have: with it and without."""

    name: str
    beside: Case
    without: Case


PARTS = (
    _Part(name="damping beside a spring", beside=case(DAMPED), without=case(WALL)),
    _Part(name="a velocity filter", beside=case(DAMPED), without=case(DAMPED, filters=PLAIN)),
    _Part(name="mass and its filter beside K and B", beside=case(BLOCK), without=case(DAMPED)),
    _Part(name="a second element apart", beside=case(PAIR), without=case(DAMPED)),
    _Part(
        name="the two felt together",
        beside=case(PAIR, together=[["wall", "water"]]),
        without=case(PAIR),
    ),
    _Part(
        name="a rank of its own for each of the two",
        beside=case(
            {**DAMPED, "water": {"damping": "max", "priority": 2}}, together=[["wall", "water"]]
        ),
        without=case(PAIR, together=[["wall", "water"]]),
    ),
    _Part(name="a known hand", beside=case(DAMPED, hand=_HAND), without=case(DAMPED)),
    _Part(name="any grip", beside=case(DAMPED, hand=_GRIPS), without=case(DAMPED, hand=_HAND)),
    _Part(name="a mode", beside=case(DAMPED, device={"modes": (_MODE,)}), without=case(DAMPED)),
    _Part(name="a delay interval", beside=case(DAMPED, device=_LATE), without=case(DAMPED)),
    _Part(name="a sample time interval", beside=case(DAMPED, device=_JITTER), without=case(DAMPED)),
    _Part(
        name="an interval of the mass", beside=case(DAMPED), without=case(DAMPED, device=_WEIGHED)
    ),
    _Part(name="a force limit", beside=case(DAMPED), without=case(DAMPED, device=_NO_FORCE)),
    _Part(name="an encoder", beside=case(DAMPED), without=case(DAMPED, device=_NO_ENCODER)),
    _Part(name="an encoder, one spring", beside=case(WALL), without=case(WALL, device=_NO_ENCODER)),
    _Part(
        name="the wider margin",
        beside=case(DAMPED, margin="conservative"),
        without=case(DAMPED, margin="firm"),
    ),
)


def rows() -> Iterator[Row]:
    """Of each part: the proposal and the certificate, beside those without it."""
    for part in PARTS:
        cases = (part.beside, part.without)
        tasks = [chosen.task() for chosen in cases]
        both = list(zip(cases, tasks, strict=True))
        solved = [proposal(chosen, task) for chosen, task in both]
        designs = [
            description(chosen, task, found)
            for (chosen, task), found in zip(both, solved, strict=True)
        ]
        calls: dict[str, list[Callable[[], object]]] = {
            "propose": [lambda c=chosen, j=task: proposal(c, j) for chosen, task in both],
            "certify": [
                certificate(chosen, task, found, design)
                for (chosen, task), found, design in zip(both, solved, designs, strict=True)
            ],
        }
        for what, pair in calls.items():
            beside, without = timed_in_turn(pair, 5)
            more = beside.middle - without.middle
            yield Row.of(
                f"{what} with {part.name}",
                beside,
                f"{'+' if more >= 0 else '-'}{with_unit(abs(more))}, "
                f"{beside.middle / without.middle:.2g} times",
                f"{with_unit(without.middle)} without",
            )
