"""``haptune export``: a profile as files for a controller."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from tune.cli.interruption import FilesWhole
from tune.cli.options import DryRun, Json, Quiet
from tune.cli.session import Session, run_command

#: A node's name, or all of it from the root.
_NODE = re.compile(r"[A-Za-z_]\w*|(/[A-Za-z_]\w*)+", re.ASCII)

if TYPE_CHECKING:
    from tune.exporters import Target


def export(
    profile: Annotated[Path, typer.Argument(help="profile.yaml")],
    to: Annotated[
        list[str],
        typer.Option("--to", metavar="TARGET", help="ros2, c, chai3d, json; several with commas."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for the files; made if it is new.")
    ] = Path(),
    node: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it at run time
        typer.Option(
            "--node",
            metavar="NAME",
            help="Name of the ROS 2 node, such as haptune or /robot/haptune; default haptune.",
        ),
    ] = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Files for a controller, from a profile whose digest and certificate are checked first."""

    def action(session: Session) -> None:
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
            _make(output)
            for path in files:
                session.target(path, profile)
        with FilesWhole():  # a guard and its header belong together
            for path, text in files.items():
                session.write(path, text, dry_run=dry_run)

    run_command("export", action, as_json=json, quiet=quiet)


def _refuse_homeless(folder: Path) -> None:
    """A folder is made in one that exists, not deeper. Raises NotWrittenError."""
    from identification import NotWrittenError

    # The functions of os.path also take names that no folder can have.
    if not os.path.isdir(folder.parent):  # noqa: PTH112
        raise NotWrittenError(folder, f"there is no folder {folder.parent}")
    if os.path.exists(folder) and not os.path.isdir(folder):  # noqa: PTH110, PTH112
        raise NotWrittenError(folder, "there is no folder, but a file of that name")


def _make(folder: Path) -> None:
    """A folder that is there, made where it is new. Raises NotWrittenError."""
    from identification import NotWrittenError

    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise NotWrittenError(folder, error.strerror or str(error)) from None


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
