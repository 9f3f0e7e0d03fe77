"""Linear limits: forces of the stated motions, and what a hand must feel.

Each row reads a·sizes <= 1. What is felt of an element's mass and damping at both ends of the
motions people make, its parasitic parts included, lies within one step of what the element asks for
(docs/theory.md, 8): with κ of a mass, ν of a damper and so on, (m + κM + νB)/(m + M) and
(b + κ'B + ρM + ηK)/(b + B) lie between 1/(1 + w) and 1 + w.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EffectName
from tune.documents.perception import PerceptionTable
from tune.optimisation.unknown import Unknown
from tune.rendering.rendered import Band, Shares

FloatArray = NDArray[np.float64]
LinearWord = Literal["force", "rendering", "lead"]

#: N: an actuator without any force is taken to have this much.
_NO_FORCE = 1e-30
#: Of the step within which an effect has to be felt; the rest is for the digits of what is written.
_OF_A_STEP = 0.997


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
    """Rows a·sizes <= 1, and ratios of two sizes.

    Attributes:
        rows: shape (rows, unknowns).
        words: which limit each row is.
        leads: (spring, damper, least and most of damping over stiffness, s) of walls.
    """

    rows: FloatArray
    words: tuple[LinearWord, ...]
    leads: tuple[tuple[int, int, float, float], ...] = ()

    @classmethod
    def of(
        cls,
        rows: Iterable[tuple[LinearWord, FloatArray]],
        unknowns: int,
        leads: Iterable[tuple[int, int, float, float]] = (),
    ) -> LinearLimits:
        """The rows that can bind, each of shape (unknowns,), and ratios.

        A row without a positive coefficient never does.
        """
        kept: list[tuple[LinearWord, FloatArray]] = [
            (word, row) for word, row in rows if np.any(row > 0)
        ]
        words: list[LinearWord] = [word for word, _ in kept]
        table = np.array([row for _, row in kept]).reshape(len(kept), unknowns)
        return cls(rows=table, words=tuple(words), leads=tuple(leads))

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
        if not self.leads:
            return used
        tiny = np.finfo(float).tiny
        found = [factor * sizes[i] / np.maximum(sizes[j], tiny) for i, j, factor in self.ratios]
        return np.concatenate([used, np.stack(found)])

    def bounds(self, sizes: FloatArray, index: int) -> dict[LinearWord, float]:
        """How large one unknown may be beside the others as they are, by the limit; inf if any.

        Sizes have shape (unknowns,).
        """
        found: dict[LinearWord, float] = {}
        for i, j, factor in self.ratios:
            if i == index and sizes[j] > 0:
                found["lead"] = min(found.get("lead", np.inf), float(sizes[j]) / factor)
        rest = sizes.copy()
        rest[index] = 0.0
        spare = 1 - self.rows @ rest
        for word, row, left in zip(self.words, self.rows, spare.tolist(), strict=True):
            if row[index] > 0:
                found[word] = min(found.get(word, np.inf), max(0.0, left / float(row[index])))
        return found


def force_rows(
    moments: Sequence[ForceReach], unknowns: int, continuous: float | None, peak: float | None
) -> Iterator[tuple[LinearWord, FloatArray]]:
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
            yield "force", costs[0] / max(continuous, _NO_FORCE)
        if peak is not None:
            yield "force", costs.sum(axis=0) / max(peak, _NO_FORCE)


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


def rendering_rows(
    unknowns: Sequence[Unknown],
    shares: Shares,
    device: dict[EffectName, float],
    table: PerceptionTable,
    walls: Collection[str],
) -> Iterator[tuple[LinearWord, FloatArray]]:
    """Mass and damping felt of every element against what it asks for, at both ends.

    An element whose every effect is a wanted value is met as it is commanded, and so is a wall,
    which nobody moves in; the profile says what is felt of them.

    Each row has shape (unknowns,), one over the unit of its unknown.

    Args:
        unknowns: of all elements.
        shares: what one unit of each effect is felt as.
        device: mass and damping that a hand feels without any effect.
        table: whose Weber fractions make a step.
        walls: names of elements that push on one side only.
    """
    adds: dict[EffectName, dict[EffectName, Band]] = {
        "mass": {"mass": shares.mass, "damping": shares.mass_of_damping},
        "damping": {
            "damping": shares.damping,
            "mass": shares.damping_of_mass,
            "stiffness": shares.damping_of_stiffness,
        },
    }
    free = (u.element for u in unknowns if u.wish.kind != "value" and u.element not in walls)
    for name in dict.fromkeys(free):
        for felt, parts in adds.items():
            own = device[felt]
            step = (1 + table.fraction(felt).value) ** _OF_A_STEP
            for end in ("slowest", "fastest"):
                asked, given = np.zeros(len(unknowns)), np.zeros(len(unknowns))
                for index, unknown in enumerate(unknowns):
                    if unknown.element == name and unknown.effect in parts:
                        given[index] = unknown.sign * getattr(parts[unknown.effect], end)
                        asked[index] = unknown.sign * (unknown.effect == felt)
                yield "rendering", (given - step * asked) / (own * (step - 1))
                yield "rendering", (asked / step - given) / (own * (1 - 1 / step))
