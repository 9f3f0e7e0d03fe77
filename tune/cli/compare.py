"""``haptune compare``: two devices or two profiles, and whether the old profile still holds."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tune.cli.options import Json, Quiet
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from rich.table import Table

    from identification import Device, Motion
    from tune.comparison import Change, Comparison, Interval
    from tune.documents.profile import SafeProfile

#: Unit of each quantity of a device, by the name it has in a table of units.
_UNITS = {
    "mass": "mass",
    "damping": "damping",
    "damping_slope": "damping",
    "coulomb_friction": "force",
    "force_offset": "force",
    "force_limit.continuous": "force",
    "force_limit.peak": "force",
    "encoder_resolution": "length",
    "position_stiffness": "stiffness",
    "presliding_stiffness": "stiffness",
}


def compare(
    old: Annotated[str, typer.Argument(metavar="OLD", help="device.yaml or profile.yaml")],
    new: Annotated[
        str,
        typer.Argument(
            metavar="NEW",
            help="another of its kind; with an old profile also a device.yaml or a known device",
        ),
    ],
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """What changed beyond both intervals; ends with 6 if the old profile no longer holds."""

    def action(session: Session) -> None:
        from tune.comparison import compare as compared
        from tune.documents.errors import CheckFailedError

        first, second = _load(old), _load(new)
        with session.progress() as say:
            say(f"comparing {old} with {new}")
            found = compared(first, second)
        session.say(_table(found, old, new, _motion(first)))
        session.details |= _plain(found)
        _conclude(found, session, old, new)
        if found.failures:
            raise CheckFailedError(_unfit(found, old, new))

    run_command("compare", action, as_json=json, quiet=quiet)


def _load(reference: str) -> Device | SafeProfile:
    """A profile, its digest compared, or else a device."""
    from identification import load_device, load_mapping, named_devices
    from tune.documents.profile import load_profile

    path = Path(reference)
    if reference not in named_devices() and path.is_file():
        schema = str(load_mapping(path).get("schema", ""))
        if schema.startswith("haptune/profile/"):
            return load_profile(path)
    return load_device(reference)


def _motion(file: Device | SafeProfile) -> Motion:
    from identification import Device

    return file.motion if isinstance(file, Device) else file.device.motion


def _table(found: Comparison, old: str, new: str, motion: Motion) -> Table:
    """One row a quantity: both values with their intervals, the change, the verdict."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from tune.cli.tables import units_of

    units = units_of(motion)
    table = Table(title=f"{old} -> {new}", title_justify="left", box=SIMPLE_HEAD)
    for heading in ("quantity", "unit", "old", "new", "change", "beyond both intervals"):
        side = "right" if heading in {"old", "new", "change"} else "left"
        table.add_column(heading, justify=side, overflow="fold")
    for change in (*found.changes, *found.effects):
        effect = change.name.rpartition(".")[2]
        kind = effect if change in found.effects else _UNITS.get(change.name)
        table.add_row(
            change.name,
            "s" if kind is None else units[kind],
            _interval_words(change.old),
            _interval_words(change.new),
            "-" if change.part is None else f"{change.part:+.2%}",
            "-" if change in found.effects else "yes" if change.beyond else "no",
        )
    return table


def _interval_words(side: Interval | None) -> str:
    if side is None:
        return "-"
    between = f"{side.low:.5g} .. {side.high:.5g}"
    if side.value is None:
        return between
    return f"{side.value:.5g}" + ("" if side.low == side.high else f" ({between})")


def _conclude(found: Comparison, session: Session, old: str, new: str) -> None:
    """Say what the comparison amounts to, but for what fails."""
    beyond = [change.name for change in found.changes if change.beyond]
    session.say(
        f"changed beyond both 95 % intervals: {', '.join(beyond)}"
        if beyond
        else "nothing of the device changed beyond both 95 % intervals"
    )
    if found.holds:
        session.say(f"{old} holds on the device of {new}: every moment is proved with its margin")


def _unfit(found: Comparison, old: str, new: str) -> tuple[str, ...]:
    kept = "" if found.gain is None else f"; a gain margin of {found.gain:.3g} is proved there"
    return (
        f"{old} does not hold on the device of {new}{kept}. Tune again for it",
        *found.failures,
    )


def _plain(found: Comparison) -> dict[str, object]:
    """The comparison as plain types."""

    def plain(changes: tuple[Change, ...]) -> list[dict[str, object]]:
        return [
            {**asdict(change), "part": change.part, "beyond": change.beyond} for change in changes
        ]

    return {
        "kind": found.kind,
        "changes": plain(found.changes),
        "effects": plain(found.effects),
        "holds": found.holds,
        "gain": found.gain,
    }
