"""How much of each limit an element uses up, and which of them binds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from tune.documents.perception import perceived_steps
from tune.documents.profile import Design, ElementProfile


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
    return tuple(
        Use(limit=limit, part=part, words=words, binds=bound.get(reason, ()))
        for limit, reason, part, words in (
            *_margins(design, element),
            *_forces(design, element, units["force"]),
            *_felt(design, element),
        )
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
        yield "switched or cut", "saturation", part, words


def _forces(
    design: Design, element: ElementProfile, unit: str
) -> Iterator[tuple[str, str, float, str]]:
    limit, motion = design.device.force_limit, element.motion
    if limit is not None and limit.peak > 0:
        sustained = element.stiffness * (motion.penetration or 0.0)
        if sustained and limit.continuous > 0:
            words = f"{sustained:.3g} of {limit.continuous:g} {unit}"
            yield "sustained force", "force", sustained / limit.continuous, words
        peak = (
            sustained
            + abs(element.damping) * motion.speed
            + abs(element.mass) * motion.acceleration
        )
        words = f"{peak:.3g} of {limit.peak:g} {unit}"
        yield "force in motion", "force", peak / limit.peak, words
    if element.ripple is not None:
        words = f"{element.ripple:.2g} of {design.ripple_limit:g} {unit}"
        yield "encoder ripple", "ripple", element.ripple / design.ripple_limit, words


def _felt(design: Design, element: ElementProfile) -> Iterator[tuple[str, str, float, str]]:
    """Perceived steps from what is asked for to what is felt at 0.5 and 5 Hz; one is allowed."""
    felt, table = element.rendered, design.perception
    if felt is None or table is None:
        return
    for effect, ends, weber in (
        ("mass", felt.mass_at_ends, table.mass),
        ("damping", felt.damping_at_ends, table.damping),
    ):
        own: float = getattr(design.device, effect).value
        asked: float = own + getattr(element, effect)
        if asked <= 0:
            continue
        steps = max(perceived_steps(own + end - asked, asked, weber) for end in ends)
        if math.isfinite(steps):
            yield f"{effect} as felt", "rendering", steps, f"off by {steps:.2g} of 1 step"
