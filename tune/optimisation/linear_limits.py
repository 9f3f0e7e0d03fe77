"""Unknowns of the design problem, and the limits on them that are linear, or nearly so.

Each row reads a·sizes <= 1: forces of the stated motions, what a hand must feel, walls' leads.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tune.documents.perception import Scale
from tune.documents.scene import EffectName, Wish
from tune.rendering import Band, Shares

FloatArray = NDArray[np.float64]


LinearWord = Literal["force", "rendering", "lead"]
#: Of the step within which an effect has to be felt; the rest is for the digits of what is written.
_OF_A_STEP = 0.997
#: Newton's method ends where it moves by less, relative.
_SAME = 1e-14
#: N: an actuator without any force is taken to have this much.
_NO_FORCE = 1e-30
#: Walls to begin a search with: so many, up to so many times the least stiffness, with dampers at
#: these parts of the way from the least to the most.
_WALLS, _STIFFEST, _BETWEEN = 64, 1e6, (0.05, 0.5, 0.95)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """One effect of one element whose size is looked for.

    Attributes:
        sign: -1 where something is taken away from the device.
        low: least size that is kept, SI: one perceived step, or where a range begins.
        high: largest size wanted or physically sensible.
        scale: of the commanded size, of which a share is rendered at the motions people make.
        level: rank; what is settled is level -1, wanted values are level 0, then twice the
            priorities of the elements, the damping of a wall after its stiffness.
        yields: steps that it gives up at most for what its own element has of the next rank.
        weight: exponent of its steps in the product, more than 1 where it is favoured.
    """

    element: str
    effect: EffectName
    sign: int
    low: float
    high: float
    wish: Wish
    scale: Scale
    level: int
    yields: float = 0.0
    weight: float = 1.0

    @property
    def settled(self) -> bool:
        """Whether its size was found before, beside which others are looked for."""
        return self.level < 0

    @property
    def label(self) -> str:
        """Name for messages and keys, element.effect."""
        return f"{self.element}.{self.effect}"

    def steps(self, size: float) -> float:
        """Perceived steps of a size."""
        return self.scale.steps(self.sign * size)

    @property
    def goal(self) -> float:
        """Steps of a wanted value, which count as all there is to reach; 1 elsewhere."""
        return self.steps(self.high) if self.wish.kind == "value" else 1.0

    def size_at(self, steps: float | FloatArray) -> FloatArray:
        """The size that is perceived as so many steps, of their shape."""
        given = np.asarray(steps, dtype=np.float64)
        return self.sign * self.scale.value_at(given, self.sign)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rendering:
    """One end of the step within which an element's mass or damping is felt.

    At both ends of the motions people make, parasitic parts included (docs/theory.md, 8): with κ
    of a mass, ν of a damper and so on, m + κM + νB lies within a step of m + M and b + κ'B + ρM +
    ηK of b + B. Where steps are ratios this is linear in the sizes.

    Attributes:
        scale: of what is felt.
        least: total that may be asked for, with the device's own.
        given: what each size is felt as, shape (unknowns,), no unit or that of one over another.
        asked: what each size asks for, shape (unknowns,), likewise.
        sign: 1 of the upper end, -1 of the lower.
    """

    scale: Scale
    least: float
    given: FloatArray
    asked: FloatArray
    sign: int

    @property
    def bent(self) -> bool:
        """Whether what a step allows is not in proportion to what is asked for."""
        return bool(np.any(self.asked)) and self._straight_from > self.least

    @property
    def _straight_from(self) -> float:
        """Beyond this one step reaches from a total to a multiple of it."""
        return self.scale.corner * (1 + self.scale.weber)

    @property
    def per_step(self) -> float:
        """What a difference of heights, `Scale.height`, uses of the limit."""
        return self.sign / (_OF_A_STEP * float(np.log1p(self.scale.weber)))

    def used(self, sizes: FloatArray) -> FloatArray:
        """What sizes of shape (unknowns, ...) use of it, 1 is all."""
        felt, asked = (np.tensordot(part, sizes, axes=1) for part in (self.given, self.asked))
        return self.per_step * (self.scale.height(felt) - self.scale.height(asked))

    def row(self, asked: float) -> FloatArray:
        """The tangent where so much is asked for, as the a of a·sizes <= 1.

        What one step reaches upwards is convex in what is asked for, what it reaches downwards is
        concave: what a tangent allows is allowed.
        """
        own, corner = self.scale.reference, self.scale.corner
        place = min(own + asked, max(own, self._straight_from))
        end = place + replace(self.scale, reference=place).value_at(_OF_A_STEP, self.sign)
        slope = max(end, corner) / max(place, corner)
        return (self.given - slope * self.asked) / (end - own - slope * (place - own))

    def bound(self, sizes: FloatArray, index: int) -> float:
        """How large one size may be beside the others, by Newton's method from zero; inf if any."""
        felt, asked = float(self.given[index]), float(self.asked[index])
        far = np.exp(1 / self.per_step) if asked > 0 else 1.0
        if self.sign * (felt - far * asked) <= 0:
            return np.inf
        rest = sizes.copy()
        rest[index] = 0.0
        most, before = 0.0, -1.0
        while most > before * (1 + _SAME):
            row, before = self.row(float(self.asked @ rest) + asked * most), most
            most = max(most, float((1 - row @ rest) / row[index]))
        return most


def renderings(
    unknowns: Sequence[Unknown],
    shares: Shares,
    scale: Callable[[str, EffectName], Scale],
    walls: Collection[str],
) -> Iterator[Rendering]:
    """Mass and damping felt of every element against what it asks for, at both ends.

    An element whose every effect is a wanted value is met as it is commanded, and so is a wall,
    which nobody moves in; the profile says what is felt of them.
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
            own = scale(name, felt)
            less = [u.high for u in unknowns if (u.element, u.effect, u.sign) == (name, felt, -1)]
            least = own.reference - sum(less)
            for end in ("slowest", "fastest"):
                asked, given = np.zeros(len(unknowns)), np.zeros(len(unknowns))
                for index, unknown in enumerate(unknowns):
                    if unknown.element == name and unknown.effect in parts:
                        given[index] = unknown.sign * getattr(parts[unknown.effect], end)
                        asked[index] = unknown.sign * (unknown.effect == felt)
                for sign in (1, -1):
                    yield Rendering(scale=own, least=least, given=given, asked=asked, sign=sign)


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Elements felt at once: which unknowns add up, and the motion of each element.

    Attributes:
        members: indices of unknowns, for K, B and M.
        reach: (penetration, m; speed, m/s; acceleration, m/s²) for each unknown, in the order of
            ``members``; None where the force is cut by a clamp and bounds nothing.
        absolute: the moment must be absolutely stable: the clamp of one of its springs may be
            reached, as that of a wall always is.
        meeting: a wall is met beside other elements; its ripple is told, not bound.
    """

    elements: tuple[str, ...]
    members: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
    reach: tuple[tuple[float | None, ...], tuple[float | None, ...], tuple[float | None, ...]]
    absolute: bool = False
    meeting: bool = False

    @property
    def lone(self) -> int | None:
        """The only unknown of the moment, None where there are several or none."""
        found = [index for indices in self.members for index in indices]
        return found[0] if len(found) == 1 else None


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
        """The limits of rows of forces, of what is felt and of leads.

        A row without a positive coefficient never binds.
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
        leads = self.leads
        return [pair for K, B, low, high in leads for pair in ((K, B, low), (B, K, 1 / high))]

    def lead_points(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Walls of all stiffnesses with dampers between their least and most, the rest at least."""
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
        """Points with the dampers of walls moved to between their least and most."""
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
        """How large one unknown may be beside the others as they are, by the limit; inf if any."""
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
    moments: Sequence[Moment], unknowns: int, continuous: float | None, peak: float | None
) -> Iterator[FloatArray]:
    """Sustained force K·penetration and peak force K·penetration + |B|·speed + |M|·acceleration."""
    for moment in moments:
        costs = np.zeros((len(moment.members), unknowns))
        for cost, members, reaches in zip(costs, moment.members, moment.reach, strict=True):
            cost[list(members)] = [reach or 0.0 for reach in reaches]
        if continuous is not None:
            yield costs[0] / max(continuous, _NO_FORCE)
        if peak is not None:
            yield costs.sum(axis=0) / max(peak, _NO_FORCE)
