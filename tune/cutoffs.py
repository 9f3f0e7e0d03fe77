"""Filter cut-offs where a scene leaves them free: as little filtering as does nearly as well."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from tune.errors import NoFeasibleEffectError
from tune.loop import Filters
from tune.problem import Job
from tune.scene import Cutoff
from tune.solve import groups, solve

#: Cut-offs tried where a filter is free, Hz; none first, least filtering first. Below 20 Hz an
#: acceleration filter eats into the 0.5 to 5 Hz at which people move.
CUTOFFS = (None, 200.0, 100.0, 50.0, 30.0, 20.0)
#: Least filtering whose score comes this close to the best is taken.
_GOOD_ENOUGH = 0.99


def choose_filters(job: Job, say: Callable[[str], None]) -> Filters:
    """The fixed cut-offs, and for free ones the least filtering that does nearly as well as any.

    A filter is only there for an effect that uses it: without a damper no velocity filter, without
    a virtual mass no acceleration filter.
    """
    scene = job.scene
    wishes = {effect for element in scene.elements.values() for effect in element.wishes()}
    nyquist = 0.5 / job.device.sample_time.high

    kind = Filters(
        velocity_order=scene.loop.velocity_filter_order,
        acceleration_order=scene.loop.acceleration_filter_order,
        damping_ratio=scene.loop.filter_damping_ratio,
        velocity_window=scene.loop.velocity_window_samples if "damping" in wishes else None,
    )

    def options(cutoff: Cutoff, effect: str) -> tuple[float | None, ...]:
        if effect not in wishes or cutoff == "none":
            return (None,)
        if cutoff == "free":
            return tuple(c for c in CUTOFFS if c is None or c < nyquist)
        assert isinstance(cutoff, float)
        return (cutoff,)

    velocity: tuple[float | None, ...] = (None,)
    if kind.velocity_window is None:
        velocity = options(scene.loop.velocity_filter_hz, "damping")
    acceleration = options(scene.loop.acceleration_filter_hz, "mass")
    if len(velocity) * len(acceleration) == 1:
        return replace(kind, velocity_hz=velocity[0], acceleration_hz=acceleration[0])
    scores: dict[Filters, float] = {}
    known: dict[tuple[tuple[str, ...], Filters], float] = {}
    for v, a in product(velocity, acceleration):
        say(f"trying filters: velocity {_hertz(v)}, acceleration {_hertz(a)}")
        total = 0.0
        for elements in groups(scene):
            used = {effect for name in elements for effect in scene.elements[name].wishes()}
            own = replace(
                kind,
                velocity_hz=v if "damping" in used else None,
                acceleration_hz=a if "mass" in used else None,
            )
            if used & {"damping", "mass"} and (elements, own) not in known:
                known[elements, own] = _score(job, elements, own)
            total += known.get((elements, own), 0.0)
        scores[replace(kind, velocity_hz=v, acceleration_hz=a)] = total
    best = max(scores.values())
    good = [filters for filters, score in scores.items() if score >= _GOOD_ENOUGH * best]
    return max(good, key=lambda f: (f.acceleration_hz or np.inf, f.velocity_hz or np.inf))


def _hertz(cutoff: float | None) -> str:
    return "none" if cutoff is None else f"{cutoff:g} Hz"


def _score(
    job: Job,
    elements: Sequence[str],
    filters: Filters,
) -> float:
    """Sum over effects of one plus the logarithm of their steps: a lost effect outweighs gains."""
    try:
        solved = solve(job, elements, filters, second_opinion=False)
    except NoFeasibleEffectError:
        return 0.0
    return sum(
        1 + float(np.log(max(unknown.steps(float(size)), 1.0)))
        for unknown, size in zip(solved.problem.unknowns, solved.sizes, strict=True)
    )
