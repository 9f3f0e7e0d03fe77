"""What a hand must feel of an element: within one step of what it asks for, as linear limits.

What is felt of its mass and damping at both ends of the motions people make, parasitic parts
included, lies within one step of what the element asks for (docs/theory.md, 8): with κ of a mass,
ν of a damper and so on, (m + κM + νB)/(m + M) and (b + κ'B + ρM + ηK)/(b + B) lie between 1/(1 + w)
and 1 + w, or so many smallest forces apart. The largest that one step from what is asked reaches is
convex in it, the least is concave: the tangent of either is a limit that keeps to them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EffectName
from tune.documents.steps import Scale
from tune.optimisation.unknown import Unknown
from tune.rendering.rendered import Band, Shares

FloatArray = NDArray[np.float64]

#: Of the step within which an effect has to be felt; the rest is for the digits of what is written.
_OF_A_STEP = 0.997


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rendering:
    """One end of the step within which an element's mass or damping is felt.

    Attributes:
        scale: of what is felt.
        given: what each size is felt as, shape (unknowns,), no unit or that of one over another.
        asked: what each size asks for, likewise.
        sign: 1 of the upper end, -1 of the lower.
    """

    scale: Scale
    given: FloatArray
    asked: FloatArray
    sign: int

    @property
    def bent(self) -> bool:
        """Whether the step depends on what is asked for otherwise than in proportion."""
        return bool(np.any(self.asked)) and self._straight_from > self.scale.reference

    @property
    def _straight_from(self) -> float:
        """Beyond this what one step reaches is proportional to where it begins."""
        return self.scale.corner * (1 + self.scale.weber)

    def row(self, sizes: FloatArray) -> FloatArray:
        """The tangent at what some sizes ask for, as the a of a·sizes <= 1; shapes (unknowns,)."""
        own, corner = self.scale.reference, self.scale.corner
        place = min(own + float(self.asked @ sizes), max(own, self._straight_from))
        end = place + replace(self.scale, reference=place).value_at(_OF_A_STEP, self.sign)
        slope = max(end, corner) / max(place, corner)
        return (self.given - slope * self.asked) / (end - own - slope * (place - own))


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
            for end in ("slowest", "fastest"):
                asked, given = np.zeros(len(unknowns)), np.zeros(len(unknowns))
                for index, unknown in enumerate(unknowns):
                    if unknown.element == name and unknown.effect in parts:
                        given[index] = unknown.sign * getattr(parts[unknown.effect], end)
                        asked[index] = unknown.sign * (unknown.effect == felt)
                for sign in (1, -1):
                    yield Rendering(scale=scale(name, felt), given=given, asked=asked, sign=sign)
