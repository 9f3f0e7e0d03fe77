"""Description of a chosen setting: which limit binds, margins, steps, what was not needed.

One file: all that is said of one chosen setting.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from identification import Device, round_to_digits
from tune.documents.effects import EFFECT_NAMES, SHORTEST_FADE, EffectName, Effects
from tune.documents.profile import MOST_EXTRA_DELAY, ElementProfile, LimitedBy, Margins
from tune.documents.scene import MARGINS, Scene
from tune.loop.filters import used_filters
from tune.loop.sampled_plant import WHOLE
from tune.loop.state_space import corners_of
from tune.margins.jitter import MOST as MOST_JITTER
from tune.margins.jitter import jitter_margin
from tune.margins.passivity import damping_needed
from tune.optimisation.bounds import largest_allowed, ripple_bound, stable_bounds
from tune.optimisation.limits import ripple, worst_gain
from tune.optimisation.problem import Moment, Problem
from tune.rendering.contact import contact
from tune.rendering.rendered import rendered_mass_and_damping

if TYPE_CHECKING:
    from tune.optimisation.one_sided import AllFound

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


def _spared(problem: Problem, sizes: FloatArray, index: int) -> bool:
    """Whether a size stays below every limit but that of absolute stability."""
    asked = any(m.absolute and any(index in part for part in m.members) for m in problem.moments)
    return asked and largest_allowed(problem, sizes, index) > float(sizes[index]) * _NEAR


def element_profile(
    device: Device,
    scene: Scene,
    problem: Problem,
    sizes: FloatArray,
    name: str,
    dropped: dict[str, str],
    delays: Mapping[tuple[str, ...], float],
    slack: float,
    absolute: AllFound,
) -> ElementProfile:
    """The profile entry of one element, every number computed from the written sizes.

    Sizes have shape (unknowns,), SI units.

    Args:
        device: as it is stored.
        scene: what was wanted.
        problem: of the group of the element.
        sizes: of its unknowns.
        name: of the element.
        dropped: reasons by label.
        delays: extra samples each moment bears, by its elements.
        slack: part of its margins that is not claimed, where a proof came too close to the edge.
        absolute: gains of the moments that are one-sided.
    """
    values = dict.fromkeys(EFFECT_NAMES, 0.0)
    steps: dict[EffectName, float] = {}
    limited: dict[EffectName, LimitedBy] = {
        effect: "not-perceptible" for effect in EFFECT_NAMES if f"{name}.{effect}" in dropped
    }
    own = [index for index, unknown in enumerate(problem.unknowns) if unknown.element == name]
    absolute_gain, bound = _absolute(problem, absolute, scene, name, slack)
    for index, word in zip(own, bindings(problem, sizes, own), strict=True):
        unknown = problem.unknowns[index]
        values[unknown.effect] = unknown.sign * float(sizes[index])
        counted = unknown.steps(float(sizes[index]))
        if np.isfinite(counted):
            steps[unknown.effect] = round_to_digits(counted, 4)
        open_ = float(sizes[index]) < unknown.high * (1 - _BINDS)
        saturates = index in bound or _spared(problem, sizes, index)
        limited[unknown.effect] = "saturation" if saturates and open_ else word
    moments = [m for m in problem.moments if name in m.elements and any(m.members)]
    gains = [worst_gain(problem, m, sizes, late=False) for m in moments]
    alone = [m for m in problem.moments if m.elements == (name,)]
    # What an unstable loop makes of the encoder's noise has no number.
    noise = ripple(problem, alone[0], sizes) if alone and min(gains) > 1 else None
    gain = min([*gains, _MARGIN_CAP])
    late = min([float(MOST_EXTRA_DELAY), *(delays[moment.elements] for moment in moments)])
    if slack:
        kept = MARGINS[scene.margin]
        gain = max(gain * (1 - slack), min(gain, kept.gain))
        late = max(
            float(np.floor(late * (1 - slack) * 10) / 10), min(late, kept.extra_delay_samples)
        )
    pumps = bool(values["mass"]) or min(values.values()) < 0
    wanted, motion = (
        scene.elements[name],
        scene.motion(name, device.motion, cut=name in problem.cut),
    )
    return ElementProfile(
        stiffness=values["stiffness"],
        damping=values["damping"],
        mass=values["mass"],
        perceived_steps=steps,
        margins=Margins(
            gain=float(np.floor(gain * 1000 * (1 - 1e-9)) / 1000),
            extra_delay_samples=late,
            passive=_passive(problem, values),
            jitter=_jitter(device, problem, moments, sizes),
            absolute_gain=absolute_gain,
        ),
        ripple=None if noise is None else round_to_digits(noise, 4),
        limited_by=limited,
        motion=motion,
        rendered=rendered_mass_and_damping(device, problem.filters, **values),
        contact=contact(
            device,
            problem.region.box,
            problem.filters,
            values,
            speed=motion.speed,
            one_sided=wanted.one_sided,
        ),
        one_sided=wanted.one_sided,
        fade_time=SHORTEST_FADE if pumps else 0.0,
        as_commanded=bool(own) and all(problem.unknowns[i].wish.kind == "value" for i in own),
    )


def _absolute(
    problem: Problem, absolute: AllFound, scene: Scene, name: str, slack: float
) -> tuple[float | None, frozenset[int]]:
    """(gain claimed of all one-sided moments with an element, unknowns that have no more left)."""
    if not absolute:
        return None, frozenset()
    from tune.optimisation.saturation import saturated_unknowns, witness_of

    margin = MARGINS[scene.margin]
    gains = [
        witness_of(each, margin, slack).gain for names, each in absolute.items() if name in names
    ]
    return min(gains, default=None), saturated_unknowns(problem, absolute)


def _jitter(
    device: Device, problem: Problem, moments: Sequence[Moment], sizes: FloatArray
) -> float:
    """How uneven the steps may be in every one of some moments, in parts of the sample time."""
    places = corners_of(device, problem.region.box)
    found = MOST_JITTER
    for moment in moments:
        felt = problem.effects(moment, sizes)
        K, B, M = (0.0 if value is None else float(value) for value in felt.arrays())
        found = min(found, jitter_margin(places, problem.filters, (K, B, M)))
    return round_to_digits(found, 4)


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
