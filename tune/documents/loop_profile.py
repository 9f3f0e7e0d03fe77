"""The loop part of a profile: sample time, delay, and the very filters that the controller runs."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from identification import Document
from tune.documents.scene import LARGEST, LONGEST_WINDOW, SMALLEST

#: Names of the settings of both filters, in files, loops, the certificate and the simulator alike.
FILTER_SETTINGS = (
    "velocity_filter_hz",
    "acceleration_filter_hz",
    "velocity_filter_order",
    "acceleration_filter_order",
    "filter_damping_ratio",
    "velocity_window_samples",
)


class LoopProfile(Document):
    """The loop the controller must run: period, delay beyond an immediate loop, the very filters.

    Filters are those of docs/theory.md, 1, evaluated at the sample rate and reset when an element
    is entered; without a cut-off or a window an estimate is a plain backward difference.

    Attributes:
        sample_time: s.
        extra_delay_samples: the device's delay in samples, need not be whole.
        velocity_filter_hz: cut-off, Hz.
        acceleration_filter_hz: cut-off, Hz.
        velocity_filter_order: 1 or 2 poles.
        acceleration_filter_order: 1 or 2 poles.
        filter_damping_ratio: of second-order filters.
        velocity_window_samples: velocity over the last n samples instead of a filter.
    """

    sample_time: float
    extra_delay_samples: float
    velocity_filter_hz: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    acceleration_filter_hz: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    velocity_filter_order: Literal[1, 2] = 1
    acceleration_filter_order: Literal[1, 2] = 2
    filter_damping_ratio: float = Field(default=1.0, ge=0.1, le=1)
    velocity_window_samples: int | None = Field(default=None, ge=1, le=LONGEST_WINDOW)

    @model_validator(mode="after")
    def _one_velocity(self) -> LoopProfile:
        if self.velocity_window_samples is not None and self.velocity_filter_hz is not None:
            raise ValueError("velocity_window_samples takes the place of velocity_filter_hz")
        return self

    def with_effects(self, *, damping: bool, mass: bool) -> LoopProfile:
        """The loop with the filters that these effects use, what they do not use at its default."""
        defaults = {name: field.default for name, field in LoopProfile.model_fields.items()}
        velocity = damping and self.velocity_filter_hz is not None
        acceleration = mass and self.acceleration_filter_hz is not None
        squared = (velocity and self.velocity_filter_order == 2) or (
            acceleration and self.acceleration_filter_order == 2
        )
        used = {
            "velocity_filter_hz": velocity,
            "velocity_filter_order": velocity,
            "velocity_window_samples": damping,
            "acceleration_filter_hz": acceleration,
            "acceleration_filter_order": acceleration,
            "filter_damping_ratio": squared,
        }
        idle = {name: defaults[name] for name, there in used.items() if not there}
        return self.model_copy(update=idle)

    def filter_settings(self) -> dict[str, Any]:
        """What says which filters run, by the names that all of haptune calls them."""
        return {name: getattr(self, name) for name in FILTER_SETTINGS}
