"""Friction as a device states it, where one damping and one Coulomb friction do not say all."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from identification.device.quantities import LARGEST, AnyQuantity
from identification.documents.document import Document

Kind = Literal["drag", "falling", "place", "position", "memory"]

#: What each kind is called in a sentence.
KINDS: dict[Kind, str] = {
    "drag": "drag that grows faster than speed",
    "falling": "friction that falls with speed (Stribeck)",
    "place": "damping that depends on position",
    "position": "a force of position (cogging, a cable's pull)",
    "memory": "friction with a memory (presliding, cables)",
}


class ByDirection(Document):
    """A quantity that differs with the direction of motion.

    Attributes:
        forward: while the velocity is positive.
        backward: while the velocity is negative.
    """

    forward: AnyQuantity
    backward: AnyQuantity


class SlopeRange(Document):
    """Least and largest slope of a force: of friction over speed, or of a spring over position."""

    low: float = Field(ge=-LARGEST, le=LARGEST)
    high: float = Field(ge=-LARGEST, le=LARGEST)

    @model_validator(mode="after")
    def _ordered(self) -> SlopeRange:
        if self.low > self.high:
            raise ValueError(f"needs low <= high, not {self.low:g} and {self.high:g}")
        return self


class UnmodelledForce(Document):
    """A kind of force that a log shows and the model of the device lacks.

    Attributes:
        kind: as in KINDS.
        share: its rms over the rms of the force.
    """

    kind: Kind
    share: float = Field(ge=0)

    @property
    def words(self) -> str:
        """The kind in a sentence."""
        return KINDS[self.kind]

    @property
    def rises(self) -> bool:
        """Whether it rises with speed, so that its slopes are all that a loop feels of it."""
        return self.kind == "drag"
