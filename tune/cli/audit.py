"""``haptune audit``: are these gains safe on this device."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from tune.cli.audit_table import audit_details, audit_table
from tune.cli.drawing import draw_profile, target_picture
from tune.cli.options import Json, MarginOption, Picture, Quiet
from tune.cli.session import Session, run_command
from tune.cli.tune import IN_DEVICE

if TYPE_CHECKING:
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
        session.details |= audit_details(found)
        session.say(audit_table(found))
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
