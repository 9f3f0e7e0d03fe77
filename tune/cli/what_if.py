"""``--what-if``: what each fact of the hardware costs in perceived steps, as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table

from tune._what_if import Alternative, what_if
from tune.cli.session import Session

if TYPE_CHECKING:
    from tune.documents.perception import PerceptionTable
    from tune.documents.profile import SafeProfile
    from tune.documents.results import AlternativeResult
    from tune.documents.scene import Scene

#: Perceived steps that nobody would buy anything for.
_HARDLY = 0.05


def say_what_would_help(
    session: Session, profile: SafeProfile, scene: Scene, perception: PerceptionTable
) -> tuple[Alternative, ...]:
    """Tune for each changed device, the best change first, and show what it brings."""
    with session.progress() as say:
        found = what_if(profile.device, scene, table=perception, profile=profile, progress=say)
    session.say(alternatives_table(found))
    for each in found:
        if each.reason is not None:
            session.say(f"{each.change}: {each.reason}")
    session.details["what_if"] = [_plain(each, found[0]) for each in found]
    return found


def alternatives_table(found: tuple[Alternative, ...]) -> Table:
    """One row a change of the hardware: perceived steps in all, and where most are won or lost."""
    now = found[0]
    table = Table(
        title="what would help: perceived steps with one fact of the hardware changed",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for heading in ("with", "steps", "won", "most of it"):
        side = "left" if heading in {"with", "most of it"} else "right"
        table.add_column(heading, justify=side, overflow="fold")
    for each in found:
        won = _steps_won(each, now)
        most = max(won, key=lambda name: abs(won[name]), default=None)
        table.add_row(
            each.change,
            "none" if each.reason is not None else f"{each.total:.3g}",
            "-" if each is now or each.reason is not None else f"{each.total - now.total:+.2g}",
            "-" if most is None or abs(won[most]) < _HARDLY else f"{most} {won[most]:+.2g}",
        )
    return table


def _steps_won(each: Alternative, now: Alternative) -> dict[str, float]:
    """Steps more than the device as it is has, by "element.effect"."""
    return {
        name: each.steps.get(name, 0.0) - now.steps.get(name, 0.0)
        for name in dict.fromkeys((*now.steps, *each.steps))
    }


def _plain(each: Alternative, now: Alternative) -> AlternativeResult:
    return {
        "change": each.change,
        "total": each.total,
        "won": each.total - now.total,
        "steps": each.steps,
        "won_by_effect": _steps_won(each, now),
        "reason": each.reason,
    }
