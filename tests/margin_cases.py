"""Random loops for the tests of margins: drawn, made stable by the reference, and built by us."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests import general_loops
from tests.sampled_loops import Case
from tests.sampled_reference import Sampled
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop


def draw(rng: np.random.Generator, *, plain: bool = False) -> Case:
    """A stable case at a random part of its gain limit; plain: rigid, held, whole samples."""
    while True:
        case = _drawn(rng, plain=plain)
        limit = Sampled(case).safe_gain()
        if limit == 0:
            continue
        gain = rng.uniform(0.03, 0.9) * limit if np.isfinite(limit) else 1.0
        return replace(
            case,
            stiffness=gain * case.stiffness,
            added_damping=gain * case.added_damping,
            added_mass=gain * case.added_mass,
        )


def _drawn(rng: np.random.Generator, *, plain: bool) -> Case:
    mass, step = 10 ** rng.uniform(-1.3, 1.3), 10 ** rng.uniform(-3.7, -2.5)
    damping = mass / 10 ** rng.uniform(-2, 0.5)
    there = rng.random(3) < 0.6
    there[rng.integers(3)] = True

    def chance(probability: float) -> bool:
        return bool(rng.random() < probability)

    def cutoff() -> float | None:
        return float(np.exp(rng.uniform(np.log(5), np.log(0.5 / step)))) if chance(0.6) else None

    modes: tuple[tuple[float, float, float, float], ...] = ()
    hand = (0.0, 0.0, 0.0)
    if not plain and chance(0.5):
        hertz = 10 ** rng.uniform(1.3, np.log10(0.7 / step))
        ratio = 10 ** rng.uniform(-0.7, 0.7)  # of the masses at handle and motor
        modes = ((hertz, 10 ** rng.uniform(-2.3, -0.7), ratio**0.5, -(ratio**-0.5)),)
    if not plain and chance(0.5):
        hand = (mass * rng.uniform(0, 0.3), 10 ** rng.uniform(-1, 1.3), 10 ** rng.uniform(0.5, 3))
    window = int(rng.integers(2, 9)) if not plain and chance(0.2) else None
    return Case(
        mass=mass,
        damping=damping,
        sample_time=step,
        delay_samples=float(rng.integers(0, 4)) if plain or chance(0.3) else rng.uniform(0, 5),
        stiffness=0.2 * damping / step * there[0],
        added_damping=damping * there[1],
        added_mass=0.3 * mass * there[2],
        velocity_filter_hz=None if window else cutoff(),
        velocity_filter_order=int(rng.integers(1, 3)),
        velocity_window_samples=window,
        acceleration_filter_hz=cutoff(),
        acceleration_filter_order=int(rng.integers(1, 3)),
        filter_damping_ratio=float(rng.uniform(0.5, 1)) if chance(0.5) else 1.0,
        modes=modes,
        hand=hand,
        current_lag=step * 10 ** rng.uniform(-1, 0.5) if not plain and chance(0.3) else 0.0,
    )


def felt_only(case: Case) -> Case:
    """Without the filters of effects that are not there."""
    return replace(
        case,
        velocity_filter_hz=case.velocity_filter_hz if case.added_damping else None,
        velocity_window_samples=case.velocity_window_samples if case.added_damping else None,
        acceleration_filter_hz=case.acceleration_filter_hz if case.added_mass else None,
    )


def filters_of(case: Case) -> Filters:
    """The filters of the effects that are there."""
    return general_loops.filters_of(felt_only(case))


def loop_of(case: Case) -> Loop:
    return general_loops.loop_of(felt_only(case))


def effects_of(case: Case) -> Effects:
    return Effects(
        stiffness=case.stiffness or None,
        damping=case.added_damping or None,
        mass=case.added_mass or None,
    )
