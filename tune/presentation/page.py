"""The report of a profile: one page of HTML to read, print and sign, complete in itself."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from datetime import date
from importlib.metadata import version
from importlib.resources import files
from io import BytesIO
from typing import TYPE_CHECKING, Any, cast

from tune.documents.profile import Design, LimitedBy
from tune.exporters import NOT_A_SAFETY_FUNCTION
from tune.presentation.regions import Boundaries, region_surface
from tune.presentation.tables import (
    alternatives_table,
    certificate_lines,
    device_table,
    elements_table,
    filters_in_words,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from identification import Identification
    from tune.documents.profile import SafeProfile
    from tune.optimisation import Alternative


def report_html(
    safe: SafeProfile,
    found: Identification | None,
    alternatives: tuple[Alternative, ...] | None,
    day: date | None = None,
) -> str:
    """The page of a profile that passed its check, every text escaped.

    It shows what its logs tell, where they are at hand, and what would help, where somebody asked.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    boundaries = Boundaries.of(safe)
    written = (day or date.today()).isoformat()
    own, loader = files("tune") / "templates", PackageLoader("tune", "templates")
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html").render(
        page={
            "title": f"{safe.scene} on {safe.device.name}: haptic profile",
            "facts": list(_facts(safe, written)),
            "gain": f"{safe.certificate.gain:g}",
            "late": f"{safe.certificate.extra_delay_samples:g}",
            "effects": _table(elements_table(safe)),
            "notes": safe.notes,
            "limits": _limits(safe),
            "pictures": list(_pictures(safe, boundaries)),
            "device": _table(device_table(safe.device)),
            "log_pictures": [] if found is None else [_fit(safe, found)],
            "findings": () if found is None else found.findings,
            "log_lines": list(_log_lines(safe, found)),
            "statements": _statements(safe),
            "alternatives": alternatives and _table(alternatives_table(alternatives)),
            "day": written,
        },
        surface=region_surface(safe, boundaries),
        style=(own / "report.css").read_text(encoding="utf-8"),
        script=(own / "report.js").read_text(encoding="utf-8"),
        warning=NOT_A_SAFETY_FUNCTION,
    )


def _table(table: Table) -> dict[str, object]:
    """A table of the terminal as one of the page: the very same numbers."""

    def plain(item: object) -> str:
        return str(getattr(item, "plain", item))  # a rich Text has its own

    columns = [[plain(cell) for cell in column.cells] for column in table.columns]
    return {
        "title": plain(table.title or ""),
        "headings": [plain(column.header) for column in table.columns],
        "numeric": [column.justify == "right" for column in table.columns],
        "rows": list(zip(*columns, strict=True)),
        "lines": plain(table.caption).splitlines() if table.caption else [],
    }


def _limits(design: Design) -> list[tuple[LimitedBy, str]]:
    """(limit, which effects it binds), each limit once."""
    bound: dict[LimitedBy, list[str]] = {}
    for name, element in design.elements.items():
        for effect, reason in element.limited_by.items():
            bound.setdefault(reason, []).append(f"{name} {effect}")
    return [(reason, ", ".join(effects)) for reason, effects in bound.items()]


def _facts(safe: SafeProfile, written: str) -> Iterator[tuple[str, str]]:
    """Whose profile it is, of when, and what computed it."""
    device = safe.device
    yield "device", device.name
    yield "axis", f"{device.axis}, {device.motion}"
    stated = {"serial number": device.serial, "calibrated on": device.date}
    for name, value in (stated | {"logs taken by": device.operator}).items():
        yield name, "not stated" if value is None else str(value)
    yield "scene", safe.scene
    margin, loop = safe.margin, safe.loop
    late = f"{margin.extra_delay_samples} extra sample(s) of delay"
    yield "margin", f"{margin.name}: gain {margin.gain:g}, {late}"
    delay = f"delay {loop.extra_delay_samples:g} sample(s)"
    yield "loop", f"{1 / loop.sample_time:.6g} Hz, {delay}, filters: {filters_in_words(loop)}"
    yield "digest of the profile", safe.digest
    yield "report of", f"{written}, by haptune {version('haptune')}"
    versions = ", ".join(f"{name} {number}" for name, number in safe.certificate.versions.items())
    yield "certified with", versions


def _picture(figure: Figure, words: str) -> dict[str, str]:
    """A figure as vectors inside the page; letters are shapes, so that no font is needed."""
    import matplotlib as mpl

    # matplotlib types its keyword arguments only in part
    stream, picture, settings = BytesIO(), cast("Any", figure), cast("Any", mpl)
    with settings.rc_context({"svg.hashsalt": "haptune", "svg.fonttype": "path"}):
        picture.savefig(stream, format="svg", metadata={"Date": None})
    coded = b64encode(stream.getvalue()).decode("ascii")
    return {"words": words, "source": f"data:image/svg+xml;base64,{coded}"}


def _pictures(safe: SafeProfile, boundaries: Boundaries) -> Iterator[dict[str, str]]:
    from tune.presentation.pictures import (
        element_picture,
        profile_picture,
        shown_elements,
        words_of_shown,
    )

    shown = words_of_shown(safe)
    words = (
        "The region without mass with every element, and the steps a hand can tell of each effect"
    )
    words += f"; {shown}." if shown else "."
    yield _picture(profile_picture(safe, boundaries=boundaries), words)
    for name in shown_elements(safe):
        yield _picture(
            element_picture(safe, name, boundaries=boundaries),
            f"{name}: its place in the region of its own mass and what is left to the margin; the "
            "part of each limit that it uses; its answers to a step of force and to an impact.",
        )


def _fit(safe: SafeProfile, found: Identification) -> dict[str, str]:
    from identification import identified_picture

    return _picture(
        identified_picture(found.device, found.logs, before=safe.device),
        "The logs and what the device explains of them: position, force, what is left of it, with "
        "spectrum and correlation; friction over speed; what is known now and in the profile "
        '("before"), by every method that was asked.',
    )


def _log_lines(safe: SafeProfile, found: Identification | None) -> Iterator[str]:
    """Each log with its digest and findings, and what reading it again gave."""
    for log in safe.device.logs:
        codes = f"; findings: {', '.join(log.findings)}" if log.findings else "; no findings"
        allowed = f"; accepted by a person: {', '.join(log.allowed)}" if log.allowed else ""
        read = f"; read with {log.read_as}" if log.read_as else ""
        yield (
            f"{log.source}: {log.samples} samples, {log.method}{codes}{allowed}{read}; {log.digest}"
        )
    if not safe.device.logs:
        yield "no log is known: the numbers of the device were stated"
    elif found is None:
        yield "the logs were not given to this report; their findings are named by code only"
    else:
        mass, damping = found.device.mass.value, found.device.damping.value
        before = f"{safe.device.mass.value:.6g} and {safe.device.damping.value:.6g}"
        now = f"mass {mass:.6g}, damping {damping:.6g}"
        yield f"identified again for this report: {now}; in the profile {before}"


def _statements(safe: SafeProfile) -> dict[str, tuple[str, ...]]:
    """What is proved, assumed, not assessed and taken on trust, line by line."""
    from tune.certificate.certify import trusted_facts
    from tune.certificate.check import OPINIONS, TAKEN_ON_TRUST

    seal = safe.certificate
    absolute = (seal.absolute_stability or {}).items()
    proved = (
        *certificate_lines(seal)[:-1],
        f"by: {seal.method}",
        f"moments proved: {'; '.join(seal.interior)}",
        *(
            f"{names}: absolutely stable up to gain {each.gain:.4g} with "
            f"{each.extra_delay_samples:g} more sample(s): {', '.join(each.covers)}"
            for names, each in absolute
        ),
    )
    trusted = (f"{each.key}: {each.reason}" for each in (*TAKEN_ON_TRUST, *OPINIONS))
    return {
        "proved": proved,
        "assumed": seal.assumes,
        "not_assessed": seal.not_assessed,
        "trusted": (*trusted_facts(safe.device), *trusted),
    }
