"""``haptune tune``: device + scene → profile."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tune.cli.drawing import draw_candidates, draw_profile, further_picture, target_picture
from tune.cli.options import (
    Candidates,
    DryRun,
    Json,
    MarginChoice,
    MarginOption,
    Picture,
    ProfileOut,
    Quiet,
    WhatIf,
)
from tune.cli.session import Session, run_command

if TYPE_CHECKING:
    from identification import Device
    from tune.documents.perception import PerceptionTable
    from tune.documents.profile import SafeProfile
    from tune.documents.scene import Scene
    from tune.optimisation.candidates import Candidate, CandidateEffect


#: Where to state what a device file lacks.
IN_DEVICE = (
    "State them in this file, without 'source: log' and no longer under 'missing'; or identify "
    "again with --hardware ('haptune new hardware' writes the form):"
)


def tune(
    device: Annotated[str, typer.Argument(help="device.yaml, or the name of a known device.")],
    scene: Annotated[Path, typer.Argument(help="scene.yaml")],
    output: ProfileOut = Path("profile.yaml"),
    margin: MarginOption = None,
    candidates: Candidates = False,
    what_if: WhatIf = False,
    picture: Picture = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """The largest perceivable effects of a scene that are safe on a device."""

    def action(session: Session) -> None:
        from identification import load_device

        session.target(output, scene, Path(device))
        target_picture(session, picture, scene, Path(device), output)
        sheet = picture and further_picture(picture, "candidates") if candidates else None
        target_picture(session, sheet, scene, Path(device), output)
        known = load_device(device)
        known.require_stated(subject=device, where=IN_DEVICE)
        wish = read_request(scene, margin)
        profile = tune_device(session, known, wish, compare=candidates, sheet=sheet)
        if what_if:
            from tune.cli.what_if import say_what_would_help

            say_what_would_help(session, profile, wish.scene, wish.table)
        session.write(output, profile.to_yaml(), dry_run=dry_run)
        if picture is not None:
            draw_profile(session, picture, profile)

    run_command("tune", action, as_json=json, quiet=quiet)


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningRequest:
    """What is to be felt and how finely hands can tell; read before any log is."""

    scene: Scene
    table: PerceptionTable


def read_request(scene_file: Path, margin: MarginChoice | None) -> TuningRequest:
    """Read a scene and its perception table, the margin replaced where one is given."""
    from tune.documents.perception import perception_of
    from tune.documents.scene import load_scene

    scene = load_scene(scene_file)
    if margin is not None:
        scene = scene.model_copy(update={"margin": margin.value})
    return TuningRequest(scene=scene, table=perception_of(scene, scene_file.parent))


def tune_device(
    session: Session,
    device: Device,
    wish: TuningRequest,
    *,
    compare: bool = False,
    sheet: Path | None = None,
) -> SafeProfile:
    """Tune, show the result and return it; shared with calibrate and demo.

    Args:
        session: of the command.
        device: to tune for.
        wish: what is to be felt.
        compare: tune all candidates and show them side by side.
        sheet: where to draw the candidates that are compared; None to draw none.
    """
    from identification import to_mapping
    from tune.certificate.assumptions import trusted_facts
    from tune.cli.rehearse import refuse_restless
    from tune.cli.tables import certificate_lines, elements_table
    from tune.optimisation._optimise import optimise

    if compare:
        profile = _choose_candidate(session, device, wish, sheet)
    else:
        with session.progress() as say:
            profile = optimise(device, wish.scene, table=wish.table, progress=say)
        session.say(elements_table(profile))
    trusted = trusted_facts(profile.device)
    session.details |= {"profile": to_mapping(profile.signed()), "taken_on_trust": trusted}
    for note in profile.notes:
        session.say(note)
    for line in certificate_lines(profile.certificate):
        session.say(line)
    for line in trusted:
        session.say(f"taken on trust: {line}")
    with session.progress() as say:
        refuse_restless(profile, say)
    session.details["rehearsed"] = "settles"
    session.say(
        "rehearsed in simulation with quantiser, friction and force limit, every set and entering, "
        "leaving and gains that change: settles"
    )
    return profile


def _choose_candidate(
    session: Session, device: Device, wish: TuningRequest, sheet: Path | None
) -> SafeProfile:
    """The candidate with the scene's margin, after all three were shown.

    Raises:
        NoFeasibleEffectError: this margin allows nothing the scene asks for.
        CheckFailedError: what it allows was not certified.
    """
    from tune.cli.tables import candidates_lines, candidates_table
    from tune.optimisation.candidates import candidates, compare_candidates

    with session.progress() as say:
        found = candidates(device, wish.scene, table=wish.table, progress=say)
    rows = compare_candidates(found, wish.table)
    session.details["candidates"] = [
        _plain(candidate, [row for row in rows if row.candidate == candidate.name])
        for candidate in found
    ]
    session.say(candidates_table(found, rows, wish.scene.margin))
    for line in candidates_lines(found, rows):
        session.say(line)
    chosen = next(each for each in found if each.name == wish.scene.margin)
    if chosen.profile is None:
        assert chosen.error is not None
        raise chosen.error
    if sheet is not None:
        draw_candidates(session, sheet, rows, device.motion)
    return chosen.profile


def _plain(candidate: Candidate, rows: list[CandidateEffect]) -> dict[str, object]:
    """One candidate as it stands in the JSON result."""
    from tune.documents.scene import MARGINS

    profile = candidate.profile
    return {
        "name": candidate.name,
        "margin": candidate.margin,
        "recommended": candidate.recommended,
        "demanded": MARGINS[candidate.margin].model_dump(mode="json"),
        "reason": None if candidate.error is None else str(candidate.error),
        "loop": None if profile is None else profile.loop.model_dump(mode="json"),
        "effects": [
            {
                key: item
                for key, item in asdict(row).items()
                if key not in {"candidate", "margin", "steps"}
            }
            | {"steps": {key: _short(item) for key, item in asdict(row.steps).items()}}
            for row in rows
        ],
    }


def _short(number: float | None) -> float | None:
    """Four digits, as profiles state steps: the interval is no better known."""
    from identification import round_to_digits

    return None if number is None else round_to_digits(number, 4)
