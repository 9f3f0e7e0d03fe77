"""``haptune audit``: are these gains safe on this device.

One file: one command: its options, tables and exit codes.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from tune.cli.drawing import draw_profile, target_picture
from tune.cli.options import Json, MarginOption, Picture, Quiet
from tune.cli.session import Session, run_command
from tune.cli.tune import IN_DEVICE

if TYPE_CHECKING:
    from rich.table import Table

    from tune._audit import Audit
    from tune.documents.effects import Effects


def audit(
    device: Annotated[str, typer.Argument(help="device.yaml, or the name of a known device.")],
    stiffness: Annotated[
        float, typer.Option("--stiffness", metavar="K", help="N/m (N·m/rad).")
    ] = 0.0,
    damping: Annotated[
        float, typer.Option("--damping", metavar="B", help="N·s/m (N·m·s/rad).")
    ] = 0.0,
    mass: Annotated[float, typer.Option("--mass", metavar="M", help="kg (kg·m²).")] = 0.0,
    extra_delay_samples: Annotated[
        float,
        typer.Option(
            "--extra-delay-samples", metavar="X", help="On top of the device's own delay."
        ),
    ] = 0.0,
    velocity_filter: Annotated[
        Optional[float],  # noqa: UP045 - typer reads it at run time
        typer.Option("--velocity-filter", metavar="HZ", help="First-order cut-off; default none."),
    ] = None,
    acceleration_filter: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            "--acceleration-filter", metavar="HZ", help="Second-order cut-off; default none."
        ),
    ] = None,
    margin: MarginOption = None,
    picture: Picture = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Are these gains safe, why not, and the nearest safe ones; exit code 6 if they are not."""

    def action(session: Session) -> None:
        from identification import UsageError, load_device
        from tune._audit import NEEDED
        from tune._audit import audit as judged
        from tune.certificate.assumptions import trusted_facts
        from tune.documents.effects import Effects
        from tune.documents.errors import CheckFailedError
        from tune.loop.filters import Filters

        wanted = {"stiffness": stiffness, "damping": damping, "mass": mass}
        target_picture(session, picture, Path(device))
        _refuse_nonsense(wanted, extra_delay_samples, velocity_filter, acceleration_filter)
        known = load_device(device)
        known.require_stated(NEEDED, subject=device, where=IN_DEVICE)
        if extra_delay_samples * known.sample_time.value + known.delay.low < 0:
            raise UsageError(
                "--extra-delay-samples",
                f"{extra_delay_samples:g} leaves less than no delay",
                f"Give {-known.delay.low / known.sample_time.value:g} or more",
            )
        with session.progress() as say:
            say("judging the gains")
            found = judged(
                known,
                Effects(**wanted),
                filters=Filters(
                    velocity_filter_hz=velocity_filter, acceleration_filter_hz=acceleration_filter
                ),
                margin="balanced" if margin is None else margin.value,
                extra_delay_samples=extra_delay_samples,
            )
        session.details |= _numbers(found)
        session.say(_table(found))
        session.details["taken_on_trust"] = trusted = trusted_facts(found.design.device)
        for line in trusted:
            session.say(f"taken on trust: {line}")
        proved = f"safe with margin {found.design.margin.name}, proved over the whole box"
        wrong = " and ".join(dict.fromkeys(fault.limit for fault in found.faults))
        if picture is not None:
            verdict = proved if found.safe else f"NOT SAFE: {wrong}"
            draw_profile(session, picture, found.design, verdict)
        if found.safe:
            session.say(proved)
            return
        nearest = _sentence(found.nearest)
        raise CheckFailedError(
            (
                *(f"{f.limit}: {f.seen}; needed: {f.needed}\n  {f.remedy}" for f in found.faults),
                f"nearest safe values: {nearest}" if nearest else "no safe value was found",
            )
        )

    run_command("audit", action, as_json=json, quiet=quiet)


def _refuse_nonsense(
    wanted: dict[str, float], extra: float, velocity: float | None, acceleration: float | None
) -> None:
    from identification import UsageError
    from tune.documents.scene import LARGEST, SMALLEST

    if not any(wanted.values()):
        raise UsageError("--stiffness, --damping, --mass", "all are zero", "Give one of them")
    if wanted["stiffness"] < 0:
        raise UsageError(
            "--stiffness", f"{wanted['stiffness']:g} is never stable", "Give zero or more"
        )
    gains = {f"--{name}": value for name, value in wanted.items()}
    for option, value in (gains | {"--extra-delay-samples": extra}).items():
        if not math.isfinite(value):
            raise UsageError(option, f"{value} is no finite number", "Give a number")
    cutoffs = {"--velocity-filter": velocity, "--acceleration-filter": acceleration}
    for option, value in cutoffs.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            raise UsageError(
                option, f"{value} is no cut-off", "Give Hz above zero, or leave it out"
            )
    for option, value in (gains | cutoffs).items():
        if value and not SMALLEST <= abs(value) <= LARGEST:
            raise UsageError(
                option,
                f"{value:g} is beyond {SMALLEST:g} to {LARGEST:g}",
                "Give a number within, or leave it out",
            )


def _sentence(effects: Effects | None) -> str:
    if effects is None:
        return ""
    named = zip(("--stiffness", "--damping", "--mass"), effects.arrays(), strict=True)
    return " ".join(f"{name} {float(value):.6g}" for name, value in named if value)


def _rows(found: Audit) -> list[tuple[str, str, str]]:
    """(what, seen, needed) of everything that was computed."""
    from tune._audit import ELEMENT
    from tune.cli.contacts import contact_words, jitter_words
    from tune.cli.friction_rows import friction_rows
    from tune.cli.tables import further_delay
    from tune.documents.units import UNITS

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
        for words in contact_words(wall, design.device, units, f"{speed:g} {units['speed']}")
    ]
    rows += friction_rows(found, units)
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


def _table(found: Audit) -> Table:
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


def _numbers(found: Audit) -> dict[str, object]:
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
        "passive_with_encoder": found.quantised and asdict(found.quantised),
        "limit_cycle": found.cycle and asdict(found.cycle),
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
