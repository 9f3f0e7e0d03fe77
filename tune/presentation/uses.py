"""The part of each limit that an element uses, in numbers, words and bars."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tune.documents.perception import Scale
from tune.documents.profile import Design, ElementProfile, LimitedBy
from tune.documents.scene import UNITS
from tune.presentation.tables import four_digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Of several limits of one kind those bind that are used as much as the most used, nearly.
_NEARLY = 0.98
#: A part of a limit beyond which more than rounding is used.
_BEYOND = 1.001
#: Mass is felt within this factor of what is asked for.
_ALIKE = 1.2
#: Bars are drawn up to this many times a limit.
_LONGEST = 1.25
#: Letters of a name.
_SHORT = 28
#: Reasons that have no bar, and those that are no limit, in words.
_NO_BAR = {"wanted", "range", "stability", "not-perceptible"}
_WHY = {"wanted": "as wanted", "range": "end of its range", "not-perceptible": "not perceptible"}
_TITLE: dict[str, Any] = {"fontsize": 8, "loc": "left"}


@dataclass(frozen=True, slots=True)
class Use:
    """A limit, the part of it that is used (1: used up), words for it, effects that it binds."""

    limit: str
    part: float
    words: str
    binds: tuple[str, ...]


#: (limit, reason as profiles name it, part, words) of a limit.
_Found = Iterator[tuple[str, str, float, str]]


def uses_of(design: Design, name: str, units: dict[str, str]) -> tuple[Use, ...]:
    """Every limit of an element that has a number, in the order of the profile's margins."""
    element = design.elements[name]
    bound: dict[str, tuple[str, ...]] = {}
    for effect, reason in element.limited_by.items():
        bound[reason] = (*bound.get(reason, ()), effect)
    found = (
        *_margins(design, element),
        *_forces(design, name, units["force"]),
        *_rendered(design, element),
    )
    most = {why: max(part for _, other, part, _ in found if other == why) for _, why, _, _ in found}
    return tuple(
        Use(limit, part, words, bound.get(why, ()) if part >= _NEARLY * most[why] else ())
        for limit, why, part, words in found
    )


def _margins(design: Design, element: ElementProfile) -> _Found:
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


def _forces(design: Design, name: str, unit: str) -> _Found:
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
            combination: sum(force_of(design.elements[each]) for each in combination)
            for combination in design.moments()
            if name in combination
        }
        worst, total = max(forces.items(), key=lambda item: (item[1], -len(item[0])))
        beside = [each for each in worst if each != name]
        words = f"{own:.3g} of {most:.4g} {unit}"
        words += f", {total:.3g} with {' and '.join(beside)}" if beside else ""
        yield what, "force", total / most, words
    if element.ripple is not None:
        words = f"{element.ripple:.2g} of {design.ripple_limit:g} {unit}"
        yield "encoder ripple", "ripple", element.ripple / design.ripple_limit, words


def _rendered(design: Design, element: ElementProfile) -> _Found:
    """What is felt in motion against what is asked for: damping in steps, mass by its factor."""
    rendered, table, motion = element.rendered, design.perception, element.motion
    if rendered is None or table is None or element.one_sided:
        return
    for effect, ends, weber, reach in (
        ("mass", rendered.mass_in_motion or rendered.mass_at_ends, table.mass, motion.acceleration),
        (
            "damping",
            rendered.damping_in_motion or rendered.damping_at_ends,
            table.damping,
            motion.speed,
        ),
    ):
        asked: float = getattr(element, effect)
        total: float = getattr(design.device, effect).value + asked
        scale = Scale(reference=total, weber=weber, floor=table.threshold / reach)
        steps = max(scale.steps(end - asked) for end in ends)
        if effect == "damping" or not asked:
            yield f"{effect} as felt", "rendering", steps, f"off by {steps:.2g} of 1 step"
            continue
        part = max(max(end / asked, asked / end if end / asked > 0 else np.inf) for end in ends)
        words = f"off by a factor of {part:.3g} of {_ALIKE:g}"
        yield "mass as felt", "rendering", float(np.log(part) / np.log(_ALIKE)), words


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectUse:
    """One effect of a design beside the limit that binds it, or else the one it uses most.

    ``limit`` is None where no limit has a number; ``binds`` tells whether it is the one that binds.
    """

    name: str
    value: str
    steps: float
    reason: LimitedBy
    limit: Use | None
    binds: bool

    @property
    def words(self) -> str:
        """Why it is no larger, and how much of the limit it uses."""
        nearest = "" if self.limit is None else f"{self.limit.limit} {self.limit.words}"
        why = _WHY.get(self.reason, self.reason.replace("-", " "))
        return nearest if self.binds else f"{why}; {nearest}" if nearest else why


def effect_uses(design: Design) -> list[EffectUse]:
    """Every effect that the scene asked for, in the order of the profile."""
    units = UNITS[design.device.motion]
    found: list[EffectUse] = []
    for name, element in design.elements.items():
        uses = uses_of(design, name, units)
        for effect, reason in element.limited_by.items():
            value: float = getattr(element, effect)
            binding = [use for use in uses if effect in use.binds]
            limit = max(binding or uses, key=lambda use: use.part, default=None)
            found.append(
                EffectUse(
                    name=f"{name} {effect}",
                    value=f"{four_digits(value)} {units[effect]}" if value else "not played",
                    steps=element.perceived_steps.get(effect, 0.0),
                    reason=reason,
                    limit=limit if value else None,
                    binds=bool(binding and value),
                )
            )
    return found


def draw_effect_uses(axes: Axes, design: Design) -> None:
    """One bar an effect: the part of the limit that binds it, with its value and steps."""
    found = effect_uses(design)
    bars = [(each.limit.part if each.limit else 0.0, each.words, each.binds) for each in found]
    labels = [f"{short_name(e.name)}\n{e.value}, {e.steps:.3g} steps" for e in found]
    _draw_bars(axes, labels, bars)
    axes.set_title("limit that binds each effect (dark), or else the one most used", **_TITLE)


def draw_limits(axes: Axes, design: Design, name: str, units: dict[str, str]) -> None:
    """A bar a limit of one element; those that bind are dark."""
    uses = uses_of(design, name, units)
    bars = [
        (u.part, u.words + (f": limits {' and '.join(u.binds)}" if u.binds else ""), bool(u.binds))
        for u in uses
    ]
    _draw_bars(axes, [use.limit for use in uses], bars)
    reasons = design.elements[name].limited_by.items()
    others = ", ".join(f"{effect} {why}" for effect, why in reasons if why in _NO_BAR)
    title = "part of each limit that is used" + (f"\nbesides: {others}" if others else "")
    axes.set_title(title, **_TITLE)


def _draw_bars(axes: Axes, labels: list[str], bars: list[tuple[float, str, bool]]) -> None:
    """(part, words, whether it binds) from top to bottom; told apart without colour too."""
    places = -np.arange(len(bars))
    for place, (part, words, binds) in zip(places, bars, strict=True):
        beyond = part > _BEYOND
        axes.barh(
            float(place),
            min(part, _LONGEST),
            height=0.62,
            color="#E69F00" if beyond else "#56B4E9" if binds else "#DCEBF5",
            hatch="///" if beyond else None,
            edgecolor="k" if binds or beyond else "0.6",
            lw=1.0 if binds else 0.4,
        )
        axes.text(0.012, float(place), words, va="center", fontsize=7)
    axes.axvline(1, color="k", lw=1)
    axes.set_yticks(places, labels, fontsize=8)
    axes.set_xlim(0, _LONGEST)
    axes.set_xticks([0, 0.5, 1], ["0", "half", "used up"], fontsize=7)


def short_name(name: str) -> str:
    """A name as a picture has room for it, without what matplotlib would take for a formula."""
    plain = name.replace("$", r"\$")
    return plain if len(plain) <= _SHORT else f"{plain[: _SHORT - 1]}…"
