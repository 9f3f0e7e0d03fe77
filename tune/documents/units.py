"""Units of a design's effects, forces and lengths, by quantity."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification import Motion

UNITS: dict[Motion, dict[str, str]] = {
    "linear": {
        "stiffness": "N/m",
        "damping": "N·s/m",
        "mass": "kg",
        "force": "N",
        "length": "m",
        "speed": "m/s",
    },
    "rotary": {
        "stiffness": "N·m/rad",
        "damping": "N·m·s/rad",
        "mass": "kg·m²",
        "force": "N·m",
        "length": "rad",
        "speed": "rad/s",
    },
}


def format_number(number: float) -> str:
    """Four digits, without an exponent where there are no more than six before the point."""
    return f"{float(f'{number:.4g}'):g}"
