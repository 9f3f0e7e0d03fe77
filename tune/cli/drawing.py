"""Pictures that commands draw where ``--picture`` asks for them."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from tune.cli.session import Session

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification import Device, Identification, Motion
    from tune.documents.profile import Design
    from tune.optimisation.alternatives import CandidateEffect

#: Kinds of picture beside PNG, by the ending of the file.
_VECTORS = {".svg": "svg", ".pdf": "pdf"}


def draw(session: Session, path: Path, figure: Figure) -> None:
    """Write a picture atomically, PNG but for .svg and .pdf. Raises NotWrittenError."""
    stream = BytesIO()
    picture: Any = figure
    picture.savefig(stream, format=_VECTORS.get(path.suffix.lower(), "png"), dpi=120)
    session.store(path, stream.getvalue())


def target_picture(session: Session, picture: Path | None, *others: Path | None) -> None:
    """Refuse, before any work is done, a picture that cannot be written or is another file."""
    if picture is not None:
        session.target(picture, *others)


def further_picture(picture: Path, what: str) -> Path:
    """The file of a further picture: what it shows, after the name of the first."""
    return picture.with_name(f"{picture.stem}-{what}{picture.suffix}")


def device_in(output: Path) -> Device | None:
    """The device that a file states which is about to be replaced; None where there is none."""
    from identification import Device, IdentificationError, load_mapping, parse_document

    if not output.is_file():
        return None
    try:
        content = load_mapping(output)
        inside: object = content.get("device")
        known = cast("dict[str, object]", inside) if isinstance(inside, dict) else content
        return parse_document(Device, known, output)
    except IdentificationError:
        return None


def draw_identified(
    session: Session, picture: Path, found: Identification, before: Device | None
) -> None:
    """Draw fit, residual, friction and intervals of an identification."""
    from identification import identified_picture

    with session.progress() as say:
        say("drawing")
        drawn = identified_picture(found.device, found.logs, before=before)
    draw(session, picture, drawn)


def draw_profile(
    session: Session, picture: Path, profile: Design, verdict: str | None = None
) -> None:
    """Draw region, limits and responses of every element, with a verdict in the title."""
    from tune.presentation.profile_picture import profile_sheet

    with session.progress() as say:
        say("drawing")
        drawn = profile_sheet(profile, verdict)
    draw(session, picture, drawn)


def draw_candidates(
    session: Session, picture: Path, rows: Sequence[CandidateEffect], motion: Motion
) -> None:
    """Draw the steps of every effect with each candidate."""
    from tune.optimisation.alternatives import candidates_picture

    draw(session, picture, candidates_picture(rows, motion))
