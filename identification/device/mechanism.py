"""What a mechanism has beside its rigid mass: modes, and friction that no constant describes."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import ConfigDict, Field, model_validator

from identification.device.quantities import LARGEST, PositiveQuantity
from identification.documents.document import Document

#: Modes that one axis may state; each adds two to the degree of the loop.
MOST_MODES = 4
#: A participation beyond it belongs to another choice of the rigid mass.
LARGEST_PARTICIPATION = 100.0

Kind = Literal["drag", "falling", "place", "position", "memory"]

#: What each kind is called in a sentence.
KINDS: dict[Kind, str] = {
    "drag": "drag that grows faster than speed",
    "falling": "friction that falls with speed (Stribeck)",
    "place": "damping that depends on position",
    "position": "a force of position (cogging, a cable's pull)",
    "memory": "friction with a memory (presliding, cables)",
}


def _handle_may_be_left_out(schema: dict[str, Any]) -> None:
    schema["properties"]["at_handle"]["description"] = "left out: the same as at_encoder"


class Mode(Document):
    """One vibration mode of the mechanism, in generalised coordinates.

    m·(q̈ᵢ + 2·ζ·ω·q̇ᵢ + ω²·qᵢ) = e·F - h·F_hand beside the rigid coordinate of mass m; the encoder
    reads q₀ + Σ e·qᵢ and the handle moves by q₀ + Σ h·qᵢ. A motor of mass m₁ and a handle of mass
    m₂ on a spring have e = √(m₂/m₁) and h = -√(m₁/m₂).

    Attributes:
        frequency_hz: ω/2π, Hz, without damping.
        damping_ratio: ζ.
        at_encoder: e, the participation where the motor pulls and the encoder reads.
        at_handle: h, the participation at the handle; left out: the same as at_encoder.
    """

    model_config = ConfigDict(json_schema_extra=_handle_may_be_left_out)

    frequency_hz: PositiveQuantity
    damping_ratio: PositiveQuantity
    at_encoder: float = Field(ge=-LARGEST_PARTICIPATION, le=LARGEST_PARTICIPATION)
    at_handle: float = Field(ge=-LARGEST_PARTICIPATION, le=LARGEST_PARTICIPATION)

    @model_validator(mode="before")
    @classmethod
    def _grip_at_the_encoder(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and "at_handle" not in raw and "at_encoder" in raw:
            return {**raw, "at_handle": raw["at_encoder"]}  # pyright: ignore[reportUnknownVariableType]
        return raw  # pyright: ignore[reportUnknownVariableType]

    @model_validator(mode="after")
    def _underdamped(self) -> Mode:
        if self.damping_ratio.high >= 1:
            raise ValueError(
                f"damping_ratio must be below 1 over its interval, not {self.damping_ratio.high:g}"
                "; what does not vibrate is no mode"
            )
        return self


class SlopeRange(Document):
    """Least and largest slope of friction over speed, N·s/m (N·m·s/rad)."""

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
