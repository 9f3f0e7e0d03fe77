"""Linear limits: forces of the stated motions, what a hand must feel, and walls' leads.

Each row reads a·sizes <= 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tune.optimisation.rendering import Rendering
from tune.optimisation.unknown import Unknown

FloatArray = NDArray[np.float64]
LinearWord = Literal["force", "rendering", "lead"]

#: N: an actuator without any force is taken to have this much.
_NO_FORCE = 1e-30
#: Walls to begin a search with: so many, up to so many times the least stiffness, with dampers at
#: these parts of the way from the least to the most.
_WALLS, _STIFFEST, _BETWEEN = 64, 1e6, (0.05, 0.5, 0.95)


class ForceReach(Protocol):
    """What a force is counted for: members and the motion of each."""

    @property
    def members(self) -> tuple[tuple[int, ...], ...]:
        """Indices of unknowns, for K, B and M."""
        ...

    @property
    def reach(self) -> tuple[tuple[float | None, ...], ...]:
        """Penetration, speed and acceleration of each."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearLimits:
    """Rows a·sizes <= 1, ratios of two sizes, and what is felt where steps are not in proportion.

    Attributes:
        rows: shape (rows, unknowns).
        words: which limit each row is.
        felt: limits on what is felt that are no rows.
        leads: (spring, damper, least and most of damping over stiffness, s) of walls.
    """

    rows: FloatArray
    words: tuple[LinearWord, ...]
    felt: tuple[Rendering, ...] = ()
    leads: tuple[tuple[int, int, float, float], ...] = ()

    @classmethod
    def of(
        cls,
        forces: Iterable[FloatArray],
        unknowns: int,
        felt: Iterable[Rendering] = (),
        leads: Iterable[tuple[int, int, float, float]] = (),
    ) -> LinearLimits:
        """The rows that can bind, each of shape (unknowns,), and ratios.

        A row without a positive coefficient never does.
        """
        kept = [one for one in felt if np.any(one.row(np.inf) > 0)]
        rows = [row for row in forces if np.any(row > 0)]
        straight = [one.row(0.0) for one in kept if not one.bent]
        words: tuple[LinearWord, ...] = ("force",) * len(rows) + ("rendering",) * len(straight)
        table = np.array([*rows, *straight]).reshape(len(words), unknowns)
        bent = tuple(one for one in kept if one.bent)
        return cls(rows=table, words=words, felt=bent, leads=tuple(leads))

    @property
    def ratios(self) -> list[tuple[int, int, float]]:
        """(i, j, factor): factor·size i <= size j, two of each lead."""
        return [
            pair for K, B, least, most in self.leads for pair in ((K, B, least), (B, K, 1 / most))
        ]

    def lead_points(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Walls of all stiffnesses with dampers between their least and most, the rest at least.

        Both ends have shape (unknowns,), the answer (points, unknowns).
        """
        found: list[FloatArray] = []
        for K, B, least, most in self.leads:
            first, last = float(low[K]), float(min(high[K], _STIFFEST * low[K]))
            springs = np.asarray(np.geomspace(first, last, _WALLS), dtype=np.float64)
            for part in _BETWEEN:
                points = np.tile(low, (_WALLS, 1))
                points[:, K] = springs
                points[:, B] = springs * least ** (1 - part) * most**part
                found.append(np.clip(points, low, high))
        return np.concatenate(found) if found else np.empty((0, low.size))

    def with_leads(self, points: FloatArray) -> FloatArray:
        """Sizes with the dampers of walls moved to between their least and most.

        Points have shape (points, unknowns), before and after.
        """
        points = points.copy()
        for K, B, least, most in self.leads:
            points[:, B] = np.clip(points[:, B], least * points[:, K], most * points[:, K])
        return points

    def used(self, sizes: FloatArray) -> FloatArray:
        """What sizes of shape (unknowns, ...) use of each limit, 1 is all: shape (limits, ...)."""
        used = np.tensordot(self.rows, sizes, axes=1)
        tiny = np.finfo(float).tiny
        found = [factor * sizes[i] / np.maximum(sizes[j], tiny) for i, j, factor in self.ratios]
        found += [one.used(sizes) for one in self.felt]
        return np.concatenate([used, np.stack(found)]) if found else used

    def bounds(self, sizes: FloatArray, index: int) -> dict[LinearWord, float]:
        """How large one unknown may be beside the others as they are, by the limit; inf if any.

        Sizes have shape (unknowns,).
        """
        found: dict[LinearWord, float] = {}
        for i, j, factor in self.ratios:
            if i == index and sizes[j] > 0:
                found["lead"] = min(found.get("lead", np.inf), float(sizes[j]) / factor)
        for one in self.felt:
            found["rendering"] = min(found.get("rendering", np.inf), one.bound(sizes, index))
        rest = sizes.copy()
        rest[index] = 0.0
        spare = 1 - self.rows @ rest
        for word, row, left in zip(self.words, self.rows, spare.tolist(), strict=True):
            if row[index] > 0:
                found[word] = min(found.get(word, np.inf), max(0.0, left / float(row[index])))
        return found


def force_rows(
    moments: Sequence[ForceReach], unknowns: int, continuous: float | None, peak: float | None
) -> Iterator[FloatArray]:
    """Sustained force K·penetration and peak force K·penetration + |B|·speed + |M|·acceleration.

    Each row has shape (unknowns,), one over the unit of its unknown.

    Args:
        moments: elements felt at once; a penetration that nobody states bounds nothing.
        unknowns: how many there are.
        continuous: N (N·m), None where it is not known.
        peak: N (N·m).
    """
    for moment in moments:
        costs = np.zeros((len(moment.members), unknowns))
        for cost, members, reaches in zip(costs, moment.members, moment.reach, strict=True):
            cost[list(members)] = [reach or 0.0 for reach in reaches]
        if continuous is not None:
            yield costs[0] / max(continuous, _NO_FORCE)
        if peak is not None:
            yield costs.sum(axis=0) / max(peak, _NO_FORCE)


def lead_limits(
    elements: Sequence[tuple[str, float, float]],
    unknowns: Sequence[Unknown],
    late: float,
    present: float,
) -> Iterator[tuple[int, int, float, float]]:
    """Walls whose damper more than repays the lag of their spring, and acts before the face a bit.

    0 <= speed·(B/K - τ) <= lead (docs/theory.md, 11), where the damping is not a wanted value.

    Args:
        elements: name, speed, m/s, and lead, m, of each wall.
        unknowns: of all elements.
        late: τ of a spring at the longest delay of the margin, s.
        present: at the stated delay, s.
    """
    for name, speed, lead in elements:
        own = {u.effect: i for i, u in enumerate(unknowns) if u.element == name and not u.settled}
        K, B = own.get("stiffness"), own.get("damping")
        if K is not None and B is not None and unknowns[B].wish.kind != "value":
            yield K, B, late, present + lead / speed
