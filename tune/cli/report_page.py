"""What a report of a profile shows: the tables of the commands, pictures, and what it rests on.

One file: the chapters of one page, in their order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from datetime import date
from typing import TYPE_CHECKING

from tune.cli.device_table import device_table
from tune.cli.page_tables import table_view
from tune.cli.tables import certificate_lines, elements_table
from tune.cli.what_if import alternatives_table
from tune.presentation.page import FindingView, Page, PictureView, Statement, picture_view

if TYPE_CHECKING:
    from identification import Identification
    from tune._what_if import Alternative
    from tune.documents.profile import SafeProfile
    from tune.presentation.boundaries import Boundaries

#: What a reader takes away.
_VERDICT = (
    "Checked on {day}: all that the profile says was computed anew by an independent path, and "
    "nothing differs. Stable on every device in the box below, for every gain up to {gain:g} times "
    "the one written, with up to {late:g} more sample(s) of delay."
)


def page_of(
    safe: SafeProfile,
    found: Identification | None,
    alternatives: tuple[Alternative, ...] | None,
    day: date | None = None,
) -> Page:
    """The page of a profile that passed its check.

    Args:
        safe: the profile.
        found: what its logs tell; None where they are not at hand.
        alternatives: what would help; None where nobody asked.
        day: of the report; None takes today.
    """
    from tune.presentation.boundaries import Boundaries
    from tune.presentation.remedies import limits_of
    from tune.presentation.surface import region_surface

    boundaries = Boundaries.of(safe)
    written = (day or date.today()).isoformat()
    return Page(
        title=f"{safe.scene} on {safe.device.name}: haptic profile",
        facts=tuple(_facts(safe, written)),
        verdict=_VERDICT.format(
            day=written,
            gain=safe.certificate.gain,
            late=safe.certificate.extra_delay_samples,
        ),
        effects=table_view(elements_table(safe)),
        notes=safe.notes,
        limits=limits_of(safe),
        surface=region_surface(safe, boundaries),
        pictures=tuple(_pictures(safe, boundaries)),
        device=table_view(device_table(safe.device)),
        log_pictures=() if found is None else (_fit(safe, found),),
        findings=() if found is None else tuple(FindingView(**asdict(f)) for f in found.findings),
        log_lines=tuple(_log_lines(safe, found)),
        statements=tuple(_statements(safe)),
        alternatives=None if alternatives is None else table_view(alternatives_table(alternatives)),
        day=written,
    )


def _facts(safe: SafeProfile, written: str) -> Iterator[tuple[str, str]]:
    """Whose profile it is, of when, and what computed it."""
    from importlib.metadata import version

    device = safe.device
    yield "device", device.name
    yield "axis", f"{device.axis}, {device.motion}"
    for name, value in (
        ("serial number", device.serial),
        ("calibrated on", device.date),
        ("logs taken by", device.operator),
    ):
        yield name, "not stated" if value is None else str(value)
    yield "scene", safe.scene
    margin, loop = safe.margin, safe.loop
    late = f"{margin.extra_delay_samples} extra sample(s) of delay"
    yield "margin", f"{margin.name}: gain {margin.gain:g}, {late}"
    filters = ", ".join(
        f"{what} {value:g} Hz"
        for what, value in (
            ("velocity", loop.velocity_filter_hz),
            ("acceleration", loop.acceleration_filter_hz),
        )
        if value is not None
    )
    delay = f"delay {loop.extra_delay_samples:g} sample(s)"
    yield "loop", f"{1 / loop.sample_time:.6g} Hz, {delay}, filters: {filters or 'none'}"
    yield "digest of the profile", safe.digest
    yield "report of", f"{written}, by haptune {version('haptune')}"
    yield (
        "certified with",
        ", ".join(f"{name} {number}" for name, number in safe.certificate.versions.items()),
    )


def _pictures(safe: SafeProfile, boundaries: Boundaries) -> Iterator[PictureView]:
    from tune.presentation.element_picture import element_picture
    from tune.presentation.profile_picture import (
        profile_picture,
        shown_elements,
        words_of_shown,
    )

    shown = words_of_shown(safe)
    yield picture_view(
        profile_picture(safe, boundaries=boundaries),
        "The region without mass with every element, and the steps a hand can tell of each effect"
        + (f"; {shown}." if shown else "."),
    )
    for name in shown_elements(safe):
        yield picture_view(
            element_picture(safe, name, boundaries=boundaries),
            f"{name}: its place in the region of its own mass and what is left to the margin; the "
            "part of each limit that it uses; its answers to a step of force and to an impact.",
        )


def _fit(safe: SafeProfile, found: Identification) -> PictureView:
    from identification import identified_picture

    return picture_view(
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
        yield (
            f"identified again for this report: mass {found.device.mass.value:.6g}, damping "
            f"{found.device.damping.value:.6g}; in the profile {safe.device.mass.value:.6g} and "
            f"{safe.device.damping.value:.6g}"
        )


def _statements(safe: SafeProfile) -> Iterator[Statement]:
    """What is proved, assumed, assessed, left out and taken on trust."""
    from tune.certificate.assumptions import trusted_facts
    from tune.certificate.check import OPINIONS, TAKEN_ON_TRUST

    seal = safe.certificate
    yield Statement(
        heading="Proved",
        lead="Shown for every point of the box, by interval arithmetic or in as many digits as it "
        "takes.",
        lines=(
            *certificate_lines(seal)[:-1],
            f"by: {seal.method}",
            f"moments proved: {'; '.join(seal.interior)}",
            *(
                f"{moment}: absolutely stable up to gain {each.gain:.4g} with "
                f"{each.extra_delay_samples:g} more sample(s): {', '.join(each.covers)}"
                for moment, each in (seal.absolute_stability or {}).items()
            ),
        ),
    )
    yield Statement(
        heading="Assumed",
        lead="The proof holds where all of this does.",
        lines=seal.assumes,
    )
    yield Statement(
        heading="Assessed, not proved",
        lead="Computed at corners of the box or played in simulation.",
        lines=(
            "what is felt of each element, what entering it amounts to and by how much steps may "
            "vary: the lines below the table of what is played",
            "before it was written, every moment was rehearsed in simulation with quantiser, "
            "friction and force limit, entered and left and at gains that change: it settles",
        ),
    )
    yield Statement(
        heading="Not assessed", lead="Nobody has looked at this.", lines=seal.not_assessed
    )
    yield Statement(
        heading="Taken on trust",
        lead="No calculation can confirm it: the person who signs answers for it.",
        lines=(
            *trusted_facts(safe.device),
            *(f"{each.key}: {each.reason}" for each in (*TAKEN_ON_TRUST, *OPINIONS)),
        ),
    )
