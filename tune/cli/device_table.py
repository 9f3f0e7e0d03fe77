"""A device as a table: what was identified, with its intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table

from tune.cli.details import half_width, relative_half_width
from tune.cli.tables import units_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from identification import Device, Quantity


def device_table(device: Device) -> Table:
    """Identified quantities with their 95 % intervals."""
    units = units_of(None if "motion" in device.missing else device.motion)
    table = Table(
        title=f"{device.name}, axis {device.axis}",
        title_justify="left",
        caption="\n".join(_reservations(device)),
        caption_justify="left",
        box=SIMPLE_HEAD,
    )
    for heading in ("quantity", "value", "95 % interval", "unit", "half-width"):
        side = "left" if heading in {"quantity", "unit"} else "right"
        table.add_column(heading, justify=side, overflow="fold")
    for label, quantity, kind in device_rows(device):
        table.add_row(label, *_with_interval(quantity), units[kind], _relative(quantity))
    slope = device.damping_slope
    if slope is not None:
        between = f"{slope.low:.4g} .. {slope.high:.4g}"
        table.add_row("slope of friction", "-", between, units["damping"], "-")
    presliding = device.presliding_stiffness
    if presliding is not None:
        between = f"{presliding.low:.4g} .. {presliding.high:.4g}"
        table.add_row("stiffness before sliding", "-", between, units["stiffness"], "-")
    return table


def device_rows(device: Device) -> list[tuple[str, Quantity, str]]:
    """(label, quantity, kind of its unit) of everything identified that has a value."""
    rows = [
        ("mass m", device.mass, "mass"),
        ("damping b", device.damping, "damping"),
        ("Coulomb friction Fc", device.coulomb_friction, "force"),
        ("force offset f0", device.force_offset, "force"),
    ]
    for what, pair, kind in (
        ("damping", device.damping_by_direction, "damping"),
        ("Coulomb friction", device.friction_by_direction, "force"),
    ):
        if pair is not None:
            rows += [(f"{what} forward", pair.forward, kind)]
            rows += [(f"{what} backward", pair.backward, kind)]
    if device.position_stiffness is not None:
        rows.append(("force by position k", device.position_stiffness, "stiffness"))
    if device.gravity is not None:
        rows.append(("gravity, sine", device.gravity.sine, "force"))
        rows.append(("gravity, cosine", device.gravity.cosine, "force"))
    return rows


def half_widths(device: Device) -> dict[str, float | None]:
    """By label, half of each interval as part of its value; None where there is no such part."""
    return {label: relative_half_width(quantity) for label, quantity, _ in device_rows(device)}


def _reservations(device: Device) -> Iterator[str]:
    """What nobody stated of a device, and what was only assumed."""
    if device.missing:
        yield f"missing, to be stated before anything is certified: {', '.join(device.missing)}"
    if device.assumed():
        yield f"assumed, not known: {', '.join(device.assumed())}"


def _with_interval(quantity: Quantity) -> tuple[str, str]:
    """Value and interval to two digits of the half-width."""
    half = half_width(quantity)
    if half == 0:
        return f"{quantity.value:.6g}", "-"
    digits = max(0, 1 - math.floor(math.log10(half)))
    low, high = f"{quantity.low:.{digits}f}", f"{quantity.high:.{digits}f}"
    return f"{quantity.value:.{digits}f}", f"{low} .. {high}"


def _relative(quantity: Quantity) -> str:
    part = relative_half_width(quantity)
    return "-" if part is None else f"{100 * part:.2g} %"
