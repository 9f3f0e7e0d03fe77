"""Description of chosen sizes: what binds, margins, steps, levels, contacts and fade times.

And of wanted values that are not met: by how much, why, and what a hand would have felt of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from identification import Box, Device, Finding, InvalidInputError, round_to_digits
from tune.certificate.certify import note_of_dropped, note_of_unmet
from tune.documents.perception import Scale
from tune.documents.profile import (
    MOST_EXTRA_DELAY,
    Design,
    ElementProfile,
    LimitedBy,
    Margins,
    SafeProfile,
)
from tune.documents.scene import (
    EFFECT_NAMES,
    LARGEST,
    LONGEST_FADE,
    MARGINS,
    SHORTEST_FADE,
    UNITS,
    EffectName,
    Effects,
    Margin,
    Scene,
    Wish,
    format_number,
)
from tune.loop.loop import Filters, filters_of, used_filters
from tune.loop.plant import LONGEST_DELAY, WHOLE
from tune.loop.polynomials import FloatArray
from tune.loop.state_space import Corner, corners_of
from tune.optimisation.feasibility import TOO_LITTLE, bindings, ripple, worst_gain
from tune.optimisation.limits import Unknown
from tune.optimisation.problem import SLACK, Combination, DesignTask, Problem
from tune.optimisation.saturation import witness_of
from tune.rendering import contact, rendered_mass_and_damping
from tune.stability.criterion import damping_needed
from tune.stability.nonlinear import MOST_JITTER, Values, jitter_margin, shortest_fade
from tune.stability.verdict import CLOSE, safe_up_to

if TYPE_CHECKING:
    from tune.optimisation.nash import AllFound, Solution

BoolArray = NDArray[np.bool_]

#: Parts of a sample in which a delay margin is looked for and claimed.
_PARTS = 10
#: Claimed margins are cut to this many digits, downwards, and capped: more says nothing.
_MARGIN_CAP = 1000.0
#: A fade is so many times slower than the shortest at which no wave of the level was found to pump:
#: of random ones, and of levels that chase a swing, the slowest that pump are 1.2 times as slow.
_SLOWER = 2.0
#: Fades are told in steps of this, s.
_DIGIT = 0.01
#: So many halves are tried of what could be pumped.
_HALVINGS = 3
#: Why what fades in an element is left out.
_PUMPED = "however slowly it fades, a hand that enters and leaves it in time could pump the device"
#: Part of a wanted value from which on it is met: written values have six digits.
_MET = 1 - 1e-5
#: What bounds a spring that only the device's own damping holds, and what else would hold it.
_HELD = ("gain-margin", "delay-margin", "stability", "saturation", "rendering")
_DAMPED = "damping in the same element, which holds a stiffer spring"
#: A wall that would be so many times as stiff by itself, and what to do about it.
_MUCH = 2.0
_TELL_APART = "Tell it apart (apart:) from what it need not be met with, or ask for less of that"


class SizedCombination(NamedTuple):
    """One combination of a problem at certain sizes of the unknowns."""

    problem: Problem
    combination: Combination
    sizes: FloatArray


def _extra_delays(felt: Sequence[SizedCombination]) -> list[float]:
    """Extra samples of delay up to which all gains in (0, 1] are stable at all corners, of each."""
    # Looked for at whole samples and, before the first that fails, at tenths; what lies between is
    # for the certificate to prove. `MOST_EXTRA_DELAY` where more may be borne.
    boxes = [one.problem.region.box for one in felt]
    # Samples that can be added before a loop is longer than any that can be judged.
    left = [int(LONGEST_DELAY - box.delay[1] / box.sample_time[0]) for box in boxes]
    tops = np.clip(np.array(left, dtype=np.int64), 0, MOST_EXTRA_DELAY)
    holds = np.zeros(len(felt), dtype=np.int64)
    rising = holds < tops
    while rising.any():
        # Of those that hold so far, the next whole sample.
        chosen = np.flatnonzero(rising)
        good = _holding([felt[int(i)] for i in chosen], _PARTS * (holds[chosen] + 1))
        holds[chosen[good]] += 1
        rising[chosen[~good]] = False
        rising &= holds < tops
    low, high = np.zeros(len(felt), dtype=np.int64), np.full(len(felt), _PARTS)
    open_ = np.flatnonzero(holds < tops)
    while np.any(high[open_] - low[open_] > 1):
        middle = (low + high) // 2
        good = _holding([felt[int(i)] for i in open_], (_PARTS * holds + middle)[open_])
        low[open_[good]] = middle[open_[good]]
        high[open_[~good]] = middle[open_[~good]]
    return [round(float(whole + part / _PARTS), 1) for whole, part in zip(holds, low, strict=True)]


def _holding(felt: Sequence[SizedCombination], parts: NDArray[np.int64]) -> BoolArray:
    """Whether each is stable at its own parts of a sample more, at every gain in (0, 1]."""
    good = np.ones(len(felt), dtype=np.bool_)
    # Those with the same loops and delay, all with a spring or all without, are judged at once.
    together: dict[tuple[int, float, bool], list[int]] = {}
    for place, (one, part) in enumerate(zip(felt, parts.tolist(), strict=True)):
        key = id(one.problem.loops), part / _PARTS, bool(one.combination.members[0])
        together.setdefault(key, []).append(place)
    for (_, late, _), places in together.items():
        alike = [felt[place] for place in places]
        each = [one.problem.effects(one.combination, one.sizes) for one in alike]
        totals: dict[EffectName, FloatArray | None] = {}
        for name in EFFECT_NAMES:
            values: list[float | None] = [getattr(effects, name) for effects in each]
            there = any(value is not None for value in values)
            totals[name] = np.array([[value or 0.0] for value in values]) if there else None
        for loop in alike[0].problem.loops.latest(late):
            good[places] &= np.all(safe_up_to(loop, Effects(**totals), 1 + CLOSE), axis=1)
    return good


class _CombinationMargins(NamedTuple):
    """Margins of one combination at the sizes written."""

    elements: tuple[str, ...]
    gain: float  # stable for every gain below it, at the device's own delay
    late: float  # extra samples of delay that it bears, 10 at most
    # how uneven the steps may be, in parts of the sample time; no more is looked for than what its
    # elements bear in the combinations before it
    jitter: float


def combination_margins(
    device: Device, felt: Sequence[SizedCombination], kept: Margin, slack: float
) -> dict[tuple[str, ...], _CombinationMargins]:
    """Margins of combinations, by their elements."""
    found: dict[tuple[str, ...], _CombinationMargins] = {}
    jitters: dict[str, float] = {}
    for one, most in zip(felt, _extra_delays(felt), strict=True):
        problem, elements = one.problem, one.combination.elements
        gain = min(worst_gain(problem, one.combination, one.sizes, late=False), _MARGIN_CAP)
        late = min(float(MOST_EXTRA_DELAY), most)
        # A part of what is beyond the kept margin is not claimed where a proof came too close to
        # the edge, and at the last slack nothing of it.
        if slack:
            last = slack >= SLACK[-2]
            less = 0.0 if last else float(np.floor(late * (1 - slack) * 10) / 10)
            gain = max(0.0 if last else gain * (1 - slack), min(gain, kept.gain))
            late = max(less, min(late, kept.extra_delay_samples))
        effects = problem.effects(one.combination, one.sizes)
        K, B, M = (0.0 if value is None else float(value) for value in effects.arrays())
        places = corners_of(device, problem.region.box)
        borne = max(jitters.get(name, MOST_JITTER) for name in elements)
        jitter = jitter_margin(places, problem.filters, (K, B, M), borne)
        jitters |= {name: min(jitter, jitters.get(name, jitter)) for name in elements}
        found[elements] = _CombinationMargins(elements, gain, late, jitter)
    return found


def element_profile(
    device: Device,
    scene: Scene,
    solved: Solution,
    name: str,
    margins: Sequence[_CombinationMargins],
    absolute: AllFound,
    slack: float,
) -> ElementProfile:
    """The profile entry of one element, every number computed from the written sizes.

    Margins are those of all combinations of the scene; absolute are the gains of those that are
    proved absolutely stable, of which the slack is not claimed.
    """
    problem, sizes = solved.problem, solved.sizes
    values = dict.fromkeys(EFFECT_NAMES, 0.0)
    steps: dict[EffectName, float] = {}
    limited: dict[EffectName, LimitedBy] = {
        effect: "not-perceptible" for effect in EFFECT_NAMES if f"{name}.{effect}" in solved.dropped
    }
    own = [index for index, unknown in enumerate(problem.unknowns) if unknown.element == name]
    words = bindings(problem, sizes, own, solved.stepped_back)
    for index, word in zip(own, words, strict=True):
        unknown = problem.unknowns[index]
        values[unknown.effect] = unknown.sign * float(sizes[index])
        steps[unknown.effect] = round_to_digits(unknown.steps(float(sizes[index])), 4)
        limited[unknown.effect] = word
    alone = [m for m in problem.combinations if m.elements == (name,) and any(m.members)]
    mine = [each for each in margins if name in each.elements]
    gains = [each.gain for each in mine]
    # What an unstable loop makes of the encoder's noise has no number.
    noise = ripple(problem, alone[0], sizes) if alone and min(gains) > 1 else None
    kept = MARGINS[scene.margin]
    clamped = [witness_of(one, kept, slack).gain for m, one in absolute.items() if name in m]
    gains += clamped
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
            absolute_gain=min(clamped, default=None),
        ),
        ripple=None if noise is None else round_to_digits(noise, 4),
        limited_by=limited,
        motion=scene.motion(name, device.motion, cut=name in problem.cut),
        rendered=rendered_mass_and_damping(device, problem.filters, **values),
        one_sided=scene.elements[name].one_sided,
        lead=scene.lead(name, device.motion),
        fade_time=SHORTEST_FADE if pumps else 0.0,
    )


def _floored(size: float, digits: int = 6) -> float:
    """A size to so many digits, rounded towards nothing."""
    unit = 10.0 ** (np.floor(np.log10(size)) + 1 - digits)
    return round_to_digits(float(np.floor(size / unit * (1 + 1e-12)) * unit), digits)


def with_levels_and_contacts(design: Design, device: Device, box: Box) -> Design:
    """The design with the force at which each spring is cut, and what entering each amounts to."""
    deep = {
        name: element.stiffness * (element.motion.penetration or 0.0)
        for name, element in design.elements.items()
        if element.stiffness
    }
    # A cut round a sum of springs is not a clamp of one signal: each has a level of its own. Those
    # that may push at once share alike what the depths that are stated leave of the peak force.
    at_once = [deep.keys() & {*combination} for combination in design.combinations()]
    peak = LARGEST if device.force_limit is None else device.force_limit.peak
    filters = filters_of(design.loop)
    elements: dict[str, ElementProfile] = {}
    for name, element in design.elements.items():
        shares = ((peak - sum(deep[each] for each in m)) / len(m) for m in at_once if name in m)
        level = _floored(deep[name] + min(shares, default=0.0)) if name in deep else 0.0
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
    K, B, M = values["stiffness"], values["damping"], values["mass"]
    needed = max(
        damping_needed(K, B, M, step, filters, delay_samples=whole)
        for step in dict.fromkeys(region.box.sample_time)
    )
    return bool(region.box.damping[0] > needed)


class NoFadeError(Exception):
    """The name of an element: however slowly it fades, a hand could pump the device."""


def with_fades(design: Design, scene: Scene) -> Design:
    """The design with the fade time of every element that fades, so slow that no hand pumps.

    It is looked for with the margin of gain used up, and with that of delay. Where several of a
    combination fade, each at any time, all of them together move a swing as their sum does, and
    each takes so many times longer.

    Raises InvalidInputError where the scene asks for a shorter time, NoFadeError where no fade is
    slow enough.
    """
    needed = {name: SHORTEST_FADE for name, element in design.elements.items() if element.fades}
    # While a wall pushes no level moves.
    for combination in (each for each in design.combinations() if design.walls.isdisjoint(each)):
        fading = [name for name in combination if name in needed]
        for name in fading:
            time = len(fading) * _slowest(design, combination, fading, name)
            needed[name] = max(needed[name], time)
    elements = dict(design.elements)
    for name, time in needed.items():
        least = round(float(np.ceil(time / _DIGIT - 1e-9)) * _DIGIT, 2)
        if least > LONGEST_FADE:
            raise NoFadeError(name)
        wanted = scene.elements[name].fade_time
        if wanted is not None and wanted < least:
            raise InvalidInputError(
                f"elements.{name}.fade_time",
                f"{wanted:g} s is too fast: a hand that enters and leaves it in time could pump "
                f"the device; it must fade over {least:g} s",
                f"Ask for {least:g} s or more, or leave fade_time out",
            )
        stated = least if wanted is None else wanted
        elements[name] = elements[name].model_copy(update={"fade_time": stated})
    return design.model_copy(update={"elements": elements})


def _slowest(design: Design, combination: Sequence[str], fading: Sequence[str], name: str) -> float:
    """s, for one element of a combination: with those that fade beside it, or along with it."""
    elements = design.elements
    others = [elements[each] for each in combination if each not in fading]
    along = [elements[each] for each in fading if each != name]
    own = elements[name]
    undamped = [each.model_copy(update={"damping": min(each.damping, 0.0)}) for each in others]
    cases = [(others, [own, *along]), (undamped, [own, *along])]
    if along:
        cases += [([*others, *along], [own]), ([*undamped, *along], [own])]
    # Dampers beside it are switched at any moment.
    pairs = dict.fromkeys((_sum(beside), _sum(moved)) for beside, moved in cases)
    margin, filters = design.margin, filters_of(design.loop)
    # With both used up nothing is left by which any swing would die out.
    used = ((margin.gain, 0.0), (1.0, margin.extra_delay_samples))
    return max(
        _SLOWER * _found(_places(design, extra), filters, _times(gain, beside), _times(gain, moved))
        for beside, moved in pairs
        for gain, extra in used
    )


def _times(gain: float, values: Values) -> Values:
    return (gain * values[0], gain * values[1], gain * values[2])


@lru_cache(maxsize=1024)
def _found(places: tuple[Corner, ...], filters: Filters, beside: Values, fading: Values) -> float:
    """Fade time of an element beside a combination, kept because it is asked for more than once."""
    found = shortest_fade(places, filters, beside, fading)
    if np.isfinite(found) or not fading[0]:
        return found
    # A spring that fades in from nothing swings so slowly at low levels that only what the device
    # loses bounds it there: where that is too little, it is taken to go all the way in and out.
    return shortest_fade(places, filters, beside, fading, whole=True)


def _places(design: Design, extra: float) -> tuple[Corner, ...]:
    """Corners of the box where least is lost: least damping, longest delay and extra samples."""
    box = design.device.simultaneous_box()
    corners = corners_of(design.device, box)
    loss, late = min(c.damping for c in corners), max(c.delay for c in corners)
    return tuple(
        replace(corner, delay=late + extra * corner.sample_time)
        for corner in corners
        if corner.damping == loss and corner.delay == late
    )


def _sum(elements: Sequence[ElementProfile]) -> Values:
    """K, B and M of some elements together."""
    K, B, M = (sum((getattr(each, name) for each in elements), 0.0) for name in EFFECT_NAMES)
    return K, B, M


def why_pumped(scene: Scene, design: Design, unknown: Unknown, size: float) -> str:
    """Why so much of an effect that fades is left out of a design, and what to ask for instead."""
    name = unknown.element
    wishes = scene.elements[name].wishes()
    ways = ["give its spring an element of its own, felt together with it"]
    ways *= "stiffness" in wishes
    ways += ["ask for damping in the same element"] * ("damping" not in wishes)
    # The half of it, or half of that, is told where no hand was found to pump it.
    sizes = (size / 2**count for count in range(1, _HALVINGS + 1))
    for less in (each for each in sizes if each >= unknown.low):
        changed = design.elements[name].model_copy(update={unknown.effect: unknown.sign * less})
        tried = design.model_copy(update={"elements": {**design.elements, name: changed}})
        with suppress(NoFadeError, InvalidInputError):
            with_fades(tried, scene)
            most = format_number(unknown.sign * _floored(less, 2))
            ways.append(f"ask {_at_most(most, unknown.sign)}")
            break
    else:
        ways.append(f"ask for much less than {format_number(unknown.sign * size)}")
    sums = [each for each in scene.combinations() if name in each]
    met = dict.fromkeys(each for names in sums for each in names if each != name)
    ways += [f"keep it apart from {' and '.join(met)}"] * bool(met)
    return _with_ways(_PUMPED, ways)


def why_unproved(task: DesignTask, label: str, gain: float) -> str:
    """Why a spring with a clamp is left out that is proved up to a gain only, and what may help."""
    scene, name, motion = task.scene, label.rpartition(".")[0], task.device.motion
    mine, lead = scene.elements[name], scene.lead(name, motion)
    mates = [scene.elements[each] for group in scene.together if name in group for each in group]
    ways: list[str] = []
    if any(each.priority < mine.priority for each in mates):
        ways.append("give what is asked for together with it the same priority, to leave it room")
    if lead is not None and (mine.damping is None or mine.damping.kind != "value"):
        more = f"{format_number(lead)} {UNITS[motion]['length']}"
        ways.append(f"allow it more lead than {more}, with which more damping holds it")
    proved = f"pushing on one side, or cut, it is proved stable to a gain of {gain:.4g} only"
    return _with_ways(proved, ways)


def _with_ways(why: str, ways: Sequence[str]) -> str:
    """A reason, followed by what to ask for instead, if there is anything."""
    words = ", or ".join(ways)
    return f"{why}. {words[0].upper()}{words[1:]}" if words else why


def _at_most(most: str, sign: float) -> str:
    """For a size at most, which of a negative one is what is closer to zero."""
    return f"for at most {most}" if sign > 0 else f"for {most} or closer to zero"


def with_what_is_felt(
    task: DesignTask, filters: Filters, solutions: Sequence[Solution]
) -> dict[str, str]:
    """Reasons by label, with what else would be felt of what is dropped, and the remedy."""
    told: dict[str, str] = {}
    sizes = {label: size for solved in solutions for label, size in solved.by_label().items()}
    dropped = {label: why for solved in solutions for label, why in solved.dropped.items()}
    for label, why in dropped.items():
        name, _, effect = label.rpartition(".")
        effect = cast("EffectName", effect)
        wishes = task.scene.elements[name].wishes()
        beside: dict[EffectName, float] = {
            each: wish.sign * sizes.get(f"{name}.{each}", 0.0) for each, wish in wishes.items()
        }
        told[label] = why
        # A spring is dropped for its force or for stability; other reasons have a remedy already.
        if effect != "stiffness" and ". " not in why and not why.endswith("limited by wanted"):
            felt = _felt_instead(task, filters, name, effect, beside)
            remedy = _remedy(wishes, effect, "for less of it" * (TOO_LITTLE not in why))
            told[label] = f"{why}{felt}. {remedy}" if felt and remedy else f"{why}{felt}"
        if effect == "stiffness" and why.endswith(_HELD) and "damping" not in wishes:
            told[label] = f"{why}. Ask for {_DAMPED}"
    return told


def notes_of_unmet(
    task: DesignTask,
    filters: Filters,
    elements: Mapping[str, ElementProfile],
    solutions: Sequence[Solution],
) -> Iterator[str]:
    """A note about each wanted value of which less is played, with numbers and a remedy.

    And about the largest stiffness where damping beside it would let it be larger, and that of a
    wall where what is met beside it costs much of it.
    """
    units = UNITS[task.device.motion]
    alone = {label: size for solved in solutions for label, size in solved.alone.items()}
    tightest = {label: solved.tightest for solved in solutions for label in solved.alone}
    for name, element in elements.items():
        played: dict[EffectName, float] = {each: getattr(element, each) for each in EFFECT_NAMES}
        wishes = task.scene.elements[name].wishes()
        for effect, wish in wishes.items():
            size, asked = played[effect], wish.high or 0.0
            if not size:
                continue
            most, about = f"{format_number(size)} {units[effect]}", f"{name}.{effect}"
            why, felt = element.limited_by[effect], ""
            damped = effect == "stiffness" and why in _HELD
            undamped = damped and "damping" not in wishes
            if wish.kind == "max" and alone.get(about, 0.0) > _MUCH * size:
                most_alone = f"about {format_number(alone[about])} {units[effect]} by itself"
                mates = " and ".join(each for each in tightest[about] if each != name)
                above = f", above all {mates}" * bool(mates)
                beside = (
                    f"{most} is the most found with all that is met beside it{above}, {most_alone}"
                )
                yield f"{note_of_unmet(about)}{beside}. {_TELL_APART}"
            elif wish.kind == "max" and undamped:
                bare = f"{most} is the most without damping beside it, limited by {why}"
                yield f"{note_of_unmet(about)}{bare}. Ask for {_DAMPED}"
            met = abs(size) >= _MET * abs(asked) or why == "wanted"
            if wish.kind != "value" or met:
                continue
            if why == "rendering":
                felt = _felt_instead(task, filters, name, effect, played)
            less = _at_most(most, size)
            remedy = f"Ask {less}" + f", or for {_DAMPED}" * undamped
            yield (
                f"{note_of_unmet(about)}{format_number(asked)} {units[effect]} is "
                f"asked for, {most} is played, limited by {why}{felt}. "
                + (_remedy(wishes, effect, less) if felt or damped > undamped else remedy)
            )


def unmet_wishes(profile: SafeProfile, scene: Scene) -> Iterator[Finding]:
    """What a profile's notes say of wanted values and ranges that are not met."""
    units = UNITS[profile.device.motion]
    for name, element in scene.elements.items():
        for effect, wish in element.wishes().items():
            label = f"{name}.{effect}"
            words = note_of_dropped(label), note_of_unmet(label)
            for note in profile.notes if wish.kind in {"value", "range"} else ():
                if note.startswith(words):
                    seen, _, remedy = note.partition(". ")
                    ends = dict.fromkeys((wish.low or 0.0, wish.high or 0.0))
                    yield Finding(
                        code="not-as-wanted",
                        severity="warning",
                        seen=seen,
                        needed=f"{' to '.join(map(format_number, ends))} {units[effect]}",
                        remedy=remedy or "Ask for another value",
                        source=label,
                    )


def _remedy(wishes: Mapping[EffectName, Wish], effect: EffectName, less: str) -> str:
    """To ask for less, or for damping beside an effect, where that is not all there is."""
    damping = wishes.get("damping")
    more = "for damping beside it" if damping is None else "for more damping beside it"
    held = effect == "damping" or (damping is not None and damping.kind in {"max", "min"})
    ways = [way for way in (less, more * (not held)) if way]
    return f"Ask {', or '.join(ways)}" if ways else ""


def _felt_instead(
    task: DesignTask,
    filters: Filters,
    name: str,
    effect: EffectName,
    played: Mapping[EffectName, float],
) -> str:
    """What a hand would feel of what is wanted, or else of a step; "" if that is within a step."""
    device, scene, table = task.device, task.scene, task.table
    if name in scene.walls:
        return ""
    motion, wishes = scene.motion(name, device.motion), scene.elements[name].wishes()
    scales = {each: Scale.of(each, device, table, motion) for each in EFFECT_NAMES}
    # What is played of the rest of its element is beside it.
    sizes: dict[EffectName, float] = dict.fromkeys(EFFECT_NAMES, 0.0) | dict(played)
    wish = wishes[effect]
    asked = wish.low if wish.kind in {"value", "range"} else None
    sizes[effect] = asked or scales[effect].value_at(1.0, wish.sign)
    felt = rendered_mass_and_damping(device, filters, **sizes)
    ends: dict[EffectName, tuple[float, float]] = {
        "mass": felt.mass_at_ends,
        "damping": felt.damping_at_ends,
    }
    units, parts, most = UNITS[device.motion], list[str](), 0.0
    for each, pair in ends.items():
        heights = scales[each].height(np.array([*pair, sizes[each]])) / np.log1p(scales[each].weber)
        most = max(most, float(np.max(np.abs(heights[:2] - heights[2]))))
        if any(pair):
            parts.append(f"{min(pair):.3g} to {max(pair):.3g} {units[each]} of {each}")
    with_it = f"{format_number(sizes[effect])} {units[effect]}"
    return f"; with {with_it} a hand would feel {' and '.join(parts)}" if most > 1 else ""
