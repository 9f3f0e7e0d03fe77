"""What an audit shows: its table for people, and every number of it for programs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from tune._audit import Audit


def audit_table(found: Audit) -> Table:
    """Everything that was computed, with what is needed of it."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    design = found.design
    delay = design.loop.extra_delay_samples
    table = Table(
        title=f"{design.device.name}, delay {delay:g} sample{'' if delay == 1 else 's'}, margin "
        f"{design.margin.name}",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for heading in ("what", "seen", "needed"):
        table.add_column(heading, overflow="fold")
    for row in _rows(found):
        table.add_row(*row)
    return table


def _rows(found: Audit) -> list[tuple[str, str, str]]:
    """(what, seen, needed) of everything that was computed."""
    from tune._audit import ELEMENT
    from tune.cli.contacts import contact_words, jitter_words
    from tune.cli.tables import further_delay
    from tune.documents.effects import UNITS

    design, margins = found.design, found.margins
    units = UNITS[design.device.motion]
    limit = design.device.force_limit
    rows = [
        ("gain margin over the box", f"{found.gain:.4g}", f"{design.margin.gain:g}"),
        (
            "extra delay, samples, over the box",
            "-" if math.isnan(found.delay_samples) else further_delay(found.delay_samples),
            f"{design.margin.extra_delay_samples}",
        ),
        ("steps longer or shorter, assessed", f"by {jitter_words(found.jitter)}", "-"),
        (
            "sustained force",
            f"{found.sustained:.4g} {units['force']}",
            "-" if limit is None else f"at most {limit.continuous:g}",
        ),
        (
            "peak force",
            f"{found.peak:.4g} {units['force']}",
            "-" if limit is None else f"at most {limit.peak:g}",
        ),
    ]
    if found.ripple is not None:
        rows.append(
            (
                "force ripple from the encoder",
                f"{found.ripple:.3g} {units['force']} rms",
                f"at most {design.ripple_limit:g}",
            )
        )
    if found.vibration is not None:
        felt = "felt" if found.felt is not None and found.felt > 1 else "not felt"
        share = "" if found.felt is None else f", {found.felt:.2g} of what is felt: {felt}"
        rows.append(
            ("vibration of the handle", f"{found.vibration:.2g} {units['length']} rms{share}", "-")
        )
    rows += [
        (f"one count through {name}", f"{jump:.3g} {units['force']}", "-")
        for name, jump in found.jumps.items()
    ]
    wall, speed = found.wall, design.elements[ELEMENT].motion.speed
    rows += [
        ("as a wall that only pushes, a free device", words, "-")
        for words in contact_words(wall, units, f"{speed:g} {units['speed']}")
    ]
    if margins is not None:
        disk = margins.disk
        passive = margins.passivity
        rows += [
            ("slowest decay", f"{margins.decay:.4g} 1/s", "-"),
            ("least damping ratio", f"{margins.damping_ratio:.3g}", "-"),
            ("phase margin", f"{margins.phase:.3g}°", "-"),
            ("disk margin", f"{disk.balanced:.3g} at {disk.balanced_hz:.3g} Hz", "-"),
            (
                "passive",
                "not applicable: " + passive.reason
                if passive.damping_needed is None
                else f"{'yes' if passive.passive else 'no'}, needs b above "
                f"{passive.damping_needed:.5g} {units['damping']}",
                "-",
            ),
        ]
    return rows


def audit_details(found: Audit) -> dict[str, object]:
    """What the table shows for programs; what was not computed is null."""
    from tune._audit import ELEMENT

    margins, design = found.margins, found.design
    limit = design.device.force_limit

    def number(value: float | None) -> float | None:
        return None if value is None or not math.isfinite(value) else float(value)

    nearest = None
    if found.nearest is not None:
        names = ("stiffness", "damping", "mass")
        nearest = {
            name: float(value)
            for name, value in zip(names, found.nearest.arrays(), strict=True)
            if value is not None
        }
    return {
        "safe": found.safe,
        "loop": design.loop.model_dump(mode="json"),
        "needed": {
            "gain_margin": design.margin.gain,
            "extra_delay_samples": design.margin.extra_delay_samples,
            "sustained_force": limit and limit.continuous,
            "peak_force": limit and limit.peak,
            "ripple": design.ripple_limit,
        },
        "gain_margin": number(found.gain),
        "extra_delay_samples": number(found.delay_samples),
        "jitter": found.jitter,
        "sustained_force": found.sustained,
        "peak_force": found.peak,
        "ripple": number(found.ripple),
        "vibration": number(found.vibration),
        "vibration_over_threshold": number(found.felt),
        "one_count": found.jumps,
        "wall": found.wall.model_dump(mode="json"),
        "speed": design.elements[ELEMENT].motion.speed,
        "slowest_decay": number(margins and margins.decay),
        "damping_ratio": number(margins and margins.damping_ratio),
        "phase_margin_degrees": number(margins and margins.phase),
        "disk_margin": number(margins and margins.disk.balanced),
        "critical_frequency_hz": number(margins and margins.critical_frequency_hz),
        "passive": None if margins is None else margins.passivity.passive,
        "passive_above_damping": margins and margins.passivity.damping_needed,
        "faults": [
            {"limit": f.limit, "seen": f.seen, "needed": f.needed, "remedy": f.remedy}
            for f in found.faults
        ],
        "nearest": nearest,
    }
