"""The report of a profile: one page of HTML to read, print and sign, complete in itself."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Sequence
from datetime import date
from importlib.metadata import version
from io import BytesIO
from typing import TYPE_CHECKING, Any, cast

from identification import counted
from tune.documents.scene import UNITS
from tune.exporters import NOT_A_SAFETY_FUNCTION
from tune.presentation.limits import effect_uses
from tune.presentation.tables import (
    alternatives_table,
    certificate_lines,
    device_line,
    device_table,
    effects_table,
    filters_in_words,
    verdict_on,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from identification import Identification, Quantity
    from tune.documents.profile import SafeProfile
    from tune.optimisation import Alternative


def report_html(
    safe: SafeProfile, found: Identification | None, alternatives: tuple[Alternative, ...] | None
) -> str:
    """The page of a profile that passed its check, every text escaped."""
    written = date.today().isoformat()
    return _rendered(
        "report.html",
        page={
            "title": f"{safe.scene} on {safe.device.name}: haptic profile",
            "facts": list(_facts(safe, written)),
            "verdict": verdict_on(safe),
            "used": effect_uses(safe),
            "effects": plain_table(effects_table(safe, everything=True)),
            "notes": safe.notes,
            "pictures": list(_pictures(safe)),
            "device": plain_table(device_table(safe.device)),
            "log_pictures": [] if found is None else [_fit(safe, found)],
            "findings": () if found is None else found.findings,
            "log_lines": list(_log_lines(safe, found)),
            "trusted": list(_trusted(safe)),
            "record": _record(safe),
            "alternatives": alternatives and plain_table(alternatives_table(alternatives)),
            "day": written,
        },
        running=_css_text(f"serial {_stated(safe.device.serial)}, {safe.digest}"),
    )


def summary_html(
    title: str, verdicts: Sequence[str], tables: Sequence[Table], figure: Figure, words: str
) -> str:
    """A page of verdicts, the tables behind them, and one picture with what it shows in words."""
    page = {"title": title, "tables": map(plain_table, tables), "picture": _picture(words, figure)}
    return _rendered("summary.html", page=page, verdicts=verdicts)


def _rendered(name: str, **values: object) -> str:
    """A template of a page with its values, every text escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("tune", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name).render(warning=NOT_A_SAFETY_FUNCTION, **values)


def plain_table(table: Table) -> dict[str, object]:
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


def _facts(safe: SafeProfile, written: str) -> Iterator[tuple[str, str]]:
    """Whose profile it is, of when, and every fact that a person stated for it."""
    from matplotlib.ticker import EngFormatter

    device, units, loop, hand = safe.device, UNITS[safe.device.motion], safe.loop, safe.hand

    def told(quantity: Quantity | None, unit: str) -> str:
        if quantity is None:
            return "not stated"
        ends = (quantity.value,) if quantity.exact else (quantity.low, quantity.high)
        words = " to ".join(EngFormatter(unit)(end) for end in ends)
        return words + (" (assumed)" if quantity.source == "assumed" else "")

    yield "device", f"{device.name}, axis {device.axis}, {device.motion}"
    yield "serial number", _stated(device.serial)
    yield "calibrated on, by", f"{_stated(device.date)}, {_stated(device.operator)}"
    yield "sample time", told(device.sample_time, "s")
    yield "delay, command to measurement", told(device.delay, "s")
    yield "encoder resolution", told(device.encoder_resolution, units["length"])
    limit, force = device.force_limit, units["force"]
    most = "not stated" if limit is None else f"{limit.continuous:g} and {limit.peak:g} {force}"
    yield "force limit, continuous and peak", most
    modes = ", ".join(told(mode.frequency_hz, "Hz") for mode in device.modes)
    yield "vibration modes", modes or "none"
    lag = device.current_lag
    yield "lag of the drive", "none" if lag is None else told(lag, "s")
    grip = "none" if hand is None else ", ".join(told(each, units[name]) for name, each in hand)
    yield "hand", grip
    yield "identified", device_line(device).partition(": ")[2]
    margin = safe.margin
    late = counted(margin.extra_delay_samples, "extra sample")
    yield "margin asked for", f"{margin.name}: gain {margin.gain:g}, {late} of delay"
    yield "filters", filters_in_words(loop)
    yield "ripple allowed", f"{safe.ripple_limit:g} {force} rms"
    motions: dict[str, list[str]] = {}
    for name, element in safe.elements.items():
        motion, speed = element.motion, units["speed"]
        words = f"{motion.speed:g} {speed}, {motion.acceleration:g} {speed[:-1]}s²"
        if motion.penetration is not None:
            words += f", {motion.penetration:g} {units['length']} deep"
        motions.setdefault(words, []).append(name)
    for words, names in motions.items():
        yield f"the hand moves in {', '.join(names)}", words
    if safe.perception is not None:
        yield "what a hand can tell, by", safe.perception.name
    yield "digest of the profile", safe.digest
    yield "report of", f"{written}, by haptune {version('haptune')}"


def _stated(value: object) -> str:
    return "not stated" if value is None else str(value)


def _picture(words: str, *figures: Figure) -> dict[str, object]:
    """Figures as vectors inside the page; letters are shapes, so that no font is needed."""
    import matplotlib as mpl

    sources: list[str] = []
    settings = cast("Any", mpl)  # matplotlib types its keyword arguments only in part
    for figure in figures:
        stream, picture = BytesIO(), cast("Any", figure)
        with settings.rc_context({"svg.hashsalt": "haptune", "svg.fonttype": "path"}):
            picture.savefig(stream, format="svg", metadata={"Date": None})
        coded = b64encode(stream.getvalue()).decode("ascii")
        sources.append(f"data:image/svg+xml;base64,{coded}")
    return {"words": words, "sources": sources}


def _pictures(safe: SafeProfile) -> Iterator[dict[str, object]]:
    from tune.presentation import pictures

    safe = safe.one_of_each()
    region = pictures.region_picture(safe)
    words = "The region without mass with every element. Below, of each element: its region and "
    words += "what is left to the margin; the part of each limit that it uses. "
    yield _picture(words + pictures.words_of_shown(safe), region)
    for name in pictures.shown_elements(safe):
        drawn = pictures.element_pictures(safe, name)
        yield _picture(pictures.sizes_in_words(safe, name), *drawn)


def _fit(safe: SafeProfile, found: Identification) -> dict[str, object]:
    from identification import identified_picture

    return _picture(
        "The logs and what the device explains of them: position, force, what is left of it, with "
        "spectrum and correlation; friction over speed; what is known now and in the profile "
        '("before"), by every method that was asked.',
        identified_picture(found.device, found.logs, before=safe.device),
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


def _trusted(safe: SafeProfile) -> Iterator[str]:
    """What no calculation can confirm, in plain words: seven sentences at most."""
    device, seal = safe.device, safe.certificate
    assumed = " and the ".join(name.replace("_", " ") for name in device.assumed())
    only = f", only assumed for the {assumed}" if assumed else ""
    yield f"The facts on the first page are those of this device{only}."
    if device.logs:
        units = UNITS[device.motion]
        yield (
            "The logs were taken on this device, which has not changed since, with no hand on it, "
            f"force in {units['force']} and position in {units['length']}."
        )
    yield (
        f"The controller runs the exported law with the filters named, every "
        f"{1e3 * safe.loop.sample_time:g} ms, and is never later than the delay and its margin."
    )
    rigid = "vibrates in no way but those stated" if device.modes else "is rigid"
    kinds = {force.words for log in device.logs for force in log.unmodelled_forces}
    others = f"; the proof leaves out {', '.join(sorted(kinds))}" if kinds else ""
    yield f"The mechanism {rigid}, and its drive lags by no more than stated{others}."
    yield (
        "The proof is of the device alone: what a hand adds was not asked for."
        if seal.hand is None
        else "Hands that hold it are within the range stated, or none holds it."
    )
    yield (
        "Elements and gains change slowly against the loop, except for what the exported guard "
        "switches, cuts or fades itself."
    )
    yield (
        "Oscillation from encoder counts and friction, and periods of uneven length, were played "
        "in simulation or computed at the ends of the intervals, not proved."
    )


def _record(safe: SafeProfile) -> dict[str, tuple[str, ...]]:
    """The certificate line by line, as the profile holds it."""
    seal = safe.certificate
    proved = (
        *certificate_lines(seal)[:-1],
        f"by: {seal.method}",
        f"combinations proved: {'; '.join(seal.interior)}",
        *(
            f"{names}: absolutely stable up to gain {each.gain:.4g} with "
            f"{counted(f'{each.extra_delay_samples:g}', 'more sample')}: {', '.join(each.covers)}"
            for names, each in (seal.absolute_stability or {}).items()
        ),
        "certified with " + ", ".join(f"{name} {each}" for name, each in seal.versions.items()),
    )
    return {"Proved": proved, "Assumed": seal.assumes, "Not assessed": seal.not_assessed}


def _css_text(words: str) -> str:
    """A string of a style sheet that no letter of it can end."""
    return '"' + "".join(each if each.isalnum() else f"\\{ord(each):x} " for each in words) + '"'
