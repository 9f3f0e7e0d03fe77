"""What encoder and friction make of gains, as rows of an audit."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tune._audit import Audit


def friction_rows(found: Audit, units: dict[str, str]) -> list[tuple[str, str, str]]:
    """(what, seen, needed) of passivity with the encoder and of swings that it sustains."""
    device = found.design.device
    if found.quantised is None:
        return []
    said = found.quantised
    rows: list[tuple[str, str, str]] = []
    if said.damping_needed is not None:
        rows += [
            (
                "passive with encoder: damping b",
                f"{said.damping:.4g} {units['damping']}",
                f"above {said.damping_needed:.4g}",
            ),
            (
                "passive with encoder: Coulomb friction c",
                f"{said.friction:.3g} {units['force']}",
                f"at least {said.friction_needed:.3g}",
            ),
            (
                "stiffest spring alone that is passive",
                f"{said.stiffest_spring:.5g} {units['stiffness']}",
                "-",
            ),
        ]
    if device.modes:
        swing = "not looked for: the mechanism vibrates"
    elif found.margins is None:
        swing = "not looked for: the loop is not stable"
    elif found.cycle is None:
        swing = "none"
    else:
        (small, large), (slow, fast) = found.cycle.amplitude, found.cycle.frequency_hz
        swing = f"{small:.2g} to {large:.2g} {units['length']} at {slow:.3g} to {fast:.3g} Hz"
    return [*rows, ("swing that encoder and friction sustain", swing, "-")]
