"""What moves between motor and hand besides the rigid mass: modes of the mechanism."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict, Field, model_validator

from identification.device.quantities import PositiveQuantity
from identification.documents.document import Document

#: Modes that one axis may state; each adds two to the degree of the loop.
MOST_MODES = 4
#: A participation beyond it belongs to another choice of the rigid mass.
LARGEST_PARTICIPATION = 100.0


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
