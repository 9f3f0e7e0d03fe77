"""Hand: what an operator's grip adds to the device, as a box of passive impedances."""

from __future__ import annotations

from typing import Annotated, Any, Literal, cast

from pydantic import BeforeValidator, WithJsonSchema, model_validator

from identification import AnyQuantity, Document, quantity


class Hand(Document):
    """A grip as mass, damper and spring to a place that rests: m_h·ẍ + b_h·ẋ + k_h·x.

    Every combination within the three intervals is certified, and the device without any hand.
    Intervals that end where they begin say that the grip is known.

    Attributes:
        mass: m_h, kg (kg·m² if rotary), not negative.
        damping: b_h, N·s/m (N·m·s/rad), not negative.
        stiffness: k_h, N/m (N·m/rad), positive, or exactly zero for a hand that only follows.
    """

    mass: AnyQuantity
    damping: AnyQuantity
    stiffness: AnyQuantity

    @model_validator(mode="after")
    def _passive(self) -> Hand:
        for name in ("mass", "damping", "stiffness"):
            low = getattr(self, name).low
            if low < 0:
                raise ValueError(f"{name} of a hand must not be negative, not {low:g}")
        if self.stiffness.low == 0 < self.stiffness.high:
            raise ValueError(
                "stiffness of a hand must be zero, or above zero over its interval, not 0 to "
                f"{self.stiffness.high:g}; the device without a hand is certified in any case"
            )
        return self


#: From two fingers that hardly touch to an arm that braces itself: rounded outwards from measured
#: ranges, quoted from memory. Fingertip impedance (Hajian and Howe 1997): some grams, 4 to 7 N·s/m,
#: 0.25 to 1.3 kN/m; arm stiffness (Mussa-Ivaldi, Hogan and Bizzi 1985): 0.1 to 0.8 kN/m. Rotary
#: axes have the same at a lever of 20 mm.
FREE_TO_RIGID: dict[Literal["linear", "rotary"], Hand] = {
    "linear": Hand(
        mass=quantity(0.1, 0.005, 1.0),
        damping=quantity(5.0, 1.0, 30.0),
        stiffness=quantity(300.0, 20.0, 2000.0),
    ),
    "rotary": Hand(
        mass=quantity(4e-5, 2e-6, 4e-4),
        damping=quantity(2e-3, 4e-4, 1.2e-2),
        stiffness=quantity(0.12, 8e-3, 0.8),
    ),
}


def _to_hand(raw: object) -> object:
    if isinstance(raw, dict | Hand) or raw in ("none", "free-to-rigid"):
        return cast("object", raw)
    raise ValueError("give none, free-to-rigid, or {mass: …, damping: …, stiffness: …}")


def _in_file() -> WithJsonSchema:
    schema = Hand.model_json_schema()
    own: dict[str, Any] = {
        "type": "object",
        "properties": cast("dict[str, Any]", schema["properties"]),
        "required": ["mass", "damping", "stiffness"],
        "additionalProperties": False,
    }
    return WithJsonSchema({"anyOf": [{"enum": ["none", "free-to-rigid"]}, own]})


#: What a scene says of the hand.
AnyHand = Annotated[Hand | Literal["none", "free-to-rigid"], BeforeValidator(_to_hand), _in_file()]


def hand_of(stated: Hand | str, motion: Literal["linear", "rotary"]) -> Hand | None:
    """The box a scene's word stands for on a linear or rotary axis; None for no hand."""
    if isinstance(stated, Hand):
        return stated
    return FREE_TO_RIGID[motion] if stated == "free-to-rigid" else None
