"""Results as tables for a terminal.

One file: the tables that several commands print.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table

from tune.cli.contacts import contact_lines, jitter_words
from tune.documents.effects import UNITS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from identification import Motion
    from tune.documents.certified import Certificate
    from tune.documents.perception import Estimate
    from tune.documents.profile import LoopProfile, SafeProfile
    from tune.documents.scene import MarginName
    from tune.optimisation.candidates import Candidate, CandidateEffect


def units_of(motion: Motion | None) -> dict[str, str]:
    """Units by quantity; both of each where nobody stated the motion."""
    if motion is not None:
        return UNITS[motion]
    return {name: f"{unit} ({UNITS['rotary'][name]})" for name, unit in UNITS["linear"].items()}


def elements_table(profile: SafeProfile) -> Table:
    """One row an effect: value, perceived steps, gain and delay margin, ripple, what binds."""
    units = UNITS[profile.device.motion]
    table = Table(
        title=f"{profile.scene} on {profile.device.name}, margin {profile.margin.name}; "
        f"filters: {_filters(profile.loop)}",
        title_justify="left",
        caption="\n".join(
            (*_rendered_lines(profile), *contact_lines(profile, units), *_uneven(profile))
        ),
        caption_justify="left",
        box=SIMPLE_HEAD,
    )
    for heading in ("effect", "value", "steps", "gain", "delay", "ripple", "limited by"):
        numeric = heading not in {"effect", "limited by"}
        table.add_column(
            heading,
            justify="right" if numeric else "left",
            overflow="fold",  # what is too wide is broken, never cut
        )
    for name, element in profile.elements.items():
        for effect, reason in element.limited_by.items():
            value: float = getattr(element, effect)
            table.add_row(
                f"{name} {effect}",
                f"{value:.6g} {units[effect]}" if value else "-",
                f"{element.perceived_steps.get(effect, 0.0):.3g}",
                f"{element.margins.gain:.4g}",
                f"{further_delay(element.margins.extra_delay_samples)} T",
                "-" if element.ripple is None else f"{element.ripple:.2g} {units['force']}",
                reason,
            )
    return table


def further_delay(samples: float) -> str:
    """A delay margin in samples, which is not looked for beyond `MOST_EXTRA_DELAY`."""
    from tune.documents.profile import MOST_EXTRA_DELAY

    return f"≥{MOST_EXTRA_DELAY}" if samples >= MOST_EXTRA_DELAY else f"+{samples:g}"


def _uneven(profile: SafeProfile) -> Iterator[str]:
    """How uneven the steps of the loop may be with every element."""
    found = [each.margins.jitter for each in profile.elements.values()]
    if found and None not in found:
        least = min(each or 0.0 for each in found)
        yield f"each step of the loop may vary by {jitter_words(least)} (assessed, not proved)"


def _rendered_lines(profile: SafeProfile) -> tuple[str, ...]:
    """What a hand feels of each element, mean and both ends of the motions people make."""
    units = UNITS[profile.device.motion]
    lines: list[str] = []
    for name, element in profile.elements.items():
        felt = element.rendered
        if felt is None:
            continue
        parts = [
            f"{effect} {mean:+.3g} {units[effect]} ({slow:+.3g} to {fast:+.3g})"
            for effect, mean, (slow, fast) in (
                ("mass", felt.mass, felt.mass_at_ends),
                ("damping", felt.damping, felt.damping_at_ends),
            )
            if slow or fast
        ]
        if parts:
            lines.append(f"{name}: {', '.join(parts)}")
    return (
        ("felt of it in motions of 0.5 to 5 Hz, mean (at 0.5 to at 5 Hz):", *lines) if lines else ()
    )


def _filters(loop: LoopProfile) -> str:
    parts = [
        f"{name} {cutoff:g} Hz"
        for name, cutoff in (
            ("velocity", loop.velocity_filter_hz),
            ("acceleration", loop.acceleration_filter_hz),
        )
        if cutoff is not None
    ]
    if loop.velocity_window_samples is not None:
        parts.insert(0, f"velocity over {loop.velocity_window_samples} samples")
    return ", ".join(parts) or "none"


def candidates_table(
    found: tuple[Candidate, ...], rows: tuple[CandidateEffect, ...], chosen: MarginName
) -> Table:
    """One column a candidate; the recommended one has a star, what does not fit is folded."""
    profiles = [candidate.profile for candidate in found if candidate.profile is not None]
    units = UNITS[profiles[0].device.motion] if profiles else {}
    place = f"{profiles[0].scene} on {profiles[0].device.name}, " if profiles else ""
    table = Table(
        title=f"{place}candidates (* recommended, > chosen)",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    table.add_column("effect", overflow="fold")
    for candidate in found:
        mark = "> " if candidate.name == chosen else ""
        star = " *" if candidate.recommended else ""
        table.add_column(f"{mark}{candidate.name}{star}", justify="right", overflow="fold")
    by_effect: dict[str, dict[str, CandidateEffect]] = {}
    for row in rows:
        by_effect.setdefault(f"{row.element} {row.effect}", {})[row.candidate] = row
    for label, each in by_effect.items():
        cells = [_candidate_cells(each.get(candidate.name), units) for candidate in found]
        labels = (label, "  steps", "  gain", "  delay", "  ripple", "  limited by")
        for first, *others in zip(labels, *cells, strict=True):
            table.add_row(first, *others)
    return table


def _candidate_cells(row: CandidateEffect | None, units: dict[str, str]) -> tuple[str, ...]:
    """Value, steps, gain, delay, ripple and what binds; dashes where the margin has no profile."""
    if row is None:
        return ("-",) * 6
    return (
        f"{row.value:.6g} {units[row.effect]}" if row.value else "-",
        _steps(row.steps),
        f"{row.gain:.4g}",
        f"{further_delay(row.extra_delay_samples)} T",
        "-" if row.ripple is None else f"{row.ripple:.2g} {units['force']}",
        row.limited_by,
    )


def candidates_lines(
    found: tuple[Candidate, ...], rows: tuple[CandidateEffect, ...]
) -> tuple[str, ...]:
    """What each margin demands and which filters it took, or why nothing can be played with it."""
    from tune.documents.scene import MARGINS

    lines: list[str] = []
    for candidate in found:
        margin = MARGINS[candidate.margin]
        demand = (
            f"{candidate.name}: every gain up to {margin.gain:g}, "
            f"{margin.extra_delay_samples} extra sample"
            f"{'' if margin.extra_delay_samples == 1 else 's'} of delay; "
        )
        result = (
            str(candidate.error)
            if candidate.profile is None
            else f"filters: {_filters(candidate.profile.loop)}"
        )
        lines.append(demand + result)
    sizes = [{(r.element, r.effect): r.value for r in rows if r.candidate == c.name} for c in found]
    if rows and all(other == sizes[0] for other in sizes):
        lines.append(
            "the same effects with every candidate: here the conservative one costs nothing"
        )
    return tuple(lines)


def _steps(steps: Estimate) -> str:
    if steps.low is None or steps.high is None or steps.value == 0:
        return f"{steps.value:.3g}"
    return f"{steps.value:.3g} ({steps.low:.2g} to {steps.high:.2g})"


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
        f"{100 * certificate.confidence:g} %), delay {delay} samples and up to "
        f"{certificate.extra_delay_samples:g} more, every gain in (0, {certificate.gain:g}]"
        + "".join(f", {part}" for part in beside),
        f"{certificate.cells} cells excluded, {certificate.points} points judged; slowest of them: "
        f"{' + '.join(worst.elements)}, pole radius 1 - {1 - worst.pole_radius:.2g}",
        "not assessed: " + "; ".join(certificate.not_assessed),
    )
