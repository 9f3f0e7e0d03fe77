"""Hardware (known before a log is taken) and Device (hardware plus what was identified)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    WithJsonSchema,
    model_validator,
)

from identification.documents import Document, load_document
from identification.errors import InvalidInputError
from identification.trajectory import Motion

#: Probability that the simultaneous box holds every identified quantity.
BOX_CONFIDENCE = 0.999
#: Half-width of a 95 % interval of a normal variable, in standard deviations.
_Z95 = 1.959963984540054

#: No quantity of a device comes near it in SI units; beyond, formulas overflow.
LARGEST = 1e9
#: kg (kg·m²): a milligram at a lever of a millimetre.
LIGHTEST = 1e-12
#: s: a loop of 10 MHz.
SHORTEST_STEP = 1e-7

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


#: What a quantity looks like in a file, for the JSON Schemas.
_IN_FILE: dict[str, Any] = {
    "title": "Quantity",
    "description": "a number, or a value with its 95 % interval",
    "anyOf": [
        {"type": "number"},
        {
            "type": "object",
            "properties": {
                "value": {"type": "number"},
                "low": {"type": "number"},
                "high": {"type": "number"},
                "source": {"anyOf": [{"enum": ["hardware", "log", "assumed"]}, {"type": "null"}]},
            },
            "required": ["value"],
            "additionalProperties": False,
        },
    ],
}

AnyQuantity = Annotated[
    Quantity,
    BeforeValidator(_to_quantity),
    PlainSerializer(_from_quantity, when_used="always"),
    WithJsonSchema(_IN_FILE),
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


class ForceLimit(Document):
    """What the actuator can give at the handle, N (N·m if rotary)."""

    continuous: float = Field(ge=0, le=LARGEST)
    peak: float = Field(ge=0, le=LARGEST)
    source: Source | None = None

    @model_validator(mode="after")
    def _ordered(self) -> ForceLimit:
        if self.continuous > self.peak:
            raise ValueError(f"continuous {self.continuous:g} exceeds peak {self.peak:g}")
        return self


class Hardware(Document):
    """What is known before a log is taken (hardware.yaml); every key optional."""

    schema_: Literal["haptune/hardware/1"] = Field(default="haptune/hardware/1", alias="schema")
    name: str = "device"
    axis: str = "x"
    motion: Motion = "linear"
    sample_time: AnyQuantity | None = None
    delay: AnyQuantity | None = None
    encoder_resolution: float | None = Field(default=None, gt=0, le=LARGEST)
    force_limit: ForceLimit | None = None

    @model_validator(mode="after")
    def _sane(self) -> Hardware:
        if self.sample_time is not None and self.sample_time.low < SHORTEST_STEP:
            raise ValueError(
                f"sample_time must be {SHORTEST_STEP:g} s or more, not {self.sample_time.low:g} s"
            )
        if self.delay is not None and self.delay.low < 0:
            raise ValueError(f"delay must not be negative, not {self.delay.low:g} s")
        return self


class Covariance(Document):
    """Joint covariance of everything identified together, in the units of the device."""

    parameters: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]
    degrees_of_freedom: float = Field(gt=0)

    @model_validator(mode="after")
    def _square(self) -> Covariance:
        size = len(self.parameters)
        if len(self.matrix) != size or any(len(row) != size for row in self.matrix):
            raise ValueError(f"matrix must be {size} x {size}, one row for each parameter")
        if any(self.matrix[i][i] < 0 for i in range(size)):
            raise ValueError("matrix has a negative variance")
        return self


class LogRecord(Document):
    """One log the device was identified from, and what was let through."""

    source: str
    digest: str
    samples: int
    method: str
    findings: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Simultaneous region of what is not known exactly; each entry (low, high), SI units."""

    mass: tuple[float, float]
    damping: tuple[float, float]
    sample_time: tuple[float, float]
    delay: tuple[float, float]


def _delay_may_be_left_out(schema: dict[str, Any]) -> None:
    schema["required"].remove("delay")
    schema["properties"]["delay"]["description"] = "s; left out: one sample time"


class Device(Document):
    """One axis of a haptic device: hardware plus what was identified (device.yaml).

    Units for linear motion: kg, N·s/m, N, m, s. A rotary axis reads kg·m², N·m·s/rad, N·m, rad.
    """

    model_config = ConfigDict(json_schema_extra=_delay_may_be_left_out)

    schema_: Literal["haptune/device/1"] = Field(default="haptune/device/1", alias="schema")
    name: str = "device"
    axis: str = "x"
    motion: Motion = "linear"
    sample_time: AnyQuantity
    mass: AnyQuantity
    damping: AnyQuantity
    coulomb_friction: AnyQuantity = quantity(0.0)
    force_offset: AnyQuantity = quantity(0.0)
    delay: AnyQuantity
    encoder_resolution: AnyQuantity | None = None
    force_limit: ForceLimit | None = None
    covariance: Covariance | None = None
    logs: tuple[LogRecord, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _default_delay(cls, raw: Any) -> Any:
        if not isinstance(raw, Mapping) or "delay" in raw or "sample_time" not in raw:
            return cast("object", raw)
        stated = cast("Mapping[str, object]", raw)
        step = stated["sample_time"]
        if isinstance(step, Mapping):
            step = cast("Mapping[str, object]", step).get("value")
        return {**stated, "delay": {"value": getattr(step, "value", step), "source": "assumed"}}

    @model_validator(mode="after")
    def _sane(self) -> Device:
        for name, least in (("sample_time", SHORTEST_STEP), ("mass", LIGHTEST)):
            low = getattr(self, name).low
            if low < least:
                raise ValueError(f"{name} must be {least:g} or more over its interval, not {low:g}")
        if self.delay.low < 0 or self.coulomb_friction.value < 0:
            raise ValueError("delay and coulomb_friction must not be negative")
        if self.encoder_resolution is not None and self.encoder_resolution.low <= 0:
            raise ValueError("encoder_resolution must be positive")
        return self

    def simultaneous_box(self, confidence: float = BOX_CONFIDENCE) -> Box:
        """Box that holds all identified quantities at once with the given probability.

        The 95 % intervals are widened to the bounding box of the joint confidence ellipsoid
        (Hotelling's T² with the covariance's degrees of freedom; χ² when none are stored). Mass is
        widened on a logarithmic scale, because it cannot be negative; damping is left free to be
        negative, because a compensated axis may be. Sample time and delay are taken as stated.
        """
        from scipy.special import chdtri, fdtri

        uncertain = [self.mass, self.damping, self.coulomb_friction, self.force_offset]
        count = max(2, sum(not item.exact for item in uncertain))
        freedom = np.inf
        if self.covariance is not None:
            count = max(count, len(self.covariance.parameters))
            freedom = self.covariance.degrees_of_freedom
        if np.isinf(freedom) or freedom > 1e6:
            radius = np.sqrt(chdtri(count, 1 - confidence))
        elif freedom > count:
            spread = freedom - count + 1
            radius = np.sqrt(count * freedom / spread * fdtri(count, spread, confidence))
        else:
            raise InvalidInputError(
                "covariance",
                f"degrees_of_freedom is {freedom:g} for {count} parameters",
                "Identify from a longer log",
            )
        widen = float(radius) / _Z95
        mass = (
            self.mass.value * (self.mass.low / self.mass.value) ** widen,
            self.mass.value * (self.mass.high / self.mass.value) ** widen,
        )
        damping = (
            self.damping.value - widen * (self.damping.value - self.damping.low),
            self.damping.value + widen * (self.damping.high - self.damping.value),
        )
        return Box(
            mass=mass,
            damping=damping,
            sample_time=(self.sample_time.low, self.sample_time.high),
            delay=(self.delay.low, self.delay.high),
        )


NAMED = Path(__file__).parent / "named"


def named_devices() -> tuple[str, ...]:
    """Names of the devices that come with haptune."""
    return tuple(sorted(path.stem for path in NAMED.glob("*.yaml")))


def load_device(reference: str | Path) -> Device:
    """A device from a file, or a named one. Raises InvalidInputError."""
    path = Path(reference)
    # The function of os.path also takes names that no file can have.
    if str(reference) in named_devices() and not os.path.isfile(path):  # noqa: PTH113
        path = NAMED / f"{reference}.yaml"
    elif path.suffix == "" and not os.path.exists(path):  # noqa: PTH110
        raise InvalidInputError(
            reference,
            "is neither a file nor a named device",
            f"Named devices: {', '.join(named_devices())}",
        )
    return load_document(Device, path)
