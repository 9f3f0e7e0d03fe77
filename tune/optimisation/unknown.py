"""One unknown of the design problem: the size of one effect of one element."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tune.documents.effects import EffectName
from tune.documents.perception import perceived_steps, value_at_steps
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
        reference: the commanded size that is felt as much as what the device has of it: K_ref, b
            or m over the share of the command that is rendered at the motions people make, SI.
        weber: Weber fraction.
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
    reference: float
    weber: float
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
        return perceived_steps(self.sign * size, self.reference, self.weber)

    @property
    def goal(self) -> float:
        """Steps of a wanted value, which count as all there is to reach; 1 elsewhere."""
        return self.steps(self.high) if self.wish.kind == "value" else 1.0

    def size_at(self, steps: float | FloatArray) -> FloatArray:
        """The size that is perceived as so many steps, of their shape."""
        given = np.asarray(steps, dtype=np.float64)
        return self.sign * value_at_steps(given, self.reference, self.weber, self.sign)
