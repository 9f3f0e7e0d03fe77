"""Quantity: a number with its interval, and how it stands in a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, cast

from pydantic import (
    AfterValidator,
    BeforeValidator,
    PlainSerializer,
    WithJsonSchema,
    model_validator,
)

from identification.documents.document import Document

#: No quantity of a device comes near it in SI units; beyond, formulas overflow.
LARGEST = 1e9

Source = Literal["hardware", "log", "assumed"]


class Quantity(Document):
    """A number with its 95 % interval; in a file a bare number or {value, low, high, source}."""

    value: float
    low: float
    high: float
    source: Source | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Quantity:
        if max(abs(self.low), abs(self.high)) > LARGEST:
            raise ValueError(f"must lie within ±{LARGEST:g}, not {self.low:g} to {self.high:g}")
        if not self.low <= self.value <= self.high:
            raise ValueError(
                f"needs low <= value <= high, not {self.low:g}, {self.value:g}, {self.high:g}"
            )
        return self

    @property
    def exact(self) -> bool:
        """True when no interval was given."""
        return self.low == self.high


def _to_quantity(raw: object) -> object:
    if isinstance(raw, str | bool | None):
        raise ValueError("give a number or {value: …, low: …, high: …}")
    if isinstance(raw, int | float):
        return {"value": raw, "low": raw, "high": raw}
    if isinstance(raw, Mapping):
        stated = cast("Mapping[str, object]", raw)
        return {"low": stated.get("value"), "high": stated.get("value"), **stated}
    return raw


def _from_quantity(quantity: Quantity) -> float | dict[str, Any]:
    content: dict[str, Any] = {"value": quantity.value}
    if not quantity.exact:
        content |= {"low": quantity.low, "high": quantity.high}
    if quantity.source is not None:
        content["source"] = quantity.source
    return content if len(content) > 1 else quantity.value


def _in_file(number: dict[str, Any], description: str) -> WithJsonSchema:
    """What a quantity looks like in a file, for the JSON Schemas."""
    return WithJsonSchema(
        {
            "title": "Quantity",
            "description": description,
            "anyOf": [
                number,
                {
                    "type": "object",
                    "properties": {
                        "value": number,
                        "low": number,
                        "high": number,
                        "source": {
                            "anyOf": [{"enum": ["hardware", "log", "assumed"]}, {"type": "null"}]
                        },
                    },
                    "required": ["value"],
                    "additionalProperties": False,
                },
            ],
        }
    )


def _positive(quantity: Quantity) -> Quantity:
    if quantity.low <= 0:
        raise ValueError(f"must be greater than 0 over its interval, not {quantity.low:g}")
    return quantity


AnyQuantity = Annotated[
    Quantity,
    BeforeValidator(_to_quantity),
    PlainSerializer(_from_quantity, when_used="always"),
    _in_file({"type": "number"}, "a number, or a value with its 95 % interval"),
]
PositiveQuantity = Annotated[
    Quantity,
    BeforeValidator(_to_quantity),
    AfterValidator(_positive),
    PlainSerializer(_from_quantity, when_used="always"),
    _in_file(
        {"type": "number", "exclusiveMinimum": 0},
        "a number above zero, or a value with its 95 % interval",
    ),
]


def quantity(
    value: float, low: float | None = None, high: float | None = None, source: Source | None = None
) -> Quantity:
    """A Quantity from a value and, if it is uncertain, its 95 % interval."""
    return Quantity(
        value=value,
        low=value if low is None else low,
        high=value if high is None else high,
        source=source,
    )
