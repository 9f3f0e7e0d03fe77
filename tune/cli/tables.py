"""Results as tables for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from identification import Device, Quantity
    from tune.profile import Certificate, SafeProfile

_UNITS = {
    "linear": {"stiffness": "N/m", "damping": "N·s/m", "mass": "kg", "force": "N"},
    "rotary": {"stiffness": "N·m/rad", "damping": "N·m·s/rad", "mass": "kg·m²", "force": "N·m"},
}


def elements_table(profile: SafeProfile) -> Table:
    """One row for each effect: value, perceived steps, margins of its element, what binds."""
    units = _UNITS[profile.device.motion]
    loop = profile.loop
    filters = ", ".join(
        f"{name} {cutoff:g} Hz"
        for name, cutoff in (
            ("velocity", loop.velocity_filter_hz),
            ("acceleration", loop.acceleration_filter_hz),
        )
        if cutoff is not None
    )
    table = Table(
        title=f"{profile.scene} on {profile.device.name}, margin {profile.margin.name}; "
        f"filters: {filters or 'none'}",
        title_justify="left",
    )
    for heading in (
        "element",
        "effect",
        "value",
        "steps",
        "gain",
        "samples",
        "ripple",
        "limited by",
    ):
        numeric = heading in {"value", "steps", "gain", "samples", "ripple"}
        table.add_column(heading, justify="right" if numeric else "left")
    for name, element in profile.elements.items():
        for effect, reason in element.limited_by.items():
            value: float = getattr(element, effect)
            table.add_row(
                name,
                effect,
                f"{value:.6g} {units[effect]}" if value else "-",
                f"{element.perceived_steps.get(effect, 0.0):.3g}",
                f"{element.margins.gain:.4g}",
                f"{element.margins.extra_delay_samples:g}",
                "-" if element.ripple is None else f"{element.ripple:.2g} {units['force']}",
                reason,
            )
    return table


def device_table(device: Device) -> Table:
    """Identified quantities with their 95 % intervals."""
    units = _UNITS[device.motion]
    table = Table(title=f"{device.name}, axis {device.axis}", title_justify="left")
    for heading in ("quantity", "value", "95 % interval", "unit", "half-width"):
        table.add_column(heading, justify="left" if heading in {"quantity", "unit"} else "right")
    for label, quantity, unit in (
        ("mass m", device.mass, units["mass"]),
        ("damping b", device.damping, units["damping"]),
        ("Coulomb friction Fc", device.coulomb_friction, units["force"]),
        ("force offset f0", device.force_offset, units["force"]),
    ):
        table.add_row(
            label,
            f"{quantity.value:.6g}",
            "-" if quantity.exact else f"{quantity.low:.6g} .. {quantity.high:.6g}",
            unit,
            _relative(quantity),
        )
    return table


def _relative(quantity: Quantity) -> str:
    if quantity.exact or quantity.value == 0:
        return "-"
    return f"{100 * (quantity.high - quantity.low) / 2 / abs(quantity.value):.2g} %"


def certificate_lines(certificate: Certificate) -> tuple[str, ...]:
    """What was certified, in words."""
    worst = certificate.worst
    return (
        f"certified at {certificate.points} points: mass {certificate.mass[0]:.6g} to "
        f"{certificate.mass[1]:.6g}, damping {certificate.damping[0]:.6g} to "
        f"{certificate.damping[1]:.6g} (together {100 * certificate.confidence:g} %), every gain "
        f"in (0, {certificate.gain:g}], up to {certificate.extra_delay_samples} extra samples",
        f"slowest there: {' + '.join(worst.elements)}, pole radius {worst.pole_radius:.6f}",
        "not assessed: " + "; ".join(certificate.not_assessed),
    )
