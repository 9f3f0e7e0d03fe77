"""What a hand must feel of an element: rendered mass and damping within one step of what it asks.

At both ends of the motions people make, parasitic parts included (docs/theory.md, 8): with κ of a
mass, ν of a damper and so on, m + κM + νB lies within a step of m + M and b + κ'B + ρM + ηK of
b + B. Where steps are ratios this is linear in the sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EffectName
from tune.documents.perception import Scale
from tune.optimisation.unknown import Unknown
from tune.rendering.rendered import Band, Shares

FloatArray = NDArray[np.float64]

#: Of the step within which an effect has to be felt; the rest is for the digits of what is written.
_OF_A_STEP = 0.997
#: Newton's method ends where it moves by less, relative.
_SAME = 1e-14


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rendering:
    """One end of the step within which an element's mass or damping is felt.

    Attributes:
        scale: of what is felt.
        given: what each size is felt as, shape (unknowns,), no unit or that of one over another.
        asked: what each size asks for, shape (unknowns,), likewise.
        least: total that may be asked for, with the device's own.
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
        """What sizes of shape (unknowns, ...) use of it, 1 is all: shape (...)."""
        felt, asked = (np.tensordot(part, sizes, axes=1) for part in (self.given, self.asked))
        return self.per_step * (self.scale.height(felt) - self.scale.height(asked))

    def row(self, asked: float) -> FloatArray:
        """The tangent where so much is asked for, as the a of a·sizes <= 1, shape (unknowns,).

        What one step reaches upwards is convex in what is asked for, what it reaches downwards is
        concave: what a tangent allows is allowed.
        """
        own, corner = self.scale.reference, self.scale.corner
        place = min(own + asked, max(own, self._straight_from))
        end = place + replace(self.scale, reference=place).value_at(_OF_A_STEP, self.sign)
        slope = max(end, corner) / max(place, corner)
        return (self.given - slope * self.asked) / (end - own - slope * (place - own))

    def bound(self, sizes: FloatArray, index: int) -> float:
        """How large one size may be beside the others, by Newton's method from zero; inf if any.

        Sizes have shape (unknowns,).
        """
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

    Args:
        unknowns: of all elements.
        shares: what one unit of each effect is felt as.
        scale: of an effect of an element, by name.
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
