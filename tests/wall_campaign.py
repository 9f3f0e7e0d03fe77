"""Random moments at a stated gain, played by many members each in blocks of one structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.wall_axis import Axis
from tests.wall_devices import Moment, joined
from tests.wall_gates import transitions
from tests.wall_play import Array, Bench, Law, Mask
from tests.wall_trials import KINDS, Gates, Played, play

#: What the spring of a member is.
SHAPES = ("two-sided", "one-sided", "wall", "slot")
#: m/s, of every member at the start: forces without a clamp or a push grow in proportion to it.
START = 1.0
#: How much longer what grows is played again, and how often at most.
LONGER, FEWER = (8, 40), 16
#: Members side by side, so that their matrices stay near the processor.
_BLOCK = 2048


def structure(moment: Moment) -> tuple[bool, bool]:
    """Whether it has a mode and a lag: members with the same go side by side."""
    axis = moment.axis
    return bool(axis.at_encoder or axis.at_handle), bool(axis.lag)


def run(
    moments: Sequence[Moment],
    gains: Sequence[float],
    *,
    repeats: int,
    samples: int,
    seed: int,
) -> Mask:
    """Which plays grow, (moments, repeats), with gates, walls, clamps and pushes by chance."""
    grows = np.zeros((len(moments), repeats), dtype=bool)
    generator = np.random.default_rng((seed, 11))
    for kind in sorted({structure(each) for each in moments}):
        chosen = [k for k, each in enumerate(moments) if structure(each) == kind]
        size = max(1, _BLOCK // repeats)
        for first in range(0, len(chosen), size):
            part = chosen[first : first + size]
            gain = np.repeat([gains[k] for k in part], repeats)
            played = _block([moments[k] for k in part], gain, repeats, samples, generator)
            grows[part] = played.grows().reshape(len(part), repeats)
    return grows


def _block(
    moments: Sequence[Moment],
    gain: Array,
    repeats: int,
    samples: int,
    generator: np.random.Generator,
) -> Played:
    members = len(moments) * repeats
    axis = Axis(**joined([each.axis for each in moments], repeats))
    law = Law(**joined([each.law for each in moments], repeats))
    shape = generator.integers(0, len(SHAPES), members)
    gate = generator.integers(0, len(KINDS), members)
    K, M = gain * law.stiffness, axis.mass + axis.hand_mass
    sided = (shape == 1) | (shape == 2)
    flight = 10 ** generator.uniform(0.5, 2.3, members) * axis.sample_time
    pushed = sided & (K > 0) & (generator.random(members) < 0.6)
    push = np.where(pushed, 2 * M * START / flight, 0.0)
    hit = START * np.sqrt(np.where(K > 0, K, 0.0) * axis.mass)
    part = 10 ** generator.uniform(-1.7, 0.3, members)
    clamped = (generator.random(members) < 0.5) & (K > 0)
    peak = np.where(clamped, np.maximum(1.5 * push, part * hit), np.inf)
    law = replace(
        law,
        stiffness=K,
        damping=gain * law.damping,
        mass=gain * law.mass,
        one_sided=(shape == 1) * 1.0,
        wall=(shape == 2) * 1.0,
        slot=np.where(
            shape == 3, START * axis.sample_time * generator.choice([0.1, 5.0], members), 0.0
        ),
        peak=peak,
    )
    bench = Bench(axis, law, members)
    bench.start(-START * axis.sample_time * generator.random(members), START)
    gates = Gates.drawn(bench, gate, generator)
    return play(bench, gates, samples=samples, push=push, generator=generator)


def growing(
    moments: Sequence[Moment], gains: Sequence[float], *, repeats: int, samples: int, seed: int
) -> list[int]:
    """Places of the moments whose motion grows, also in runs longer by `LONGER`.

    A swing that hardly dies out is not seen at its highest in every part of a short run.
    """
    left = list(range(len(moments)))
    for turn, longer in enumerate((1, *LONGER)):
        if not left:
            break
        grows = run(
            [moments[k] for k in left],
            [gains[k] for k in left],
            repeats=repeats if turn == 0 else min(repeats, FEWER),
            samples=samples * longer,
            seed=seed + turn,
        )
        left = [left[k] for k in np.flatnonzero(np.any(grows, axis=1))]
    return left


def at_gain(law: Law, gain: float) -> Law:
    """A law with what is switched, and its spring, at a gain."""
    return replace(
        law,
        stiffness=gain * law.stiffness,
        damping=gain * law.damping,
        mass=gain * law.mass,
    )


def steady_growth(moment: Moment, gain: float) -> float:
    """Largest growth a sample beside a two-sided spring with gates that stay, open or shut."""
    return max(
        linear_growth(moment, gain, damper=damper, inertia=inertia)
        for damper in (0.0, 1.0)
        for inertia in (0.0, 1.0)
    )


def linear_growth(moment: Moment, gain: float, *, damper: float, inertia: float) -> float:
    """Growth a sample beside a two-sided spring with the gates where they are."""
    law = at_gain(moment.law, gain)
    matrix = transitions(Bench(moment.axis, law), damper, inertia)[0]
    values = np.linalg.eigvals(matrix)
    if not (law.stiffness or moment.axis.stiffness or moment.axis.hand_stiffness):
        values = np.delete(values, int(np.argmin(np.abs(values - 1))))
    return float(np.max(np.abs(values)))
