"""The form of haptune_profile.json (haptune/export/1), in SI units (rotary: rad)."""

from __future__ import annotations

from typing import Literal, NotRequired

# pydantic reads this one on every Python; it is part of what pydantic itself needs.
from typing_extensions import TypedDict


class ExportedDevice(TypedDict):
    """The device that the profile is certified for."""

    name: str
    axis: str
    motion: Literal["linear", "rotary"]


class ExportedMargin(TypedDict):
    """Stable for every gain in (0, ``gain``] with so many more samples of delay."""

    name: Literal["conservative", "balanced", "firm"]
    gain: float
    extra_delay_samples: float


class NoFilter(TypedDict):
    """The difference as it is."""

    kind: Literal["none"]


class WindowFilter(TypedDict):
    """The difference over so many samples."""

    kind: Literal["window"]
    samples: int


class LowPassFilter(TypedDict):
    """x[k] = (t·x[k-1] - p·x[k-2]) + g·u[k]; ``a`` is the pole where there is one or two equal."""

    kind: Literal["first-order", "second-order"]
    cutoff_hz: float
    a: NotRequired[float]
    damping_ratio: NotRequired[float]
    t: float
    p: float
    g: float


Filter = NoFilter | WindowFilter | LowPassFilter


class ExportedForceLimit(TypedDict):
    """What the actuator gives for long and for a moment."""

    continuous: float
    peak: float


class ExportedElement(TypedDict):
    """Effects of one element; ``fade_time`` is 0 where it is switched at once.

    ``force_level`` is the most that its spring gives, N (N·m); ``speed`` that with which it is met.
    """

    stiffness: float
    damping: float
    mass: float
    one_sided: bool
    force_level: float
    speed: float
    fade_time: float


class Exported(TypedDict):
    """A certified profile for programs of any kind.

    ``moments`` are the sets of elements that may act at once, ``apart`` pairs that never do;
    ``taps`` are samples; ``law`` says how force comes of them.
    """

    schema: Literal["haptune/export/1"]
    digest: str
    device: ExportedDevice
    scene: str
    margin: ExportedMargin
    sample_time: float
    delay_samples: float
    velocity: Filter
    acceleration: Filter
    force_limit: ExportedForceLimit
    elements: dict[str, ExportedElement]
    moments: list[list[str]]
    apart: list[list[str]]
    taps: int
    largest_change: float
    findings: dict[str, list[str]]
    law: str
    assumes: list[str]
    not_assessed: list[str]
