"""What a chosen setting amounts to: which limit binds, margins, steps, and what was not needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from identification import Device, rounded
from tune.documents.effects import EFFECT_NAMES, EffectName, Effects
from tune.documents.profile import ElementProfile, LimitedBy, Margins
from tune.documents.scene import FADE_TIME, MARGINS, Scene
from tune.loop.filters import used_filters
from tune.loop.sampled_plant import WHOLE
from tune.margins.passivity import damping_needed
from tune.optimisation.bounds import force_bound, ripple_bound, stable_bounds
from tune.optimisation.delays import MOST
from tune.optimisation.limits import forces_allowed, ripple, stable_points, worst_gain
from tune.optimisation.problem import Problem
from tune.rendering.rendered import rendered

if TYPE_CHECKING:
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
    "ripple",
    "stability",
    "gain-margin",
    "delay-margin",
)


def bindings(problem: Problem, sizes: FloatArray, indices: Sequence[int]) -> list[LimitedBy]:
    """The constraint that keeps each of some effects from being larger, the others as they are."""
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
    forces = {index: force_bound(problem, sizes, index) for index in tops}
    most = {i: min(top, forces[i], problem.unknowns[i].high) for i, top in tops.items()}
    late = stable_bounds(problem, sizes, [*most], [*most.values()], gain)
    bounds: dict[int, dict[LimitedBy, float]] = {}
    for (index, top), stable in zip(most.items(), late, strict=True):
        unknown = problem.unknowns[index]
        least = min(top, stable)
        noisy = ripple_bound(problem, sizes, index, least)
        found: dict[LimitedBy, float] = {
            "force": forces[index],
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


def reasons_for_nothing(problem: Problem) -> dict[str, str]:
    """Why effects cannot be played even at the least size, by label; empty where all can."""
    low = np.array([unknown.low for unknown in problem.unknowns])
    reasons: dict[str, str] = {}
    weakest = problem.region.box.damping[0]
    gain, extra = problem.margin.gain, problem.margin.extra_delay_samples
    for index, unknown in enumerate(problem.unknowns):
        alone = np.zeros_like(low)
        alone[index] = unknown.low
        if unknown.high < unknown.low:
            reasons[unknown.label] = (
                f"the device may have as little as {unknown.high * gain:.4g} to take away from, "
                f"with a gain margin of {gain:g} at most {max(unknown.high, 0):.4g}"
            )
        elif not forces_allowed(problem, alone):
            limits = problem.limits
            reasons[unknown.label] = (
                f"even {unknown.low:.4g} exceeds the force limit, {limits.continuous_force:g} "
                f"continuous and {limits.peak_force:g} at the peak"
            )
        elif weakest <= 0 and not _helped(problem, index):
            reasons[unknown.label] = (
                f"the lowest damping of the device is {weakest:.4g}, not positive; nothing but "
                "its damping would hold this effect. Take a longer log, or add damping"
            )
        elif len(problem.unknowns) == 1 and not all(stable_points(problem, low[None], gain)):
            reasons[unknown.label] = (
                f"even {unknown.low:.4g} is not stable with a gain margin of {gain:g} and "
                f"{extra} extra samples of delay"
            )
    return reasons


def _helped(problem: Problem, index: int) -> bool:
    """True where a positive damper of the same element is there to hold the effect."""
    unknown = problem.unknowns[index]
    return problem.region.box.damping[0] == 0 and any(
        other.element == unknown.element and other.effect == "damping" and other.sign > 0
        for other in problem.unknowns
    )


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
            steps[unknown.effect] = rounded(counted, 4)
        limited[unknown.effect] = "saturation" if index in bound else word
    moments = [m for m in problem.moments if name in m.elements and any(m.members)]
    gains = [worst_gain(problem, m, sizes, late=False) for m in moments]
    alone = [m for m in problem.moments if m.elements == (name,)]
    # What an unstable loop makes of the encoder's noise has no number.
    noise = ripple(problem, alone[0], sizes) if alone and min(gains) > 1 else None
    gain = min([*gains, _MARGIN_CAP])
    late = min([float(MOST), *(delays[moment.elements] for moment in moments)])
    if slack:
        kept = MARGINS[scene.margin]
        gain = max(gain * (1 - slack), min(gain, kept.gain))
        late = max(
            float(np.floor(late * (1 - slack) * 10) / 10), min(late, kept.extra_delay_samples)
        )
    pumps = bool(values["mass"]) or min(values.values()) < 0
    wanted = scene.elements[name]
    return ElementProfile(
        stiffness=values["stiffness"],
        damping=values["damping"],
        mass=values["mass"],
        perceived_steps=steps,
        margins=Margins(
            gain=float(np.floor(gain * 1000 * (1 - 1e-9)) / 1000),
            extra_delay_samples=late,
            passive=_passive(problem, values),
            absolute_gain=absolute_gain,
        ),
        ripple=None if noise is None else rounded(noise, 4),
        limited_by=limited,
        motion=scene.motion(name, device.motion),
        rendered=rendered(device, problem.filters, **values),
        one_sided=wanted.one_sided,
        fade_time=(wanted.fade_time or FADE_TIME) if pumps else 0.0,
    )


def _absolute(
    problem: Problem, absolute: AllFound, scene: Scene, name: str, slack: float
) -> tuple[float | None, frozenset[int]]:
    """(gain claimed of all one-sided moments with an element, unknowns that have no more left)."""
    if not absolute:
        return None, frozenset()
    from tune.optimisation.saturation import saturated, witness_of

    margin = MARGINS[scene.margin]
    gains = [
        witness_of(each, margin, slack).gain for names, each in absolute.items() if name in names
    ]
    return min(gains, default=None), saturated(problem, absolute)


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
