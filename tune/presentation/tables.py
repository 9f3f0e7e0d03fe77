"""Results as tables for a terminal or a page, and the sentences beside them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

from rich.box import SIMPLE_HEAD
from rich.table import Table

from identification import counted
from tune.documents.estimators import DERIVATIVES, filter_of
from tune.documents.scene import EFFECT_NAMES, UNITS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from identification import Device, Motion, Quantity
    from tune.documents.profile import Certificate, Contact, LoopProfile, SafeProfile
    from tune.documents.scene import MarginName
    from tune.judging import Audit
    from tune.optimisation import Alternative, Candidate, CandidateEffect

#: Perceived steps that nobody would buy anything for.
_HARDLY = 0.05
#: Part of the continuous force below which a wall is pushed through: it has that part where three
#: share a peak of no more; with less, something else has most of it.
_WEAK = 1 / 3


def headed_table(
    title: str, headings: Collection[str], *, right: Collection[str] = (), caption: str = ""
) -> Table:
    """An empty table with its columns; what is too wide is broken, headings between words."""
    table = Table(
        title=title, title_justify="left", caption=caption, caption_justify="left", box=SIMPLE_HEAD
    )
    for heading in headings:
        side = "right" if heading in right else "left"
        longest = max(map(len, heading.split()), default=0)
        table.add_column(heading, justify=side, overflow="fold", min_width=longest)
    return table


def rows_in_words(table: Table) -> str:
    """Title, a line a row with its heading before each cell, and caption."""
    headings, *rows = zip(*((each.header, *each.cells) for each in table.columns), strict=True)
    lines = [
        f"- {str(row[0]).strip()}: "
        + ", ".join(f"{name} {cell}" for name, cell in zip(headings[1:], row[1:], strict=True))
        for row in rows
    ]
    return "\n".join(str(each) for each in (table.title, *lines, table.caption) if each)


def units_of(motion: Motion | None) -> dict[str, str]:
    """Units by quantity; both of each where nobody stated the motion."""
    if motion is not None:
        return UNITS[motion]
    return {name: f"{unit} ({UNITS['rotary'][name]})" for name, unit in UNITS["linear"].items()}


def verdict_on(profile: SafeProfile) -> str:
    """What is proved of a profile, in one sentence."""
    seal = profile.certificate
    devices = "device the log allows" if profile.device.logs else "device within its intervals"
    late = counted(f"{seal.extra_delay_samples:g}", "more sample")
    hand = ", in every hand and in none" if seal.hand else ""
    return (
        f"safe: proved for every {devices}, up to {seal.gain:g} times the gain and with {late} of "
        f"delay{hand}"
    )


def device_line(device: Device) -> str:
    """Mass, damping and friction with half of their 95 % intervals, and what is only assumed."""
    units, parts = units_of(None if "motion" in device.missing else device.motion), list[str]()
    for label, quantity, kind in _device_rows(device)[:3]:
        half = relative_half_width(quantity)
        known = "" if half is None else f" ± {100 * half:.2g} %"
        name = label.rpartition(" ")[0]
        parts.append(f"{name} {_with_interval(quantity)[0]} {units[kind]}{known}")
    assumed = ", ".join(device.assumed()).replace("_", " ")
    return f"{device.name}: {', '.join(parts)}" + (f"; assumed: {assumed}" if assumed else "")


def effects_table(profile: SafeProfile, *, everything: bool = False) -> Table:
    """One row an effect, as narrow as a terminal: value, steps, margins, what binds.

    With everything also the ripple, and beneath it what is felt of each element and what is met on
    entering it. Of elements that are alike the first has rows, and beneath it says so.
    """
    lines, profile = list(_alike_lines(profile)), profile.one_of_each()
    units = UNITS[profile.device.motion]
    numbers = ("value", "steps", "gain", "delay", *["ripple"] * everything)
    title = f"{profile.scene} on {profile.device.name}, margin {profile.margin.name}"
    if everything:
        title += f"; filters: {filters_in_words(profile.loop)}"
        lines += [*_rendered_lines(profile), *_contact_lines(profile, units)]
        jitters = [each.margins.jitter for each in profile.elements.values()]
        if jitters and None not in jitters:
            least = _jitter_words(min(each or 0.0 for each in jitters))
            lines.append(f"each step of the loop may vary by {least} (assessed, not proved)")
    headings = ("effect", *numbers, "limited by")
    table = headed_table(title, headings, right=numbers, caption="\n".join(lines))
    for name, element in profile.elements.items():
        margins, noise = element.margins, element.ripple
        ripple = "-" if noise is None else f"{noise:.2g} {units['force']}"
        for effect, reason in element.limited_by.items():
            value: float = getattr(element, effect)
            size = plain_number(value, 6 if everything else 4)
            table.add_row(
                f"{name} {effect}",
                f"{size} {units[effect]}" if value else "-",
                f"{element.perceived_steps.get(effect, 0.0):.3g}",
                f"{margins.gain:.4g}",
                f"{_further_delay(margins.extra_delay_samples)} T",
                *[ripple] * everything,
                reason,
            )
    return table


def _alike_lines(profile: SafeProfile) -> Iterator[str]:
    """Which elements the first of each kind stands for, where there are some."""
    kinds = profile.alike()
    for first in dict.fromkeys(kinds.values()):
        others = [name for name, same in kinds.items() if same == first != name]
        if others:
            yield f"alike {first}: {', '.join(others)}"


def plain_number(value: float, digits: int = 4, sign: str = "") -> str:
    """So many digits at least, without an exponent where people write none."""
    large = 10**digits <= abs(value) < 1e7
    return f"{value:{sign}.0f}" if large else f"{value:{sign}.{digits}g}"


def changed_effects(before: Mapping[str, Any], profile: SafeProfile) -> str:
    """What became of each effect since the content of a file that stood there; "" if nothing."""
    units, lines = UNITS[profile.device.motion], list[str]()
    known: object = before.get("elements")
    old = cast("dict[str, Any]", known) if isinstance(known, dict) else {}
    for name in dict.fromkeys((*old, *profile.elements)):
        was: object = old.get(name)
        had = cast("dict[str, object]", was) if isinstance(was, dict) else {}
        element = profile.elements.get(name)
        for effect, unit in ((each, units[each]) for each in EFFECT_NAMES):
            then, now = had.get(effect) or 0.0, 0.0 if element is None else getattr(element, effect)
            if isinstance(then, int | float) and then != now:
                lines.append(f"{name} {effect} {plain_number(then)} → {plain_number(now)} {unit}")
    return "\n".join(lines)


def _further_delay(samples: float) -> str:
    """A delay margin in samples, which is not looked for beyond `MOST_EXTRA_DELAY`."""
    from tune.documents.profile import MOST_EXTRA_DELAY

    return f"≥{MOST_EXTRA_DELAY}" if samples >= MOST_EXTRA_DELAY else f"+{samples:g}"


def _rendered_lines(profile: SafeProfile) -> tuple[str, ...]:
    """What a hand feels of each element, mean and both ends of the motions people make."""
    units = UNITS[profile.device.motion]
    lines: list[str] = []
    for name, element in profile.elements.items():
        rendered = element.rendered
        if rendered is None:
            continue
        parts = [
            f"{effect} {plain_number(mean, 3, '+')} {units[effect]} "
            f"({_between(motion)}; {_between(beyond)})"
            for effect, mean, motion, beyond in (
                ("mass", rendered.mass, rendered.mass_in_motion, rendered.mass_beyond),
                ("damping", rendered.damping, rendered.damping_in_motion, rendered.damping_beyond),
            )
            if any(motion)
        ]
        if parts:
            lines.append(f"{name}: {', '.join(parts)}")
    heading = "felt of it in motions of 0.5 to 5 Hz, mean (least to largest; from 5 to 20 Hz):"
    return (heading, *lines) if lines else ()


def _between(ends: tuple[float, float]) -> str:
    return " to ".join(plain_number(end, 3, "+") for end in ends)


def filters_in_words(loop: LoopProfile) -> str:
    """Cut-offs, and the window, of a profile's filters."""
    every = [(which, filter_of(loop, which)) for which in DERIVATIVES]
    parts = [f"{which} {each}" for which, each in every if each.hertz is not None]
    if loop.filter_damping_ratio != 1:
        parts.append(f"damping ratio {loop.filter_damping_ratio:g}")
    if loop.velocity_window_samples is not None:
        parts.insert(0, f"velocity over {loop.velocity_window_samples} samples")
    return ", ".join(parts) or "none"


def candidates_table(
    found: tuple[Candidate, ...], rows: tuple[CandidateEffect, ...], chosen: MarginName
) -> Table:
    """One column a candidate, of each effect its value and its steps; the best has a star."""
    profiles = [candidate.profile for candidate in found if candidate.profile is not None]
    units = UNITS[profiles[0].device.motion] if profiles else {}
    place = f"{profiles[0].scene} on {profiles[0].device.name}, " if profiles else ""
    marked = {
        each.name: f"{each.name}{' >' * (each.name == chosen)}{' *' * each.recommended}"
        for each in found
    }
    table = headed_table(
        f"{place}candidates: value and steps (* recommended, > chosen)",
        ("effect", *marked.values()),
        right=marked.values(),
    )
    told = {(row.element, row.effect, row.candidate): row for row in rows}
    for element, effect in dict.fromkeys((row.element, row.effect) for row in rows):
        cells = [told.get((element, effect, name)) for name in marked]
        values = [plain_number(each.value) if each and each.value else "-" for each in cells]
        table.add_row(f"{element} {effect}, {units[effect]}", *values)
        table.add_row(
            "  steps", *("-" if each is None else f"{each.steps.value:.3g}" for each in cells)
        )
    return table


def candidates_lines(
    found: tuple[Candidate, ...], rows: tuple[CandidateEffect, ...]
) -> tuple[str, ...]:
    """What each margin demands and which filters it took, or why nothing can be played with it."""
    from tune.documents.scene import MARGINS

    lines: list[str] = []
    for each in found:
        margin, profile = MARGINS[each.margin], each.profile
        samples = f"{counted(margin.extra_delay_samples, 'extra sample')} of delay"
        result = (
            str(each.error) if profile is None else f"filters: {filters_in_words(profile.loop)}"
        )
        lines.append(f"{each.name}: every gain up to {margin.gain:g}, {samples}; {result}")
    sizes = [{(r.element, r.effect): r.value for r in rows if r.candidate == c.name} for c in found]
    if rows and all(other == sizes[0] for other in sizes):
        lines.append(
            "the same effects with every candidate: here the conservative one costs nothing"
        )
    return tuple(lines)


def certificate_lines(certificate: Certificate) -> tuple[str, ...]:
    """What was certified, in words."""
    worst = certificate.worst
    delay = " to ".join(dict.fromkeys(f"{item:.4g}" for item in certificate.delay_samples))
    beside = ["with modes"] if certificate.modes else []
    beside += ["without a hand and in every hand"] if certificate.hand else []
    own = certificate.position_stiffness
    spring = f", own stiffness {own[0]:.6g} to {own[1]:.6g}" if own else ""
    held = certificate.presliding_stiffness
    spring += f", before sliding {held[0]:.6g} to {held[1]:.6g}" if held else ""
    return (
        f"proved for every device: mass {certificate.mass[0]:.6g} to {certificate.mass[1]:.6g}, "
        f"damping {certificate.damping[0]:.6g} to {certificate.damping[1]:.6g}{spring} (together "
        f"{100 * certificate.confidence:g} %), delay {counted(delay, 'sample')} and up to "
        f"{certificate.extra_delay_samples:g} more, every gain in (0, {certificate.gain:g}]"
        + "".join(f", {part}" for part in beside),
        f"{counted(certificate.cells, 'cell')} excluded, {counted(certificate.points, 'point')} "
        f"judged; slowest of them: {' + '.join(worst.elements)}, pole radius 1 - "
        f"{1 - worst.pole_radius:.2g}",
        "not assessed: " + "; ".join(certificate.not_assessed),
    )


def _jitter_words(jitter: float) -> str:
    """A jitter, which is not looked for beyond `MOST_JITTER`."""
    from tune.stability.nonlinear import MOST_JITTER

    return f"{jitter:.0%} or more" if jitter >= MOST_JITTER else f"{jitter:.1%}"


def _contact_lines(profile: SafeProfile, units: dict[str, str]) -> tuple[str, ...]:
    """What a free device meets that enters each element at the speed of its motion."""
    lines: list[str] = []
    for name, element in profile.elements.items():
        if element.contact is not None:
            speed = f"{element.motion.speed:g} {units['speed']}"
            parts = _contact_words(element.contact, units, speed, element.stiffness)
            lines += [f"{name}: {', '.join(parts)}"] if parts else []
    return ("on entering, without a hand:", *lines) if lines else ()


def weak_walls(profile: SafeProfile) -> Iterator[str]:
    """Of each wall that gives little force what has the rest of the peak, and what to do."""
    limit, unit = profile.device.force_limit, UNITS[profile.device.motion]["force"]
    levels = {name: each.force_level for name, each in profile.elements.items() if each.stiffness}
    for name, wall in profile.one_of_each().elements.items():
        weak = wall.one_sided and wall.force_level > 0
        if limit is None or not weak or wall.force_level >= _WEAK * limit.continuous:
            continue
        met = ([each for each in levels if each in m] for m in profile.combinations() if name in m)
        fullest = max(met, key=lambda springs: sum(levels[each] for each in springs))
        others = sorted({*fullest} - {name}, key=lambda each: (-levels[each], each))
        deep = [each for each in others if profile.elements[each].motion.penetration]
        beside = " and ".join(f"{each} has {levels[each]:.3g} {unit}" for each in others)
        less = f", or state a smaller penetration for {' and '.join(deep)}" if deep else ""
        yield (
            f"{name} is pushed through with {wall.force_level:.3g} {unit}, of {limit.continuous:g} "
            f"{unit} that the device can hold: beside it {beside} of the peak of {limit.peak:g} "
            f"{unit}. Keep it from what it need not be met with (apart:, or out of together:){less}"
        )


def _contact_words(
    contact: Contact, units: dict[str, str], speed: str, stiffness: float
) -> tuple[str, ...]:
    """Bounce, depths, jolt, lead and energy of one element, those that it has, in words."""
    bounce, length = contact.restitution, units["length"]
    parts: list[str] = []
    if bounce is not None:
        ends = dict.fromkeys(f"{end:.2g}" for end in bounce)
        parts.append(f"gives back {' to '.join(ends)} of the speed while it is not cut")
    shallow, deep = contact.depth_at_continuous_force, contact.depth_at_peak_force
    if shallow is not None and deep is not None:
        # A clamp may let pass less than the continuous force.
        parts += [f"all of the continuous force at {shallow:.3g} {length}"] * (shallow < deep)
        parts.append(f"cut at {stiffness * deep:.3g} {units['force']}, {deep:.3g} {length} deep")
    if contact.lead is not None:
        side = "before" if contact.lead >= 0 else "behind"
        parts.append(f"met up to {abs(contact.lead):.2g} {length} {side} its place at {speed}")
    if (net := contact.net_damping) is not None:
        parts.append(f"damps by {plain_number(net, 3)} {units['damping']} net of its lag")
    if force := contact.force_on_entry:
        parts.append(f"{plain_number(force, 3)} {units['force']} on entry at {speed}")
    if contact.energy_per_entry is not None:
        parts.append(f"up to {contact.energy_per_entry:.2g} J an entry at {speed}")
    return tuple(parts)


def device_table(device: Device) -> Table:
    """Identified quantities with their 95 % intervals."""
    units = units_of(None if "motion" in device.missing else device.motion)
    table = headed_table(
        f"{device.name}, axis {device.axis}",
        ("quantity", "value", "95 % interval", "unit", "half-width"),
        right=("value", "95 % interval", "half-width"),
        caption="\n".join(
            f"{words}: {', '.join(names)}".replace("_", " ")
            for words, names in (
                ("missing, to be stated before anything is certified", device.missing),
                ("assumed, not known", device.assumed()),
            )
            if names
        ),
    )
    for label, quantity, kind in _device_rows(device):
        part = relative_half_width(quantity)
        share = "-" if part is None else f"{100 * part:.2g} %"
        table.add_row(label, *_with_interval(quantity), units[kind], share)
    for label, cells, kind in _axes_rows(device):
        table.add_row(label, *cells, units[kind], "-")
    for label, found, kind in (
        ("slope of friction", device.damping_slope, "damping"),
        ("stiffness before sliding", device.presliding_stiffness, "stiffness"),
    ):
        if found is not None:
            between = f"{found.low:.4g} .. {found.high:.4g}"
            table.add_row(label, "-", between, units[kind], "-")
    return table


def _device_rows(device: Device) -> list[tuple[str, Quantity, str]]:
    """(label, quantity, kind of its unit) of everything identified that has a value."""
    rows = [
        ("mass m", device.mass, "mass"),
        ("damping b", device.damping, "damping"),
        ("Coulomb friction Fc", device.coulomb_friction, "force"),
        ("force offset f0", device.force_offset, "force"),
    ]
    for what, pair, kind in (
        ("damping", device.damping_by_direction, "damping"),
        ("Coulomb friction", device.friction_by_direction, "force"),
    ):
        if pair is not None:
            rows += [(f"{what} forward", pair.forward, kind)]
            rows += [(f"{what} backward", pair.backward, kind)]
    if device.position_stiffness is not None:
        rows.append(("force by position k", device.position_stiffness, "stiffness"))
    if device.gravity is not None:
        rows.append(("gravity, sine", device.gravity.sine, "force"))
        rows.append(("gravity, cosine", device.gravity.cosine, "force"))
    return rows


#: What is told of every direction.
_ENDS = ("least mass", "largest mass", "least damping", "largest damping")


def _axes_rows(device: Device) -> list[tuple[str, tuple[str, str], str]]:
    """Label, value and interval, and unit of what a device of several axes has by direction."""
    rows: list[tuple[str, tuple[str, str], str]] = []
    names = device.axes or ()
    for place, pose in enumerate(device.poses or (), start=1):
        where = f", pose {place}" if len(device.poses or ()) > 1 else ""
        ends = (*pose.extremes("mass", 0.0), *pose.extremes("damping", 0.0))
        for label, end in zip(_ENDS, ends, strict=True):
            cells = f"{end.value:.4g}", end.along(names)
            rows.append((label + where, cells, label.rpartition(" ")[2]))
        for axis, friction in zip(names, pose.coulomb_friction, strict=True):
            rows.append((f"friction of {axis}{where}", (f"{friction:.4g}", "-"), "force"))
    return rows


def half_widths(device: Device) -> dict[str, float | None]:
    """By label, half of each interval as part of its value; None where there is no such part."""
    return {label: relative_half_width(quantity) for label, quantity, _ in _device_rows(device)}


def _with_interval(quantity: Quantity) -> tuple[str, str]:
    """Value and interval to two digits of the half-width."""
    half = half_width(quantity)
    if half == 0:
        return f"{quantity.value:.6g}", "-"
    digits = max(0, 1 - math.floor(math.log10(half)))
    low, high = f"{quantity.low:.{digits}f}", f"{quantity.high:.{digits}f}"
    return f"{quantity.value:.{digits}f}", f"{low} .. {high}"


def half_width(quantity: Quantity) -> float:
    """Half of the interval, in the unit of the quantity."""
    return (quantity.high - quantity.low) / 2


def relative_half_width(quantity: Quantity) -> float | None:
    """Half of the interval as part of the value; None where it is exact or the value is zero."""
    if quantity.exact or quantity.value == 0:
        return None
    return half_width(quantity) / abs(quantity.value)


def audit_table(found: Audit) -> Table:
    """Everything that was computed, with what is needed of it."""
    design = found.design
    delay = counted(f"{design.loop.extra_delay_samples:g}", "sample")
    title = f"{design.device.name}, delay {delay}, margin {design.margin.name}"
    table = headed_table(title, ("what", "seen", "needed"))
    for row in _audit_rows(found):
        table.add_row(*row)
    return table


def _audit_rows(found: Audit) -> Iterator[tuple[str, str, str]]:
    """(what, seen, needed) of everything that was computed."""
    from tune.judging import ELEMENT

    design, margins = found.design, found.margins
    units, limit = UNITS[design.device.motion], design.device.force_limit
    force, late = units["force"], found.delay_samples
    box = design.device.simultaneous_box()
    pairs = {"mass": box.mass, "damping": box.damping}.items()
    sides = [f"{name} {low:.6g} to {high:.6g} {units[name]}" for name, (low, high) in pairs]
    sides += [] if design.device.logs else ["stated or assumed, from no log"]
    yield "the box", ", ".join(sides), "-"
    yield "gain margin over the box", f"{found.gain:.4g}", f"{design.margin.gain:g}"
    seen = "-" if math.isnan(late) else _further_delay(late)
    yield "extra delay, samples, over the box", seen, f"{design.margin.extra_delay_samples}"
    yield "steps longer or shorter, assessed", f"by {_jitter_words(found.jitter)}", "-"
    for what, value, most in (
        ("sustained force", found.sustained, limit and limit.continuous),
        ("peak force", found.peak, limit and limit.peak),
    ):
        seen = "cut at its limit" if value is None else f"{value:.4g} {force}"
        yield what, seen, "-" if most is None else f"at most {most:g}"
    if found.ripple is not None:
        allowed = f"at most {design.ripple_limit:g}"
        yield "force ripple from the encoder", f"{found.ripple:.3g} {force} rms", allowed
    for name, jump in found.jumps.items():
        yield f"one count through {name}", f"{jump:.3g} {force}", "-"
    speed = f"{design.elements[ELEMENT].motion.speed:g} {units['speed']}"
    stiffness = design.elements[ELEMENT].stiffness
    met = ", ".join(_contact_words(found.wall, units, speed, stiffness))
    most = "-" if found.lead is None else f"met at most {found.lead:g} {units['length']} before it"
    yield "as a wall that only pushes, a free device", met or "-", most
    if margins is None:
        return
    yield "slowest decay", f"{margins.decay:.4g} 1/s", "-"
    yield "least damping ratio", f"{margins.damping_ratio:.3g}", "-"
    yield "phase margin", f"{margins.phase:.3g}°" if math.isfinite(margins.phase) else "-", "-"
    seen = f"{margins.disk:.3g} at {margins.critical_frequency_hz:.3g} Hz"
    yield "disk margin", seen, "-"
    passive = found.passivity
    seen = "not applicable: " + passive.reason
    if passive.damping_needed is not None:
        above = f"{passive.damping_needed:.5g} {units['damping']}"
        seen = f"{'yes' if passive.passive else 'no'}, needs b above {above}"
    yield "passive", seen, "-"


def alternatives_table(found: tuple[Alternative, ...]) -> Table:
    """One row a change of the hardware: perceived steps in all, and where most are won or lost."""
    now = found[0]
    table = headed_table(
        "what would help: perceived steps with one fact of the hardware changed",
        ("with", "steps", "won", "most of it"),
        right=("steps", "won"),
    )
    for each in found:
        won = steps_won(each, now)
        most = max(won, key=lambda name: abs(won[name]), default=None)
        table.add_row(
            each.change,
            "none" if each.reason is not None else f"{each.total:.3g}",
            "-" if each is now or each.reason is not None else f"{each.total - now.total:+.2g}",
            "-" if most is None or abs(won[most]) < _HARDLY else f"{most} {won[most]:+.2g}",
        )
    return table


def steps_won(each: Alternative, now: Alternative) -> dict[str, float]:
    """Steps more than the device as it is has, by "element.effect"."""
    return {
        name: each.steps.get(name, 0.0) - now.steps.get(name, 0.0)
        for name in dict.fromkeys((*now.steps, *each.steps))
    }
