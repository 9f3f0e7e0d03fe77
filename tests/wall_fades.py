"""Hands that enter and leave an element while it fades, so that the device swings up.

The level of an element that fades changes by at most one part in so many samples. What a hand makes
of that is sought in two ways: levels that at every step lift one swing as far as they can, and
random waves with corners anywhere, improved corner by corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.wall_gates import slowest_swing, transitions
from tests.wall_play import Array, Bench, Mask

#: Steps of the level from nothing to all of it.
STEPS = 32


def at_levels(bench: Bench) -> Array:
    """Transitions of a bench whose members play rising parts of what fades, (levels, n, n)."""
    return transitions(bench, 1.0, 0.0)


def chased_growth(matrices: Array, samples: int, *, swings: int = 100) -> float:
    """Growth a sample of the most lifted motion, each level held for so many samples.

    The highest of several swings is compared with the highest of as many later ones: within a swing
    a motion that dies out may rise.

    Args:
        matrices: at evenly rising levels, (levels, n, n).
        samples: of a step of the level.
        swings: for which this goes on.
    """
    powers = np.linalg.matrix_power(matrices, samples)
    count = len(matrices)
    best = 0.0
    steps = max(120, int(swings * 2 * longest_half_swing(matrices) / samples))
    for watched in (0, count // 2, count - 1):
        left, value = slowest_swing(matrices[watched][None])
        if not abs(np.angle(value[0])) > 0:
            continue
        state, level = np.real(left[0]), count // 2
        grown = np.empty(steps)
        for k in range(steps):
            near = np.arange(max(level - 1, 0), min(level + 2, count))
            following = powers[near] @ state
            chosen = int(np.argmax(np.abs(following @ left[0])))
            level, state = int(near[chosen]), following[chosen]
            size = float(np.linalg.norm(state))
            state = state / size
            grown[k] = np.log(size)
        sizes = np.cumsum(grown)
        middle, span = steps // 2, steps // 6
        early, late = sizes[middle - span : middle], sizes[-span:]
        best = max(best, float(np.exp((late.max() - early.max()) / ((steps - middle) * samples))))
    return best


@dataclass(frozen=True, slots=True, kw_only=True)
class Wave:
    """One period of the level: corners it goes to in turn, and samples it waits at each.

    Attributes:
        levels: places among the matrices, shape (corners,).
        waits: samples, shape (corners,).
    """

    levels: tuple[int, ...]
    waits: tuple[int, ...]


def growth_of(matrices: Array, samples: int, wave: Wave) -> float:
    """Growth a sample under a wave that goes on for ever."""
    total, length = np.eye(matrices.shape[1]), 0
    for place, (level, wait) in enumerate(zip(wave.levels, wave.waits, strict=True)):
        total = np.linalg.matrix_power(matrices[level], wait) @ total
        length += wait
        following = wave.levels[(place + 1) % len(wave.levels)]
        way = np.sign(following - level)
        for passed in range(level, following, way or 1):
            total = np.linalg.matrix_power(matrices[passed + way], samples) @ total
            length += samples
    return float(np.max(np.abs(np.linalg.eigvals(total)))) ** (1 / max(length, 1))


def waved_growth(
    matrices: Array, samples: int, generator: np.random.Generator, *, tries: int, turns: int
) -> float:
    """Largest growth a sample of waves of two to four corners, the best of them improved.

    Full waves, and as many at random as there are tries.
    """
    count, span = len(matrices), longest_half_swing(matrices)

    def drawn() -> Wave:
        corners = int(generator.integers(2, 5))
        return Wave(
            levels=tuple(int(level) for level in generator.integers(0, count, corners)),
            waits=tuple(int(wait) for wait in generator.uniform(0, span, corners)),
        )

    parts = (0.2, 0.4, 0.7)
    waves = [
        Wave(levels=(0, count - 1), waits=(int(first * span), int(last * span)))
        for first in parts
        for last in parts
    ]
    waves += [drawn() for _ in range(tries)]
    grown = [growth_of(matrices, samples, wave) for wave in waves]
    found = 0.0
    for place in np.argsort(grown)[-3:]:
        wave, best = waves[place], grown[place]
        for _ in range(turns):
            corner = int(generator.integers(len(wave.levels)))
            levels, waits = list(wave.levels), list(wave.waits)
            shift = int(generator.integers(-3, 4))
            levels[corner] = min(max(levels[corner] + shift, 0), count - 1)
            waits[corner] = int(waits[corner] * generator.uniform(0.5, 1.5) + generator.integers(3))
            trial = Wave(levels=tuple(levels), waits=tuple(waits))
            seen = growth_of(matrices, samples, trial)
            if seen > best:
                wave, best = trial, seen
        found = max(found, best)
    return found


def longest_half_swing(matrices: Array) -> float:
    """Samples of half a turn of the slowest swing, 1 where nothing swings."""
    turns = np.abs(np.angle(np.linalg.eigvals(matrices)))
    turns = turns[(turns > 1e-9) & (turns < 3.0)]
    return float(np.pi / turns.min()) if turns.size else 1.0


class Fading:
    """A gate of masses whose level follows what feeds the device, as fast as a fade allows.

    Args:
        members: how many.
        samples: of a whole fade, shape (members,).
        kind: 0 follows the power, 1 turns by chance, 2 rises and falls with a period.
        period: samples between turns on average, or of a period.
        generator: of what is random.
    """

    def __init__(
        self,
        members: int,
        samples: Array,
        *,
        kind: Array,
        period: Array,
        generator: np.random.Generator,
    ) -> None:
        self._step, self._kind, self._period = 1 / samples, kind, period
        self._generator = generator
        self._level, self._rising = np.zeros(members), np.ones(members, dtype=bool)

    def __call__(self, k: int, bench: Bench, damper: Array, inertia: Array) -> tuple[Array, Array]:
        """Dampers are open; masses are as far as they have faded."""
        feeds = -inertia * bench.pace() > 0
        turned = self._generator.random(len(feeds)) < 1 / self._period
        self._rising = np.where(turned, ~self._rising, self._rising)
        within = k % self._period < self._period / 2
        rises: Mask = np.where(
            self._kind == 0, feeds, np.where(self._kind == 1, self._rising, within)
        )
        moved = self._level + np.where(rises, self._step, -self._step)
        self._level = np.clip(moved, 0.0, 1.0)
        return np.ones_like(damper), self._level
