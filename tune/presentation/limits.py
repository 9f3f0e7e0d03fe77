"""What limits a design: the boundaries of its stable region, the part of each limit it uses.

Both in numbers and as pictures: the region in damping and stiffness, limits in words and bars.
"""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification import Device
from tune.documents.perception import Scale
from tune.documents.profile import Design, ElementProfile, LimitedBy
from tune.documents.scene import UNITS, Effects, Hand, Margin
from tune.loop.loop import Filters, Loop, filters_of
from tune.optimisation.region import DelayedLoops, Region, remembered
from tune.presentation.tables import plain_number
from tune.stability.verdict import largest, safe_gain, stable_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

#: Colours that colour-blind readers tell apart.
BLUE, VERMILION = "#0072B2", "#D55E00"

#: Parts of the margin's gain at which a point is judged: every gain below is to be stable too.
_PARTS = (0.25, 0.5, 0.75, 1.0)
#: Damping of a device that has as good as none, as a scale.
_LEAST_SCALE = 1e-9
#: Dampings at which the boundaries of a slice are computed.
_PLACES = 160
#: What is drawn of a slice goes this much beyond what is played or may be.
_BEYOND = 1.15
#: What is left of a picture's height or width that nobody would see.
_HARDLY = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boundaries:
    """The largest stiffness for given damping and mass, on the device of a design."""

    nominal: Loop  # at the best estimate
    corners: tuple[DelayedLoops, ...]  # of the box, at every delay up to the margin's
    gains: tuple[float, ...]  # up to that of the margin, at which a point is judged
    damping: float  # of the device itself at its best estimate, N·s/m: a scale

    @classmethod
    def of(cls, design: Design) -> Boundaries:
        """On the device, hand and filters of a design."""
        return cls.on(design.device, filters_of(design.loop), design.margin, design.hand)

    @staticmethod
    @remembered
    def on(
        device: Device, filters: Filters, margin: Margin, hand: Hand | None = None
    ) -> Boundaries:
        """On a device, alone or in a hand."""
        extra = margin.extra_delay_samples
        return Boundaries(
            nominal=Loop.from_parts(device, filters),
            corners=Region.of(device, hand, extra=extra).loops(filters, extra),
            gains=tuple(part * margin.gain for part in _PARTS),
            damping=max(abs(device.damping.value), _LEAST_SCALE),
        )

    def at_best(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """Largest stable stiffness on the best estimate, of the broadcast shape, N/m."""
        B, M = np.broadcast_arrays(damping, mass)
        return largest(self.nominal, "stiffness", Effects(damping=B, mass=_present(M)))

    def at_worst(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """That at every corner of the box and delay of the device."""
        return self._least(damping, mass, (1.0,), late=False)

    def with_margin(self, damping: FloatArray, mass: FloatArray | float) -> FloatArray:
        """That at every corner with the extra delay, at a few gains up to the margin."""
        return self._least(damping, mass, self.gains, late=True)

    def damping_with_margin(self, stiffness: float, damping: float, mass: float) -> float:
        """Damping, at least the given, up to which a stiffness and a mass keep the margin."""
        found: list[float] = []
        for gain in self.gains:
            K, M = np.array([gain * stiffness]), np.array([gain * mass])
            others = Effects(stiffness=_present(K), mass=_present(M))
            for each in self.corners:
                low, high = stable_values(each.loop, "damping", others)
                start = gain * max(damping, 0.0)
                inside = (low <= start) & (high > start)
                found.append(float(np.min(np.max(np.where(inside, high, 0.0), axis=0))) / gain)
        return max(min(found), damping)

    def ends(self, damping: tuple[float, float], mass: float) -> tuple[float, float]:
        """Dampings, N·s/m, between which a slice shows its region and both of these."""
        # From the least that is stable, or zero, to the largest with the whole margin.
        most = self.damping_with_margin(0.0, damping[1], mass)
        return _BEYOND * damping[0], _BEYOND * max(most, damping[1], 0.1 * self.damping)

    @remembered
    def plane(
        self, ends: tuple[float, float], mass: float, places: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Dampings between two ends, even on axes of square roots, and the three stiffnesses there.

        On the best estimate, at the worst corner and with the margin; shape (places,) each.
        """
        low, high = _root(np.array(ends))
        damping = _square(np.linspace(float(low), float(high), places))
        best, worst = self.at_best(damping, mass), self.at_worst(damping, mass)
        return damping, best, worst, self.with_margin(damping, mass)

    def _least(
        self, damping: FloatArray, mass: FloatArray | float, gains: tuple[float, ...], *, late: bool
    ) -> FloatArray:
        """Least over corners and gains, of the broadcast shape."""
        B, M = np.broadcast_arrays(damping, mass)
        gain = np.reshape(gains, (-1, *(1,) * (B.ndim + 1)))
        effects = Effects(damping=gain * B[..., None], mass=_present(gain * M[..., None]))
        found = [
            np.min(largest(each.loop, "stiffness", effects) / gain, axis=(0, -1))
            for each in self.corners
            if late or each.beyond == 0
        ]
        return np.min(found, axis=0)


def _present(values: FloatArray) -> FloatArray | None:
    """An effect that is nowhere is not there at all."""
    return values if np.any(values) else None


def draw_region(
    axes: Axes, design: Design, mass: float, damping: tuple[float, float], stiffness: float
) -> None:
    """Three boundaries at one mass, kg, on axes that grow as the square root.

    Damping from the least to the largest, N·s/m, and stiffness, N/m, have to be seen.
    """
    boundaries, units = Boundaries.of(design), UNITS[design.device.motion]
    least, most = boundaries.ends(damping, mass)
    grid, best, worst, safe = boundaries.plane((least, most), mass, _PLACES)
    axes.set_xscale("function", functions=(_root, _square))
    axes.set_yscale("function", functions=(_root, _square))
    axes.fill_between(grid, best, color="0.9", lw=0, label="stable, best estimate")
    axes.plot(grid, worst, color=VERMILION, lw=1.3, ls="--", label="worst corner of the box")
    axes.fill_between(grid, safe, color=BLUE, alpha=0.35, lw=0, label="with the whole margin")
    top = _BEYOND * max(float(np.max(safe)), stiffness) or float(np.max(best))
    axes.set_xlim(least, most)
    axes.set_ylim(0, top if top > 0 else 1.0)
    axes.set_xlabel(f"damping B, {units['damping']} (square-root scale)", fontsize=8)
    axes.set_ylabel(f"stiffness K, {units['stiffness']} (square-root scale)", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.locator_params(nbins=6)
    axes.ticklabel_format(style="plain", useOffset=False)


def draw_slice(axes: Axes, design: Design, name: str) -> None:
    """The plane of one element, its place, and how far from it the boundary of the margin is."""
    element, units = design.elements[name], UNITS[design.device.motion]
    K, B, M = element.stiffness, element.damping, element.mass
    draw_region(axes, design, M, (min(B, 0.0), max(B, 0.0)), K)
    boundaries = Boundaries.of(design)
    words: list[str] = []
    (_, right), (_, top) = axes.get_xlim(), axes.get_ylim()
    to_stiffness = float(boundaries.with_margin(np.array(B), M))
    to_damping = boundaries.damping_with_margin(K, B, M)
    for symbol, effect, most, seen, end in (
        ("K", "stiffness", to_stiffness, K, ([B, B], [K, min(to_stiffness, top)])),
        ("B", "damping", to_damping, B, ([B, min(to_damping, right)], [K, K])),
    ):
        if most - seen > _HARDLY * {"K": top, "B": right}[symbol]:
            axes.plot(*end, color="k", lw=0.9, ls=":", clip_on=False)
            words.append(f"{symbol} up to {plain_number(most)} {units[effect]}")
    axes.plot([B], [K], "ko", ms=6, clip_on=False, zorder=5)
    alone = f"alone, plane M = {M:.3g} {units['mass']}; dotted, to the whole margin:"
    set_small_title(axes, f"{alone}\n{' or '.join(words) or 'nothing is left'}")


def set_small_title(axes: Axes, words: str, pad: float = 4) -> None:
    """A title in small letters."""
    axes.set_title(words, fontsize=8, loc="left", pad=pad)


def _root(values: FloatArray) -> FloatArray:
    return np.sign(values) * np.sqrt(np.abs(values))


def _square(values: FloatArray) -> FloatArray:
    return np.sign(values) * np.square(values)


#: Of several limits of one kind those bind that are used as much as the most used, nearly.
_NEARLY = 0.98
#: A part of a limit beyond which more than rounding is used.
_EXCEEDED = 1.001
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


def uses_of(design: Design, name: str) -> tuple[Use, ...]:
    """Every limit of an element that has a number, in the order of the profile's margins."""
    element, units = design.elements[name], UNITS[design.device.motion]
    bound: dict[str, tuple[str, ...]] = {}
    for effect, reason in element.limited_by.items():
        bound[reason] = (*bound.get(reason, ()), effect)
    found = (
        *_margin_uses(design, name, units["length"]),
        *_force_uses(design, name, units["force"]),
        *_felt_uses(design, element),
    )
    most = {why: max(part for _, other, part, _ in found if other == why) for _, why, _, _ in found}
    return tuple(
        Use(limit, part, words, bound.get(why, ()) if part >= _NEARLY * most[why] else ())
        for limit, why, part, words in found
    )


def _late_gain(design: Design, name: str) -> float:
    """Gain to which every combination with an element is stable with the margin's extra delay."""
    from tune.verification.law import effects_of

    corners = Boundaries.of(design).corners
    combinations = [effects_of(design, each) for each in design.combinations() if name in each]
    return float(min(np.min(safe_gain(each.loop, m)) for each in corners for m in combinations))


def _margin_uses(design: Design, name: str, unit: str) -> _Found:
    """Margins, and how far before its face a wall may be met, in a unit of length."""
    element = design.elements[name]
    margin, own = design.margin, element.margins
    if own.gain > 0:
        part = margin.gain / own.gain
        yield "gain margin", "gain-margin", part, f"{margin.gain:g} of {own.gain:.3g}"
    wanted, most = margin.extra_delay_samples, own.extra_delay_samples
    if "delay-margin" in element.limited_by.values():
        late = _late_gain(design, name)
        words = f"{margin.gain:g} of {late:.3g} with {wanted:g} T more"
        yield "gain and delay", "delay-margin", margin.gain / late, words
    elif wanted and most > 0:
        yield "extra delay", "delay-margin", wanted / most, f"{wanted:g} of {most:g} T"
    if own.absolute_gain:
        part = margin.gain / own.absolute_gain
        words = f"{margin.gain:g} of {own.absolute_gain:.3g}"
        yield "proof of its clamp", "saturation", part, words
    if element.lead and element.contact and element.contact.lead and element.damping:
        part = element.contact.lead / element.lead
        words = f"{element.contact.lead:.3g} of {element.lead:.3g} {unit}"
        yield "met before its face", "lead", part, words


def _sustained(element: ElementProfile) -> float:
    """Force of the spring at the depth it must last to, N."""
    return element.stiffness * (element.motion.penetration or 0.0)


def _in_motion(element: ElementProfile) -> float:
    """Force of the whole element in its motion, N."""
    motion = element.motion
    damping = 0.0 if element.one_sided and element.cut else abs(element.damping)
    return _sustained(element) + damping * motion.speed + abs(element.mass) * motion.acceleration


def _force_uses(design: Design, name: str, unit: str) -> _Found:
    """Forces of the element, and of the combination with it whose forces are the largest."""
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
            for combination in design.combinations()
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


def _felt_uses(design: Design, element: ElementProfile) -> _Found:
    """What is felt in motion against what is asked for: damping in steps, mass by its factor."""
    rendered, table, motion = element.rendered, design.perception, element.motion
    if rendered is None or table is None or element.one_sided:
        return
    for effect, ends, weber, reach in (
        ("mass", rendered.mass_in_motion, table.mass, motion.acceleration),
        ("damping", rendered.damping_in_motion, table.damping, motion.speed),
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
    """One effect of a design beside the limit that binds it, or else the one it uses most."""

    name: str
    value: str
    steps: float
    reason: LimitedBy
    limit: Use | None  # None where no limit has a number
    binds: bool  # whether it is the one that binds

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
        uses = uses_of(design, name)
        for effect, reason in element.limited_by.items():
            value: float = getattr(element, effect)
            binding = [use for use in uses if effect in use.binds]
            limit = max(binding or uses, key=lambda use: use.part, default=None)
            found.append(
                EffectUse(
                    name=f"{name} {effect}",
                    value=f"{plain_number(value)} {units[effect]}" if value else "not played",
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


def draw_limits(axes: Axes, design: Design, name: str) -> None:
    """A bar a limit of one element; those that bind are dark."""
    uses = uses_of(design, name)
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
        beyond = part > _EXCEEDED
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


def short_name(name: str, room: int = _SHORT) -> str:
    """A name as a picture has room for it, without what matplotlib would take for a formula."""
    plain = name.replace("$", r"\$")
    return plain if len(plain) <= room else f"{plain[: room - 1]}…"
