"""Devices by their numbers."""

from typing import Literal

from identification import Device, quantity

#: A value, or one with both ends of its interval.
Fact = float | tuple[float, float, float]


def known(value: float, part: float) -> Fact:
    """A value that is known to such a part of it."""
    return value, value * (1 - part), value * (1 + part)


def device_of(
    mass: Fact,
    damping: Fact,
    *,
    step: Fact,
    delay: Fact,
    count: float,
    force: float,
    peak: float | None = None,
    friction: float | None = None,
    motion: Literal["linear", "rotary"] = "linear",
) -> Device:
    """A device of these facts; twice its lasting force for a moment, if nothing else is said."""
    facts = {"mass": mass, "damping": damping, "sample_time": step, "delay": delay}
    facts |= {} if friction is None else {"coulomb_friction": friction}
    return Device.model_validate(
        {
            "motion": motion,
            "encoder_resolution": count,
            "force_limit": {"continuous": force, "peak": peak or 2 * force},
            **{n: quantity(*v) if isinstance(v, tuple) else v for n, v in facts.items()},
        }
    )
