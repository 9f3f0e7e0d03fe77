"""Hardware: what is known of an axis before a log is taken, the modes of its mechanism too."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import ConfigDict, Field, model_validator

from identification.device.nameplate import Day, Label
from identification.device.quantities import LARGEST, AnyQuantity, PositiveQuantity, Source
from identification.documents.document import Document
from identification.trajectory import Motion

#: s: a loop of 10 MHz.
SHORTEST_STEP = 1e-7
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
    """What is known before a log is taken (hardware.yaml); every key optional.

    A key that is absent or blank is not stated. Before anything is certified, motion, sample time,
    encoder resolution and force limit must be, and the delay unless the log tells it.

    Attributes:
        name: of the device.
        axis: name of the axis.
        serial: serial number.
        date: of the calibration, year-month-day.
        operator: who takes the logs.
        motion: "linear" (N, m) or "rotary" (N·m, rad); None where nobody stated it.
        sample_time: s, of the control loop.
        delay: s, from command to measurement.
        encoder_resolution: m (rad), one count at the handle.
        force_limit: N (N·m) at the handle.
        modes: vibration of the mechanism.
        current_lag: s, time constant of the current loop, if it is slow.
    """

    schema_: Literal["haptune/hardware/1"] = Field(default="haptune/hardware/1", alias="schema")
    name: str = "device"
    axis: str = "x"
    serial: Label | None = None
    date: Day | None = None
    operator: Label | None = None
    motion: Motion | None = None
    sample_time: AnyQuantity | None = None
    delay: AnyQuantity | None = None
    encoder_resolution: PositiveQuantity | None = None
    force_limit: ForceLimit | None = None
    modes: tuple[Mode, ...] = Field(default=(), max_length=MOST_MODES)
    current_lag: PositiveQuantity | None = None

    @model_validator(mode="after")
    def _sane(self) -> Hardware:
        if self.sample_time is not None and self.sample_time.low < SHORTEST_STEP:
            raise ValueError(
                f"sample_time must be {SHORTEST_STEP:g} s or more, not {self.sample_time.low:g} s"
            )
        if self.delay is not None and self.delay.low < 0:
            raise ValueError(f"delay must not be negative, not {self.delay.low:g} s")
        return self
