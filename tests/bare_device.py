"""A device of which only mass and damping are known, and all that a log can tell beside them."""

from __future__ import annotations

from typing import Any

from identification import Device

BARE: dict[str, Any] = {"sample_time": 1e-3, "mass": 3.0, "damping": 10.0, "delay": 1e-3}


def device(**changes: Any) -> Device:
    """The bare device with some keys of its file changed or added."""
    return Device.model_validate(BARE | changes)


#: Everything a log can tell beyond mass, damping, friction and offset.
BEYOND: dict[str, Any] = {
    "damping_by_direction": {
        "forward": {"value": 9.0, "low": 8.5, "high": 9.5},
        "backward": {"value": 12.0, "low": 11.0, "high": 13.0},
    },
    "friction_by_direction": {"forward": 0.5, "backward": {"value": 0.7, "low": 0.6, "high": 0.8}},
    "position_stiffness": {"value": -3.0, "low": -4.0, "high": -2.0},
    "gravity": {"sine": 1.5, "cosine": {"value": 0.1, "low": -0.1, "high": 0.3}},
}
