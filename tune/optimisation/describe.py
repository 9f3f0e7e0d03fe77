"""Description of a chosen setting: which limit binds, margins, steps, what was not needed.

One file: all that is said of one chosen setting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device, round_to_digits
from tune.documents.effects import EFFECT_NAMES, SHORTEST_FADE, EffectName, Effects
from tune.documents.profile import MOST_EXTRA_DELAY, Design, ElementProfile, LimitedBy, Margins
from tune.documents.scene import MARGINS, Margin, Scene
from tune.loop.filters import Filters, used_filters
from tune.loop.plant import WHOLE
from tune.loop.state_space import corners_of
from tune.margins.margins import damping_needed
from tune.margins.time_varying import MOST_JITTER, jitter_margin
from tune.optimisation.bounds import ripple_bound, stable_bounds
from tune.optimisation.delays import SizedMoment
from tune.optimisation.limits import ripple, worst_gain
from tune.optimisation.problem import Problem
from tune.rendering.elements import contact, rendered_mass_and_damping

if TYPE_CHECKING:
    from tune.optimisation.nash import Solution
    from tune.optimisation.saturation import AllFound

FloatArray = NDArray[np.float64]

#: A limit binds where it leaves less than this, relative; written values are rounded by 1e-5.
_BINDS = 1e-4
#: Claimed margins are cut to this many digits, downwards, and capped: more says nothing.
_MARGIN_CAP = 1000.0


#: Limits are looked for up to so many times the size at hand, where one is as a rule, then beyond.
_NEAR = 1.01
#: Which limit is named where several bind.
_ORDER: tuple[LimitedBy, ...] = (
    "wanted",
    "range",
    "force",
    "lead",
    "rendering",
    "ripple",
    "stability",
    "gain-margin",
    "delay-margin",
)


def bindings(problem: Problem, sizes: FloatArray, indices: Sequence[int]) -> list[LimitedBy]:
    """The constraint that keeps each of some effects from being larger, the others as they are.

    Sizes have shape (unknowns,), SI units.
    """
    near = {index: float(sizes[index]) * _NEAR for index in indices}
    bounds = _bounds(problem, sizes, near)
    free = {index: np.inf for index, found in bounds.items() if not found}
    bounds |= _bounds(problem, sizes, free)

    return [_first(bounds[index]) for index in indices]


def _first(found: dict[LimitedBy, float]) -> LimitedBy:
    words: list[LimitedBy] = sorted(found, key=_ORDER.index)
    return words[0] if words else "force"


def _bounds(
    problem: Problem, sizes: FloatArray, tops: dict[int, float]
) -> dict[int, dict[LimitedBy, float]]:
    """The tightest limits of each unknown, by its index, as far as they lie below the given tops.

    Returns:
        Sizes by word for each index; empty where nothing limits it up to the top.
    """
    gain = problem.margin.gain
    linear = {index: problem.linear.bounds(sizes, index) for index in tops}
    most = {i: min(top, problem.unknowns[i].high, *linear[i].values()) for i, top in tops.items()}
    late = stable_bounds(problem, sizes, [*most], [*most.values()], gain)
    bounds: dict[int, dict[LimitedBy, float]] = {}
    for (index, top), stable in zip(most.items(), late, strict=True):
        unknown = problem.unknowns[index]
        least = min(top, stable)
        noisy = ripple_bound(problem, sizes, index, least)
        found: dict[LimitedBy, float] = {
            **linear[index],
            "delay-margin": stable,
            "ripple": noisy,
        }
        if unknown.wish.kind == "value":
            found["wanted"] = unknown.high
        elif unknown.wish.kind == "range":
            found["range"] = unknown.high
        elif unknown.sign < 0:
            found["gain-margin"] = unknown.high
        bounds[index] = _close({w: bound for w, bound in found.items() if bound <= tops[index]})
    # Without the extra delay, or without the gain margin too, more is stable: asked for only where
    # what is asked for less binds.
    relaxed: tuple[tuple[LimitedBy, LimitedBy, float], ...] = (
        ("gain-margin", "delay-margin", gain),
        ("stability", "gain-margin", 1.0),
    )
    for word, before, full in relaxed:
        asked = [i for i, found in bounds.items() if before in found]
        ends = [bounds[i][before] * (1 + 2 * _BINDS) for i in asked]
        present = stable_bounds(problem, sizes, asked, ends, full, late=False)
        for index, stable in zip(asked, present, strict=True):
            found = bounds[index]
            found[word] = min(stable, found.get(word, np.inf))
            bounds[index] = _close(found)
    return bounds


def _close(bounds: dict[LimitedBy, float]) -> dict[LimitedBy, float]:
    """The limits that are as tight as the tightest."""
    least = min(bounds.values(), default=0.0)
    return {word: bound for word, bound in bounds.items() if bound <= least * (1 + _BINDS)}


@dataclass(frozen=True, slots=True, kw_only=True)
class MomentMargins:
    """Margins of one moment at the sizes written.

    Attributes:
        elements: felt at the same time.
        gain: stable for every gain below it, at the device's own delay.
        late: extra samples of delay that it bears, 10 at most.
        jitter: how uneven the steps may be, in parts of the sample time.
    """

    elements: tuple[str, ...]
    gain: float
    late: float
    jitter: float


def moment_margins(
    device: Device, one: SizedMoment, late: float, kept: Margin, slack: float
) -> MomentMargins:
    """Margins of one moment.

    Args:
        device: as it is stored.
        one: moment and sizes.
        late: extra samples of delay that it bears.
        kept: the margin of the scene.
        slack: part of its margins that is not claimed, where a proof came too close to the edge.
    """
    gain = min(worst_gain(one.problem, one.moment, one.sizes, late=False), _MARGIN_CAP)
    late = min(float(MOST_EXTRA_DELAY), late)
    if slack:
        gain = max(gain * (1 - slack), min(gain, kept.gain))
        late = max(
            float(np.floor(late * (1 - slack) * 10) / 10), min(late, kept.extra_delay_samples)
        )
    felt = one.problem.effects(one.moment, one.sizes)
    K, B, M = (0.0 if value is None else float(value) for value in felt.arrays())
    places = corners_of(device, one.problem.region.box)
    return MomentMargins(
        elements=one.moment.elements,
        gain=gain,
        late=late,
        jitter=min(MOST_JITTER, jitter_margin(places, one.problem.filters, (K, B, M))),
    )


def element_profile(
    device: Device,
    scene: Scene,
    solved: Solution,
    name: str,
    margins: Sequence[MomentMargins],
    absolute: AllFound,
    slack: float,
) -> ElementProfile:
    """The profile entry of one element, every number computed from the written sizes.

    Args:
        device: as it is stored.
        scene: what was wanted.
        solved: the group of the element.
        name: of the element.
        margins: of all moments of the scene.
        absolute: gains of the moments that are proved absolutely stable.
        slack: part of their margins that is not claimed, where a proof came too close to the edge.
    """
    problem, sizes = solved.problem, solved.sizes
    values = dict.fromkeys(EFFECT_NAMES, 0.0)
    steps: dict[EffectName, float] = {}
    limited: dict[EffectName, LimitedBy] = {
        effect: "not-perceptible" for effect in EFFECT_NAMES if f"{name}.{effect}" in solved.dropped
    }
    own = [index for index, unknown in enumerate(problem.unknowns) if unknown.element == name]
    for index, word in zip(own, bindings(problem, sizes, own), strict=True):
        unknown = problem.unknowns[index]
        values[unknown.effect] = unknown.sign * float(sizes[index])
        counted = unknown.steps(float(sizes[index]))
        if np.isfinite(counted):
            steps[unknown.effect] = round_to_digits(counted, 4)
        limited[unknown.effect] = "saturation" if index in solved.stepped_back else word
    alone = [m for m in problem.moments if m.elements == (name,) and any(m.members)]
    mine = [each for each in margins if name in each.elements]
    gains = [each.gain for each in mine]
    # What an unstable loop makes of the encoder's noise has no number.
    noise = ripple(problem, alone[0], sizes) if alone and min(gains) > 1 else None
    absolute_gain = _absolute_gain(absolute, scene, name, slack)
    if absolute_gain is not None:
        gains.append(absolute_gain)
    wanted, motion = (
        scene.elements[name],
        scene.motion(name, device.motion, cut=name in problem.cut),
    )
    pumps = bool(values["mass"]) or min(values.values()) < 0
    return ElementProfile(
        stiffness=values["stiffness"],
        damping=values["damping"],
        mass=values["mass"],
        perceived_steps=steps,
        margins=Margins(
            gain=float(np.floor(min([*gains, _MARGIN_CAP]) * 1000 * (1 + 1e-12)) / 1000),
            extra_delay_samples=min([float(MOST_EXTRA_DELAY), *(each.late for each in mine)]),
            passive=_passive(problem, values),
            jitter=round_to_digits(min([MOST_JITTER, *(each.jitter for each in mine)]), 4),
            absolute_gain=absolute_gain,
        ),
        ripple=None if noise is None else round_to_digits(noise, 4),
        limited_by=limited,
        motion=motion,
        rendered=rendered_mass_and_damping(device, problem.filters, **values),
        one_sided=wanted.one_sided,
        lead=scene.lead(name, device.motion),
        fade_time=SHORTEST_FADE if pumps else 0.0,
        as_commanded=bool(own) and all(problem.unknowns[i].wish.kind == "value" for i in own),
    )


def _floored(force: float) -> float:
    """Six digits of a force, rounded towards nothing."""
    unit = 10.0 ** (np.floor(np.log10(force)) - 5)
    return round_to_digits(float(np.floor(force / unit * (1 + 1e-12)) * unit), 6)


def _absolute_gain(absolute: AllFound, scene: Scene, name: str, slack: float) -> float | None:
    """What is claimed of all clamped moments with an element; None where there are none."""
    if not absolute:
        return None
    from tune.optimisation.saturation import witness_of

    margin = MARGINS[scene.margin]
    return min(
        (witness_of(one, margin, slack).gain for names, one in absolute.items() if name in names),
        default=None,
    )


def with_levels_and_contacts(design: Design, device: Device, box: Box) -> Design:
    """The design with the force at which each spring is cut, and what entering each amounts to.

    A cut round a sum of springs is not a clamp of one signal: each has a level of its own. Those
    that may push at once share alike what the depths that are stated leave of the peak force.

    Args:
        design: with the sizes that are played.
        device: as it is stored.
        box: of it.
    """
    deep = {
        name: element.stiffness * (element.motion.penetration or 0.0)
        for name, element in design.elements.items()
        if element.stiffness
    }
    at_once = [deep.keys() & {*moment} for moment in design.moments()]
    peak = np.inf if device.force_limit is None else device.force_limit.peak
    filters = Filters(**design.loop.filter_settings())
    elements: dict[str, ElementProfile] = {}
    for name, element in design.elements.items():
        left = min(
            ((peak - sum(deep[each] for each in m)) / len(m) for m in at_once if name in m),
            default=0.0,
        )
        level = _floored(deep[name] + left) if name in deep else 0.0
        felt = element.model_copy(update={"force_level": level})
        told = contact(device, box, filters, felt, design.margin.extra_delay_samples)
        elements[name] = felt.model_copy(update={"contact": told})
    return design.model_copy(update={"elements": elements})


def _passive(problem: Problem, values: dict[EffectName, float]) -> bool | Literal["not-applicable"]:
    """Whether the device is passive with the least damping and every sample time of its box."""
    region = problem.region
    delays = [delay / step for delay in region.box.delay for step in region.box.sample_time]
    whole = round(delays[0])
    if region.modes or region.current_lag or any(abs(d - whole) > WHOLE for d in delays):
        return "not-applicable"
    felt = Effects(damping=values["damping"] or None, mass=values["mass"] or None)
    filters = used_filters(problem.filters, felt)
    needed = max(
        damping_needed(
            values["stiffness"],
            values["damping"],
            values["mass"],
            step,
            filters,
            delay_samples=whole,
        )
        for step in dict.fromkeys(region.box.sample_time)
    )
    return bool(region.box.damping[0] > needed)
