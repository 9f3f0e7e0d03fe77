"""Profiles: ``tune``, ``calibrate`` and ``demo`` make them, ``export`` and ``report`` use them."""

from __future__ import annotations

import os
import re
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from typer import Argument, Option

import identification as ident
from identification import IdentificationError, InvalidInputError, NotWrittenError, UsageError
from tune.cli import session as opt
from tune.cli.logs import (
    DEVICE_COMMENT,
    HARDWARE,
    ask_facts,
    device_stating,
    identification_details,
    identify_logs,
    read_log,
    write_hardware,
)
from tune.cli.preparation import refuse_restless, template
from tune.cli.session import Session, command, refuse_standard_output
from tune.cli.settling import optimise_to_rest
from tune.documents import CheckFailedError, NoFeasibleEffectError

if TYPE_CHECKING:
    from identification import Device, Hardware, LogColumns, Trajectories, Trajectory
    from tune.documents.perception import PerceptionTable
    from tune.documents.profile import Design, SafeProfile
    from tune.documents.results import AlternativeResult
    from tune.documents.scene import MarginName, Scene
    from tune.exporters import Target
    from tune.optimisation import Alternative, Candidate, CandidateEffect


#: Where to state what a device file lacks.
IN_DEVICE = (
    "State them in this file, without 'source: log' and no longer under 'missing'; or identify "
    "again with --hardware ('haptune new hardware' writes the form):"
)
_IN_HARDWARE = (
    "State them in a hardware file and give it with --hardware ('haptune new hardware' writes the "
    "form):"
)
#: What the demonstration leaves in the current folder.
_FILES = ("device.yaml", "scene.yaml", "profile.yaml", "identification.png", "profile.png")
#: What exported files end in, and how each tells its profile, within so many bytes.
_EXPORTED = frozenset((".c", ".h", ".hpp", ".json", ".py", ".yaml"))
_DIGEST = re.compile(rb"digest\W{1,4}(sha256:[0-9a-f]{64})")
_HEADING = 4096
#: Folder of the package of ROS 2.
_PACKAGE = "haptune_controller"


@command(asks=True)
def tune_command(
    session: Session,
    device: Annotated[str, Argument(help="device.yaml, or the name of a known device.")],
    scene: Annotated[Path, Argument(help="scene.yaml")],
    output: opt.ProfileOut = Path("profile.yaml"),
    margin: opt.MarginOption = None,
    candidates: opt.Candidates = False,
    what_if: opt.WhatIf = False,
    picture: opt.Picture = None,
    dry_run: opt.DryRun = False,
) -> None:
    """The largest perceivable effects of a scene that are safe on a device."""
    session.target(output, scene, Path(device))
    session.target(picture, scene, Path(device), output)
    known = ident.load_device(device)
    stated = ask_facts(session, known, None) if session.asks else None
    if stated is not None:
        known = device_stating(known, stated)
        write_hardware(session, HARDWARE, stated, dry_run=dry_run)
        text = ident.to_yaml(ident.to_mapping(known), DEVICE_COMMENT)
        session.write(Path(device), text, dry_run=dry_run, changes="facts stated")
    known.require_stated(subject=device, where=IN_DEVICE)
    wish = read_request(scene, margin)
    profile = tune_device(session, known, wish, compare=candidates)
    if what_if:
        say_what_would_help(session, profile, wish.scene, wish.table)
    _write_profile(session, output, profile, dry_run=dry_run)
    draw_profile(session, picture, profile)


@command(asks=True)
def calibrate_command(
    session: Session,
    logs: opt.Logs,
    scene: Annotated[Path, Option(metavar="SCENE", help="scene.yaml")],
    output: opt.ProfileOut = Path("profile.yaml"),
    *,
    options: opt.LogOptions,
    hardware: opt.HardwareFile = None,
    allow: opt.Allow = None,
    method: opt.MethodOption = "auto",
    margin: opt.MarginOption = None,
    candidates: opt.Candidates = False,
    picture: opt.Picture = None,
    dry_run: opt.DryRun = False,
) -> None:
    """Identify the device and tune the scene in one go; the device is kept inside the profile."""
    session.target(output, *logs, scene, hardware)
    drawn = picture and picture.with_name(f"{picture.stem}-profile{picture.suffix}")
    for each in (picture, drawn):
        session.target(each, *logs, scene, hardware, output)
    columns = options.columns()
    wish = read_request(scene, margin)
    found = identify_logs(
        session, logs, columns, hardware, method, allow or [], brief=True, dry_run=dry_run
    )
    found.device.require_stated(
        subject=hardware or f"the device of {logs[0].name}", where=_IN_HARDWARE
    )
    profile = tune_device(session, found.device, wish, compare=candidates)
    _write_profile(session, output, profile, dry_run=dry_run)
    session.draw(picture, lambda: ident.identified_picture(found.device, found.logs))
    draw_profile(session, drawn, profile)


@command()
def demo_command(
    session: Session,
    *,
    planar: Annotated[
        bool, Option("--planar", help="The log of a device of two axes, driven together.")
    ] = False,
) -> None:
    """Bundled log → device.yaml → scene.yaml → profile.yaml, with tables and two pictures."""
    from datasets_synthetic import bundled_path
    from tune.presentation.pictures import profile_picture

    for name in _FILES:
        session.target(Path(name))
    name = "planar" if planar else "homerehab"
    columns = ident.LogColumns()
    if planar:
        columns = replace(columns, force="force_x,force_y", position="position_x,position_y")
    log, hardware = bundled_path(f"{name}.csv"), bundled_path(f"{name}.hardware.yaml")
    session.say(f"log: {log}")
    found = identify_logs(session, [log], columns, hardware, "auto", [], brief=not planar)
    session.write(
        Path("device.yaml"), ident.to_yaml(ident.to_mapping(found.device), DEVICE_COMMENT)
    )
    scene = Path("scene.yaml")
    session.write(scene, template("scene"))
    profile = tune_device(session, found.device, read_request(scene, None))
    _write_profile(session, Path("profile.yaml"), profile)
    fit = found.logs[0]
    session.draw(
        Path("identification.png"),
        lambda: (
            ident.identified_picture(found.device, found.logs)
            if planar
            else ident.fit_picture(fit.trajectory, found.device, delay=fit.estimate.delay)
        ),
    )
    session.draw(Path("profile.png"), lambda: profile_picture(profile))


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningRequest:
    """What is to be felt and how finely hands can tell; read before any log is."""

    scene: Scene
    table: PerceptionTable


def read_request(scene_file: Path, margin: MarginName | None) -> TuningRequest:
    """Read a scene and its perception table, the margin replaced where one is given."""
    from tune.documents.perception import perception_of
    from tune.documents.scene import load_scene

    scene = load_scene(scene_file)
    if margin is not None:
        scene = scene.model_copy(update={"margin": margin})
    return TuningRequest(scene=scene, table=perception_of(scene, scene_file.parent))


def tune_device(
    session: Session, device: Device, wish: TuningRequest, *, compare: bool = False
) -> SafeProfile:
    """Tune, show the result and return it; all candidates are compared if asked.

    What cannot be proved, or does not settle in simulation, is refused as no feasible effect.
    """
    from tune.certificate.certify import trusted_facts
    from tune.optimisation.describe import unmet_wishes
    from tune.presentation.tables import certificate_lines, effects_table, verdict_on, weak_walls

    try:
        if compare:
            profile = _choose_candidate(session, device, wish)
            with session.progress() as say:
                refuse_restless(profile, say)
        else:
            profile = optimise_to_rest(session, device, wish.scene, wish.table)
    except CheckFailedError as error:
        reasons = (f"{each.removesuffix('.')}. Ask for less of it" for each in error.failures)
        raise NoFeasibleEffectError(tuple(reasons)) from error
    trusted = trusted_facts(profile.device)
    session.details |= {
        "profile": ident.to_mapping(profile),
        "taken_on_trust": trusted,
        "rehearsed": "settles",
    }
    session.say(f"{verdict_on(profile)}; it settles in simulation")
    session.say(effects_table(profile, everything=session.verbose))
    unmet = tuple(unmet_wishes(profile, wish.scene))
    told = {finding.seen for finding in unmet}
    session.say_each(note for note in profile.notes if note.partition(". ")[0] not in told)
    session.say_each(weak_walls(profile))
    session.add_findings(unmet, quiet=False)
    session.detail(
        *certificate_lines(profile.certificate),
        *(f"taken on trust: {line}" for line in trusted),
        "rehearsed in simulation with quantiser, friction and force limit, every set and entering, "
        "leaving and gains that change: settles",
    )
    return profile


def _write_profile(
    session: Session, output: Path, profile: SafeProfile, *, dry_run: bool = False
) -> None:
    """Write a profile, say which effects it changes, and what to do next."""
    from tune.presentation.tables import changed_effects

    text, changes = profile.to_yaml(), ""
    with suppress(IdentificationError, OSError):
        if not (output.is_file() and output.read_bytes() == text.encode()):
            before = ident.load_mapping(output) if output.is_file() else {}
            changes = changed_effects(before, profile)
    session.write(output, text, dry_run=dry_run, changes=changes)
    if not dry_run:
        session.say(
            f"next: haptune report {output} (a page to sign), haptune export {output} --to c"
        )


def _choose_candidate(session: Session, device: Device, wish: TuningRequest) -> SafeProfile:
    """The candidate with the scene's margin, or why there is none, after all three were shown."""
    from tune.optimisation import candidates, compare_candidates
    from tune.presentation.tables import candidates_lines, candidates_table

    with session.progress() as say:
        found = candidates(device, wish.scene, table=wish.table, progress=say)
    rows = compare_candidates(found, wish.table)
    session.details["candidates"] = [
        _candidate_result(candidate, [row for row in rows if row.candidate == candidate.name])
        for candidate in found
    ]
    session.say(candidates_table(found, rows, wish.scene.margin))
    session.say_each(candidates_lines(found, rows))
    chosen = next(each for each in found if each.name == wish.scene.margin)
    if chosen.profile is None:
        assert chosen.error is not None
        raise chosen.error
    return chosen.profile


def _candidate_result(candidate: Candidate, rows: list[CandidateEffect]) -> dict[str, object]:
    from tune.documents.scene import MARGINS

    apart = {"candidate", "margin", "steps"}

    def short(number: float | None) -> float | None:
        """Four digits, as profiles state steps: the interval is no better known."""
        return None if number is None else ident.round_to_digits(number, 4)

    profile = candidate.profile
    return {
        "name": candidate.name,
        "margin": candidate.margin,
        "recommended": candidate.recommended,
        "demanded": MARGINS[candidate.margin].model_dump(mode="json"),
        "reason": None if candidate.error is None else str(candidate.error),
        "loop": None if profile is None else profile.loop.model_dump(mode="json"),
        "effects": [
            {key: item for key, item in asdict(row).items() if key not in apart}
            | {"steps": {key: short(item) for key, item in asdict(row.steps).items()}}
            for row in rows
        ],
    }


def say_what_would_help(
    session: Session, profile: SafeProfile, scene: Scene, perception: PerceptionTable
) -> tuple[Alternative, ...]:
    """Tune for each changed device, the best change first, and show what it brings."""
    from tune.optimisation import what_if
    from tune.presentation.tables import alternatives_table

    with session.progress() as say:
        found = what_if(profile.device, scene, table=perception, profile=profile, progress=say)
    session.say(alternatives_table(found))
    session.say_each(f"{each.change}: {each.reason}" for each in found if each.reason is not None)
    session.details["what_if"] = [_alternative_result(each, found[0]) for each in found]
    return found


def _alternative_result(each: Alternative, now: Alternative) -> AlternativeResult:
    from tune.presentation.tables import steps_won

    return {
        "change": each.change,
        "total": each.total,
        "won": each.total - now.total,
        "steps": each.steps,
        "won_by_effect": steps_won(each, now),
        "reason": each.reason,
    }


def draw_profile(
    session: Session, picture: Path | None, profile: Design, verdict: str | None = None
) -> None:
    """Draw region and limits of every element, with a verdict in the title."""
    if picture is not None:
        from tune.presentation.pictures import profile_sheet

        session.draw(picture, lambda: profile_sheet(profile, verdict))


@command()
def export_command(
    session: Session,
    profile: Annotated[Path, Argument(help="profile.yaml")],
    to: Annotated[
        list[str], Option(metavar="TARGET", help="ros2, c, chai3d, json; several with commas.")
    ],
    output: Annotated[
        Path, Option("-o", "--output", metavar="FOLDER", help="For the files; made if it is new.")
    ] = Path(),
    node: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Name of the ROS 2 node, such as haptune or /robot/haptune; default haptune.",
        ),
    ] = None,
    dry_run: opt.DryRun = False,
) -> None:
    """Files for a controller, from a profile whose digest and certificate are checked first."""
    from tune.certificate.check import check
    from tune.exporters import export

    targets = _targets(to)
    called = _node(node, targets)
    _refuse_missing_folder(output)
    with session.progress("re-computing the certificate"):
        checked = check(profile).profile
    files: dict[Path, str] = {}
    for target in targets:
        texts = export(checked, target, node=called)
        folder = output / _PACKAGE if target == "ros2" else output
        files |= {folder / name: text for name, text in texts.items()}
    with ExitStack() as undone_on_failure:
        # What is refused in the folder itself leaves none made in it.
        for folder in () if dry_run else dict.fromkeys((output, *(path.parent for path in files))):
            if not os.path.isdir(folder):  # noqa: PTH112
                undone_on_failure.callback(_remove_folder, folder)
            try:
                folder.mkdir(exist_ok=True)
            except OSError as error:
                raise NotWrittenError(folder, error.strerror or str(error)) from None
            for path in (each for each in files if each.parent == folder):
                session.target(path, profile)
        session.write_together(files, dry_run=dry_run)
        undone_on_failure.pop_all()
    if checked.device.axes is not None:
        axes = ", ".join(checked.device.axes)
        session.say(
            f"{axes} together: haptune_axes_force takes the position and gives the force as "
            "vectors, walls as faces of any normal; in ROS 2 haptune_node_of_axes does"
        )
    others = [
        path
        for folder in (output, output / _PACKAGE)
        for path in _of_other_profiles(folder, set(files), checked.digest)
    ]
    session.details["of_other_profiles"] = [str(path) for path in others]
    for path in others:
        session.warn(
            f"{path} is of another profile and works with none of these files: export it again "
            "from this one, or remove it"
        )


def _remove_folder(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def _of_other_profiles(folder: Path, written: set[Path], sealed: str) -> list[Path]:
    """Exported files that stay in a folder and say that they are of another profile."""
    found: list[Path] = []
    for path in sorted(folder.glob("haptune_*.*")):
        if path in written or path.suffix not in _EXPORTED or not path.is_file():
            continue
        with suppress(OSError), path.open("rb") as stream:
            told = _DIGEST.search(stream.read(_HEADING))
            if told and told[1].decode() != sealed:
                found.append(path)
    return found


def _refuse_missing_folder(folder: Path) -> None:
    """A folder is made in one that exists, not deeper. Raises NotWrittenError, UsageError."""
    refuse_standard_output(folder)
    # The functions of os.path also take names that no folder can have.
    if not os.path.isdir(folder.parent):  # noqa: PTH112
        raise NotWrittenError(folder, f"there is no folder {folder.parent}")
    if os.path.exists(folder) and not os.path.isdir(folder):  # noqa: PTH110, PTH112
        raise NotWrittenError(folder, "there is no folder, but a file of that name")


def _node(given: str | None, targets: list[Target]) -> str:
    """The name of the node. Raises UsageError."""
    from tune.exporters import refuse_strange_node

    if given is None:
        return "haptune"
    if "ros2" not in targets:
        raise UsageError("--node", "names a node of ROS 2", "Give --to ros2, or leave it out")
    refuse_strange_node(given)
    return given


def _targets(given: list[str]) -> list[Target]:
    """The targets of every --to, each once. Raises UsageError."""
    from tune.documents import refuse_unknown
    from tune.exporters import TARGETS

    names = dict.fromkeys(name.strip() for each in given for name in each.split(","))
    for name in names:
        refuse_unknown("--to", "target", name, TARGETS)
    return [cast("Target", name) for name in names]


@command()
def report_command(
    session: Session,
    profile: Annotated[Path, Argument(help="profile.yaml")],
    logs: Annotated[
        list[Path] | None,
        Argument(help="The logs its device was identified from: their fit is shown."),
    ] = None,
    output: Annotated[Path, Option("-o", "--output", help="Where to write the page.")] = Path(
        "report.html"
    ),
    what_if: Annotated[
        Path | None,
        Option(
            metavar="SCENE",
            help="The scene of the profile: also tune it with one fact of the hardware changed at "
            "a time, and show what each would bring.",
        ),
    ] = None,
    *,
    options: opt.LogOptions,
) -> None:
    """One page to sign, complete in itself, after the check; exit code 6 if that fails."""
    from tune.certificate.check import check
    from tune.presentation.page import report_html
    from tune.presentation.tables import half_widths

    given = logs or []
    session.target(output, profile, *given, what_if)
    columns = options.columns()
    with session.progress("re-computing the certificate") as say:
        safe = check(profile).profile
        say("reading logs")
        trajectories = [_own_log(path, columns, safe, profile) for path in given]
        say("identifying")
        allowed = {code for each in safe.device.logs for code in each.allowed}
        hardware = _hardware_of(safe.device) if given else None
        found = ident.identify(trajectories, hardware=hardware, allow=allowed) if given else None
    if found is not None:
        session.add_findings(found.findings)
    alternatives = None if what_if is None else _alternatives(session, safe, what_if)
    with session.progress("drawing"):
        text = report_html(safe, found, alternatives)
    session.details |= {} if found is None else identification_details(found)
    session.details |= {"profile": ident.to_mapping(safe), "half_widths": half_widths(safe.device)}
    session.store(output, text.encode())
    session.say(
        f"{profile} passed its check. Open the page in a browser, read it, print it and sign it"
    )


def _own_log(
    path: Path, columns: LogColumns, safe: SafeProfile, profile: Path
) -> Trajectory | Trajectories:
    """A log that the profile's device was identified from; else raises InvalidInputError."""
    trajectory = read_log(path, columns, _hardware_of(safe.device))
    records = {log.digest: log for log in safe.device.logs}
    record = records.get(trajectory.digest)
    if record is None:
        names = ", ".join(each.source for each in records.values()) or "none that is known"
        seen = f"is not what the device of {profile} was identified from ({names}): its content is "
        raise InvalidInputError(path, seen + "another", "Give those logs, or none")
    if trajectory.read_as != record.read_as:
        then, now = (each.read_as or "a table in SI units" for each in (record, trajectory))
        seen = f"is read as {now}, but for the device of {profile} it was read as {then}"
        raise InvalidInputError(path, seen, "Give columns and gains as they were given then")
    # Whoever identified the device has answered for the units.
    stated = frozenset({"force", "position"})
    if isinstance(trajectory, ident.Trajectory):
        return replace(trajectory, stated_units=stated)
    axes = tuple(replace(each, stated_units=stated) for each in trajectory.axes)
    return replace(trajectory, axes=axes)


def _hardware_of(device: Device) -> Hardware:
    """What was known of a device before its logs were read."""
    stated = ident.to_mapping(device)
    kept = (name for name in ident.Hardware.model_fields if name in stated)
    return ident.parse_document(ident.Hardware, {name: stated[name] for name in kept}, device.name)


def _alternatives(session: Session, safe: SafeProfile, scene_file: Path) -> tuple[Alternative, ...]:
    """The profile's scene tuned anew with one fact of the hardware changed at a time."""
    wish = read_request(scene_file, safe.margin.name)
    strange = sorted(set(safe.elements) - set(wish.scene.elements))
    if strange:
        seen = f"{scene_file} has no element {', '.join(strange)}, which the profile has"
        raise UsageError("--what-if", seen, "Give the scene that the profile was tuned for")
    return say_what_would_help(session, safe, wish.scene, wish.table)
