"""What leaves a profile: ``haptune export``, files for a controller; ``haptune report``, a page."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from tune.cli.logs import identification_details, read_log
from tune.cli.options import DryRun, LogOptions, MarginChoice, command
from tune.cli.process import FilesWhole
from tune.cli.session import Session
from tune.cli.tuning import read_request, say_what_would_help

if TYPE_CHECKING:
    from identification import Device, Hardware, LogColumns, Trajectory
    from tune.documents.profile import SafeProfile
    from tune.exporters import Target
    from tune.optimisation.alternatives import Alternative

#: A node's name, or all of it from the root.
_NODE = re.compile(r"[A-Za-z_]\w*|(/[A-Za-z_]\w*)+", re.ASCII)


@command()
def export(
    session: Session,
    profile: Annotated[Path, Argument(help="profile.yaml")],
    to: Annotated[
        list[str], Option(metavar="TARGET", help="ros2, c, chai3d, json; several with commas.")
    ],
    output: Annotated[
        Path, Option("-o", "--output", help="Folder for the files; made if it is new.")
    ] = Path(),
    node: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Name of the ROS 2 node, such as haptune or /robot/haptune; default haptune.",
        ),
    ] = None,
    dry_run: DryRun = False,
) -> None:
    """Files for a controller, from a profile whose digest and certificate are checked first."""
    from identification import NotWrittenError
    from tune.certificate.check import check as recheck
    from tune.exporters import export as export_to

    targets = _targets(to)
    called = _node(node, targets)
    _refuse_homeless(output)
    with session.progress() as say:
        say("re-computing the certificate")
        checked = recheck(profile).profile
    files: dict[Path, str] = {}
    for target in targets:
        texts = export_to(checked, target, node=called)
        files |= {output / name: text for name, text in texts.items()}
    if not dry_run:
        try:
            output.mkdir(exist_ok=True)
        except OSError as error:
            raise NotWrittenError(output, error.strerror or str(error)) from None
        for path in files:
            session.target(path, profile)
    with FilesWhole():  # a guard and its header belong together
        for path, text in files.items():
            session.write(path, text, dry_run=dry_run)


def _refuse_homeless(folder: Path) -> None:
    """A folder is made in one that exists, not deeper. Raises NotWrittenError."""
    from identification import NotWrittenError

    # The functions of os.path also take names that no folder can have.
    if not os.path.isdir(folder.parent):  # noqa: PTH112
        raise NotWrittenError(folder, f"there is no folder {folder.parent}")
    if os.path.exists(folder) and not os.path.isdir(folder):  # noqa: PTH110, PTH112
        raise NotWrittenError(folder, "there is no folder, but a file of that name")


def _node(given: str | None, targets: list[Target]) -> str:
    """The name of the node. Raises UsageError."""
    from identification import UsageError

    if given is None:
        return "haptune"
    if "ros2" not in targets:
        raise UsageError("--node", "names a node of ROS 2", "Give --to ros2, or leave it out")
    if not _NODE.fullmatch(given):
        raise UsageError(
            "--node",
            f"{given!r} is no name of a node",
            "Give letters, digits and _, none beginning with a digit, namespaces before it as in "
            "/robot/haptune",
        )
    return given


def _targets(given: list[str]) -> list[Target]:
    """The targets of every --to, each once. Raises UsageError."""
    from identification import UsageError
    from tune.exporters import TARGETS

    names = dict.fromkeys(name.strip() for each in given for name in each.split(","))
    known: dict[str, Target] = {target: target for target in TARGETS}
    for name in names:
        if name not in known:
            raise UsageError("--to", f"{name!r} is no target", f"Choose from {', '.join(TARGETS)}")
    return [known[name] for name in names]


@command()
def report(
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
    options: LogOptions,
) -> None:
    """One page to sign, complete in itself, after the check; exit code 6 if that fails."""
    from identification import identify, to_mapping
    from tune.certificate.check import check
    from tune.presentation.page import report_html
    from tune.presentation.tables import half_widths

    given = logs or []
    session.target(output, profile, *given, what_if)
    columns = options.columns()
    with session.progress() as say:
        say("re-computing the certificate")
        safe = check(profile).profile
        say("reading logs")
        trajectories = [_own_log(path, columns, safe, profile) for path in given]
        say("identifying")
        allowed = {code for each in safe.device.logs for code in each.allowed}
        hardware = _hardware_of(safe.device) if given else None
        found = identify(trajectories, hardware=hardware, allow=allowed) if given else None
    if found is not None:
        session.add_findings(found.findings)
    alternatives = None if what_if is None else _alternatives(session, safe, what_if)
    with session.progress() as say:
        say("drawing")
        text = report_html(safe, found, alternatives)
    session.details |= {} if found is None else identification_details(found)
    session.details |= {"profile": to_mapping(safe), "half_widths": half_widths(safe.device)}
    session.store(output, text.encode())
    session.say(
        f"{profile} passed its check. Open the page in a browser, read it, print it and sign it"
    )


def _own_log(path: Path, columns: LogColumns, safe: SafeProfile, profile: Path) -> Trajectory:
    """A log that the profile's device was identified from; else raises InvalidInputError."""
    from identification import InvalidInputError

    trajectory = read_log(path, columns, _hardware_of(safe.device))
    known = {log.digest: log.source for log in safe.device.logs}
    if trajectory.digest not in known:
        names = ", ".join(known.values()) or "none that is known"
        raise InvalidInputError(
            path,
            f"is not what the device of {profile} was identified from ({names}): its content is "
            "another",
            "Give those logs, or none",
        )
    return trajectory


def _hardware_of(device: Device) -> Hardware:
    """What was known of a device before its logs were read."""
    from identification import Hardware, parse_document, to_mapping

    stated = to_mapping(device)
    kept = (name for name in Hardware.model_fields if name in stated)
    return parse_document(Hardware, {name: stated[name] for name in kept}, device.name)


def _alternatives(session: Session, safe: SafeProfile, scene_file: Path) -> tuple[Alternative, ...]:
    """The profile's scene tuned anew with one fact of the hardware changed at a time."""
    from identification import UsageError

    wish = read_request(scene_file, MarginChoice(safe.margin.name))
    strange = sorted(set(safe.elements) - set(wish.scene.elements))
    if strange:
        raise UsageError(
            "--what-if",
            f"{scene_file} has no element {', '.join(strange)}, which the profile has",
            "Give the scene that the profile was tuned for",
        )
    return say_what_would_help(session, safe, wish.scene, wish.table)
