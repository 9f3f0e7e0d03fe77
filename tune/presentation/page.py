"""A report as one page: what it shows, and the HTML of it, complete in itself."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import asdict, dataclass
from importlib.resources import files
from io import BytesIO
from typing import TYPE_CHECKING, Any, cast

from tune.exporters import NOT_A_SAFETY_FUNCTION
from tune.presentation.surface import Surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class TableView:
    """A table of a page.

    Attributes:
        title: above it; empty for none.
        headings: of the columns.
        numeric: of each column, whether its cells are numbers, set to the right.
        rows: cells as text.
        lines: below it.
    """

    title: str
    headings: tuple[str, ...]
    numeric: tuple[bool, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureView:
    """A picture of a page, as a data URI, and what it shows in words."""

    words: str
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingView:
    """One finding about a log."""

    code: str
    severity: str
    source: str
    seen: str
    needed: str
    remedy: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """What is said under one heading of the chapter on what a profile rests on."""

    heading: str
    lead: str
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Everything that a report shows.

    Attributes:
        title: of the page.
        facts: (what, value) of the head: device, serial number, date, digest, versions.
        verdict: the one sentence a reader takes away.
        effects: the elements of the profile.
        notes: sentences below it: why effects were dropped.
        limits: (what binds, what it means, what helps) of the limits that bind.
        surface: of the region.
        pictures: of the profile.
        device: tables of the device.
        log_pictures: of its logs.
        findings: about its logs.
        log_lines: sentences about its logs.
        statements: what is proved, assumed, assessed and trusted.
        alternatives: what would help; None where it was not asked for.
        day: of the report.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    verdict: str
    effects: TableView
    notes: tuple[str, ...]
    limits: tuple[tuple[str, str, str], ...]
    surface: Surface
    pictures: tuple[PictureView, ...]
    device: TableView
    log_pictures: tuple[PictureView, ...]
    findings: tuple[FindingView, ...]
    log_lines: tuple[str, ...]
    statements: tuple[Statement, ...]
    alternatives: TableView | None
    day: str


def picture_view(figure: Figure, words: str) -> PictureView:
    """A figure as vectors that a page holds; letters are shapes, so that no font is needed."""
    import matplotlib as mpl

    # matplotlib types its keyword arguments only in part
    stream, picture, settings = BytesIO(), cast("Any", figure), cast("Any", mpl)
    with settings.rc_context({"svg.hashsalt": "haptune", "svg.fonttype": "path"}):
        picture.savefig(stream, format="svg", metadata={"Date": None})
    coded = b64encode(stream.getvalue()).decode("ascii")
    return PictureView(words=words, source=f"data:image/svg+xml;base64,{coded}")


def html_of(page: Page) -> str:
    """The page as HTML with its style, script and pictures inside; every text is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("tune", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    own = files("tune") / "templates"
    return environment.get_template("report.html").render(
        page=page,
        surface=asdict(page.surface),
        style=(own / "report.css").read_text(encoding="utf-8"),
        script=(own / "report.js").read_text(encoding="utf-8"),
        warning=NOT_A_SAFETY_FUNCTION,
    )
