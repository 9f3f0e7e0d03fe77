"""One unknown of the design problem: the size of one effect of one element."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EffectName
from tune.documents.perception import Scale
from tune.documents.scene import Wish

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """One effect of one element whose size is looked for.

    Attributes:
        element: name in the scene.
        effect: which of K, B, M.
        sign: -1 where something is taken away from the device.
        low: least size that is kept, SI: one perceived step, or where a range begins.
        high: largest size wanted or physically sensible.
        wish: what the scene says.
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
