"""Hardware: what is known of an axis before a log is taken."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from identification.device.mechanism import MOST_MODES, Mode
from identification.device.quantities import LARGEST, AnyQuantity, PositiveQuantity, Source
from identification.documents.document import Document
from identification.trajectory import Motion

#: s: a loop of 10 MHz.
SHORTEST_STEP = 1e-7


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
