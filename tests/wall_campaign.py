"""Random moments at a stated gain, played by many members each in blocks of one structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.wall_axis import Axis
from tests.wall_devices import Moment, joined
from tests.wall_gates import transitions
from tests.wall_play import Array, Bench, Law
from tests.wall_trials import KINDS, Gates, Played, play

#: What the spring of a member is.
SHAPES = ("two-sided", "one-sided", "wall", "slot")
#: m/s, of every member at the start: forces without a clamp or a push grow in proportion to it.
START = 1.0
#: How much longer what grows is played again, and how often at most.
LONGER, FEWER = (8, 40), 16
#: Members side by side, so that their matrices stay near the processor.
_BLOCK = 2048


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """What was played, each of shape (moments, repeats).

    Attributes:
        grows: whether energy was larger in the last part than in the one before.
        left: energy of the last part over that of the first.
        gate: index in `KINDS`.
        shape: index in `SHAPES`.
    """

    grows: NDArray[np.bool_]
    left: Array
    ratio: Array
    gate: NDArray[np.intp]
    shape: NDArray[np.intp]


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
    floor: float = 0.0,
) -> Campaign:
    """Every moment at its gain, ``repeats`` times, gates, walls, clamps and pushes by chance."""
    count = len(moments)
    found = {
        "grows": np.zeros((count, repeats), dtype=bool),
        "left": np.zeros((count, repeats)),
        "ratio": np.zeros((count, repeats)),
        "gate": np.zeros((count, repeats), dtype=np.intp),
        "shape": np.zeros((count, repeats), dtype=np.intp),
    }
    generator = np.random.default_rng((seed, 11))
    kinds = sorted({structure(each) for each in moments})
    for kind in kinds:
        chosen = [k for k, each in enumerate(moments) if structure(each) == kind]
        size = max(1, _BLOCK // repeats)
        for first in range(0, len(chosen), size):
            part = chosen[first : first + size]
            played = _block(
                [moments[k] for k in part],
                np.repeat([gains[k] for k in part], repeats),
                repeats,
                samples,
                generator,
                found,
                np.asarray(part),
            )
            shape = (len(part), repeats)
            found["grows"][part] = played.grows(floor).reshape(shape)
            with np.errstate(all="ignore"):
                left = played.energies[-1] / played.energies[0]
            found["left"][part] = left.reshape(shape)
            found["ratio"][part] = played.ratio.reshape(shape)
    return Campaign(**found)


def _block(
    moments: Sequence[Moment],
    gain: Array,
    repeats: int,
    samples: int,
    generator: np.random.Generator,
    found: dict[str, NDArray[np.generic]],
    rows: NDArray[np.intp],
) -> Played:
    members = len(moments) * repeats
    axis = Axis(**joined([each.axis for each in moments], repeats))
    law = Law(**joined([each.law for each in moments], repeats))
    shape = generator.integers(0, len(SHAPES), members)
    gate = generator.integers(0, len(KINDS), members)
    found["gate"][rows] = gate.reshape(len(rows), repeats)
    found["shape"][rows] = shape.reshape(len(rows), repeats)
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
    gates = Gates(
        bench,
        gate,
        period=10 ** generator.uniform(0.3, 2.5, members),
        duty=generator.random(members),
        generator=generator,
    )
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
        found = run(
            [moments[k] for k in left],
            [gains[k] for k in left],
            repeats=repeats if turn == 0 else min(repeats, FEWER),
            samples=samples * longer,
            seed=seed + turn,
        )
        left = [
            k for k, grows in zip(left, np.any(found.grows, axis=1).tolist(), strict=True) if grows
        ]
    return left


def linear_growth(moment: Moment, gain: float, *, damper: float, inertia: float) -> float:
    """Growth a sample beside a two-sided spring with the gates where they are."""
    law = replace(
        moment.law,
        stiffness=gain * moment.law.stiffness,
        damping=gain * moment.law.damping,
        mass=gain * moment.law.mass,
    )
    matrix = transitions(Bench(moment.axis, law), damper, inertia)[0]
    values = np.linalg.eigvals(matrix)
    if not (law.stiffness or moment.axis.stiffness or moment.axis.hand_stiffness):
        values = np.delete(values, int(np.argmin(np.abs(values - 1))))
    return float(np.max(np.abs(values)))
