"""How much of each limit an element uses up, and which of them binds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from tune.documents.perception import Scale
from tune.documents.profile import Design, ElementProfile

#: Of several limits of one kind those bind that are used as much as the most used, nearly.
_NEARLY = 0.98


@dataclass(frozen=True, slots=True, kw_only=True)
class Use:
    """One limit and the part of it that is used.

    Attributes:
        limit: in words.
        part: 1 where it is used up.
        words: what is used and what there is.
        binds: names of the effects that the profile says it limits, in words.
    """

    limit: str
    part: float
    words: str
    binds: tuple[str, ...] = ()


def uses_of(design: Design, name: str, units: dict[str, str]) -> tuple[Use, ...]:
    """Every limit of an element that has a number, in the order of the profile's margins.

    Args:
        design: a profile, or what was judged.
        name: of the element.
        units: of its effects and forces.
    """
    element = design.elements[name]
    bound: dict[str, tuple[str, ...]] = {}
    for effect, reason in element.limited_by.items():
        bound[reason] = (*bound.get(reason, ()), effect)
    found = (
        *_margins(design, element),
        *_forces(design, name, units["force"]),
        *_felt(design, element),
    )
    most = {why: max(part for _, other, part, _ in found if other == why) for _, why, _, _ in found}
    return tuple(
        Use(
            limit=limit,
            part=part,
            words=words,
            binds=bound.get(reason, ()) if part >= _NEARLY * most[reason] else (),
        )
        for limit, reason, part, words in found
    )


def _margins(design: Design, element: ElementProfile) -> Iterator[tuple[str, str, float, str]]:
    margin, own = design.margin, element.margins
    if own.gain > 0:
        part = margin.gain / own.gain
        yield "gain margin", "gain-margin", part, f"{margin.gain:g} of {own.gain:.3g}"
    if margin.extra_delay_samples and own.extra_delay_samples > 0:
        wanted, most = margin.extra_delay_samples, own.extra_delay_samples
        yield "extra delay", "delay-margin", wanted / most, f"{wanted:g} of {most:g} T"
    if own.absolute_gain:
        part = margin.gain / own.absolute_gain
        words = f"{margin.gain:g} of {own.absolute_gain:.3g}"
        yield "proof of its clamp", "saturation", part, words
    if element.lead and element.contact and element.contact.lead and element.damping:
        part = element.contact.lead / element.lead
        yield "met before its face", "lead", part, f"{part:.3g} of what it may be"


def _sustained(element: ElementProfile) -> float:
    """Force of the spring at the depth it must last to, N."""
    return element.stiffness * (element.motion.penetration or 0.0)


def _in_motion(element: ElementProfile) -> float:
    """Force of the whole element in its motion, N."""
    motion = element.motion
    damping = 0.0 if element.one_sided and element.cut else abs(element.damping)
    return _sustained(element) + damping * motion.speed + abs(element.mass) * motion.acceleration


def _forces(design: Design, name: str, unit: str) -> Iterator[tuple[str, str, float, str]]:
    """Forces of the element, and of the moment with it whose forces are the largest."""
    limit, element = design.device.force_limit, design.elements[name]
    for what, force_of, most in (
        ("sustained force", _sustained, limit.continuous if limit else 0.0),
        ("force in motion", _in_motion, limit.peak if limit else 0.0),
    ):
        own = force_of(element)
        if most <= 0 or (what == "sustained force" and not own):
            continue
        forces = {
            moment: sum(force_of(design.elements[each]) for each in moment)
            for moment in design.moments()
            if name in moment
        }
        worst, total = max(forces.items(), key=lambda item: (item[1], -len(item[0])))
        beside = [each for each in worst if each != name]
        words = f"{own:.3g} of {most:.4g} {unit}"
        words += f", {total:.3g} with {' and '.join(beside)}" if beside else ""
        yield what, "force", total / most, words
    if element.ripple is not None:
        words = f"{element.ripple:.2g} of {design.ripple_limit:g} {unit}"
        yield "encoder ripple", "ripple", element.ripple / design.ripple_limit, words


def _felt(design: Design, element: ElementProfile) -> Iterator[tuple[str, str, float, str]]:
    """Perceived steps from what is asked for to what is felt at 0.5 and 5 Hz; one is allowed."""
    felt, table, motion = element.rendered, design.perception, element.motion
    if felt is None or table is None or element.one_sided:
        return
    for effect, ends, weber, reach in (
        ("mass", felt.mass_at_ends, table.mass, motion.acceleration),
        ("damping", felt.damping_at_ends, table.damping, motion.speed),
    ):
        asked: float = getattr(element, effect)
        total: float = getattr(design.device, effect).value + asked
        scale = Scale(reference=total, weber=weber, floor=table.threshold / reach)
        steps = max(scale.steps(end - asked) for end in ends)
        yield f"{effect} as felt", "rendering", steps, f"off by {steps:.2g} of 1 step"
