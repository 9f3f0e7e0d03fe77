"""Re-compute a written profile by the independent path: digest, certificate, all that it says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, cast

import numpy as np

from identification import Device, to_mapping, typed
from tune.certificate.absolute import clamped_combinations, judge_switched
from tune.certificate.certify import (
    certify,
    note_of_apart,
    note_of_dropped,
    note_of_unmet,
    skipped_parts,
)
from tune.certificate.claims import (
    damping_for_passivity,
    excess_over_request,
    force_failures,
    impedances,
    meets_wall,
    ripple_of,
    whole_delay,
)
from tune.certificate.poles import judge
from tune.certificate.region import Point, Setting, regions_of, setting_of
from tune.certificate.time_domain import contact_failures, four_digits, jitter_failures, lead_of
from tune.certificate.worst_point import worst_points
from tune.certificate.zero_exclusion import Claim
from tune.documents import CheckFailedError
from tune.documents.profile import (
    Certificate,
    Design,
    ElementProfile,
    HandBox,
    MarginProfile,
    ModeBox,
    SafeProfile,
    WorstPoint,
    profile_of,
    read_signed,
)
from tune.documents.scene import EFFECT_NAMES, LONGEST_FADE, SHORTEST_FADE, EffectName, groups_of

#: Facts and wishes for which somebody answers: keys of profiles, with all below them, * for any
#: name, and what is believed of each, and what not.
TAKEN_ON_TRUST = {
    "device": "facts of the device and its logs; --device compares them",
    "scene": "a name",
    "hand": "the grips asked for, each of which is proved",
    "ripple_limit": "as asked for; that no combination exceeds it is recomputed",
    "perception": "how finely hands tell; the steps it gives are recomputed",
    "elements.*.motion": "how deep, fast and hard the hand moves",
    "together": "sets as asked for, each of which is proved",
    "apart": "pairs that the scene keeps apart; every other is proved",
    "elements.*.lead": "as asked for; that it is kept is recomputed",
    "elements.*.one_sided": "as asked for; that nothing in it pulls is checked",
    "elements.*.fade_time": "as asked for or found; that all that must not be switched fades is "
    "checked, not once more whether a hand could pump it",
}
_MULTIPLIERS = "which multipliers; that these prove what they are stated for is done again"
#: What a check leaves as it is said: a wish that nobody else knows, or what is no claim.
OPINIONS = {
    "elements.*.limited_by": "that a value or range was wanted, no limit is met in the range "
    "looked in, or the rehearsal took more; that every other limit said to bind allows no tenth "
    "more is recomputed, of the proof of a wall, for which elements leave room, not twice as much",
    "elements.*.margins.gain": "that no more could be proved",
    "elements.*.margins.extra_delay_samples": "that no more could be proved",
    "notes": "why effects were dropped; which ones is recomputed",
    "method": "which solver proposed; nothing rests on it",
    "certificate.absolute_stability.*.free": _MULTIPLIERS,
    "certificate.absolute_stability.*.held": _MULTIPLIERS,
    "certificate.points": "the work it took; it is done again",
    "certificate.cells": "the work it took; it is done again",
    "certificate.versions": "what it was computed with",
}

#: Numbers are stored with twelve digits.
_AGREE = 1e-9
_CLAIMED = (
    *("confidence", "mass", "damping", "sample_time", "delay", "delay_samples", "gain"),
    *("extra_delay_samples", "modes", "current_lag", "position_stiffness", "presliding_stiffness"),
    "hand",
)
#: A fresh search may find a pole closer to the circle by this part of its distance from it: another
#: linear algebra library may climb to another point.
_SEARCH = 0.01
#: Characters of a value in a sentence.
_SHORT = 80
#: Margins are looked for up to so much gain and so many samples, and stated in such steps.
_MOST_GAIN, _MOST_SAMPLES = 1000.0, 10.0
_STEP_OF_GAIN, _STEP_OF_DELAY = 1e-3, 0.1
#: Parts of a step within which a number is one of its multiples.
_WHOLE = 1e-6
#: A stated ripple has four digits.
_RIPPLE_AGREES = 1e-3
#: Parts of a sample within which every reader takes a delay for whole.
_WELL_WHOLE = 5e-10
#: Passivity this close to its edge may be told either way.
_EDGE = 1e-6
#: A limit that is named is met where the effect is larger by this part: how closely limits are met
#: is the tuner's affair, that another one is named is found out.
_GROWN = 0.1
#: ... and by this one where an element leaves room for a wall.
_ROOM = 1.0
#: Limits of a whole combination, below which slack for a proof leaves room.
_SHARED = {"gain-margin", "delay-margin", "stability", "saturation"}
#: ... of so much of the gain at most: what hardly moves the loop could be many times larger in it.
_SPARE = 0.07
#: Cells in which a proof that is easy is found.
_FEW_CELLS = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """A profile that passed, beside the certificate computed anew."""

    profile: SafeProfile
    certificate: Certificate


@typed
def check(path: str | PathLike[str], device: Device | None = None) -> CheckReport:
    """Check a profile file.

    Args:
        path: of the file.
        device: that the profile has to be for; None takes the device of the file on trust.

    Raises:
        InvalidInputError: not a readable profile.
        CheckFailedError: the digest is wrong, a point is unstable or undecided, the file says what
            was not found, or the device is another.
    """
    return check_content(read_signed(path), path, device)


def check_content(
    content: Mapping[str, Any], source: str | PathLike[str], device: Device | None = None
) -> CheckReport:
    """Check the content of a profile file whose digest belongs to it; raises as `check`."""
    profile = profile_of(content, source)
    names = "the file", "what haptune writes"
    failures = [*_differences(content, to_mapping(profile), names), *_stated_failures(profile)]
    if device is not None:
        names = "the device given", "the profile"
        failures += _differences(to_mapping(device), to_mapping(profile.device), names, "device")
    try:
        fresh = certify(profile, witnesses=profile.certificate.absolute_stability)
    except CheckFailedError as error:
        raise CheckFailedError((*error.failures, *failures), error.points) from None
    first = profile.one_of_each()
    for name in first.elements:
        failures += _element_failures(first, name)
    failures += _claims_differ(first, fresh)
    if failures:
        raise CheckFailedError(tuple(failures))
    return CheckReport(profile=profile, certificate=fresh)


def _claims_differ(profile: SafeProfile, fresh: Certificate) -> Iterator[str]:
    """Numbers of the certificate that the device and the elements of the file do not give."""
    stated = profile.certificate
    for combination in stated.interior:
        if combination not in fresh.interior:
            yield (
                f"certificate.interior says {combination} is proved, the profile has no such "
                "combination, or one of elements that are alike"
            )
    for combination in fresh.interior:
        if combination not in stated.interior:
            yield f"certificate.interior does not say that {combination} is proved. Tune again"
    for name in ("method", "assumes", "not_assessed", "absolute_stability"):
        if getattr(stated, name) != getattr(fresh, name):
            yield f"certificate.{name} is not what haptune says of such a profile. Tune again"
    for name in _CLAIMED:
        seen, said = (_numbers(getattr(each, name)) for each in (fresh, stated))
        if len(seen) != len(said) or not np.allclose(seen, said, rtol=_AGREE, atol=0):
            shown = [
                " to ".join(f"{item:.12g}" for item in each) or "nothing" for each in (said, seen)
            ]
            yield f"certificate.{name} says {shown[0]}, computed anew it is {shown[1]}"
    for name, element in profile.elements.items():
        gains = [
            proved.gain
            for combination, proved in (fresh.absolute_stability or {}).items()
            if name in combination.split(" + ")
        ]
        seen, said = min(gains, default=None), element.margins.absolute_gain
        if said != seen:
            yield f"{name}: margins.absolute_gain says {said}, the certificate proves {seen}"
    yield from _worst_differs(profile, fresh)


def _worst_differs(profile: SafeProfile, fresh: Certificate) -> Iterator[str]:
    """The worst point is in the box, has the radius it says, and the search finds no worse."""
    stated = profile.certificate.worst
    setting = (
        setting_of(profile, stated.elements) if stated.elements in profile.combinations() else None
    )
    if setting is None:
        yield f"certificate.worst names {', '.join(stated.elements)[:80]}, which is not felt"
        return
    point = _point_of(profile, stated)
    if point is None or not np.isclose(stated.gain, fresh.gain, rtol=_AGREE, atol=0):
        yield "certificate.worst is not a point of the box"
        return
    seen = judge(point, setting, stated.gain).radius
    if not np.isclose(seen, stated.pole_radius, rtol=_AGREE, atol=0):
        yield (
            f"certificate.worst.pole_radius says {stated.pole_radius:.12g}, computed anew it is "
            f"{seen:.12g}"
        )
    # A radius as stored has twelve digits, too few where a pole moves in millionths of a millionth.
    elif 1 - seen > (1 + _SEARCH) * (1 - fresh.worst.pole_radius):
        yield (
            f"certificate.worst.pole_radius says {stated.pole_radius:.12g}, a worse one was found: "
            f"{fresh.worst.pole_radius:.12g}"
        )


def _point_of(design: Design, stated: WorstPoint) -> Point | None:
    """A stated point, None where it lies in no region of the box, to the digits stored."""
    hand, late, extra = stated.hand, stated.delay_samples, float(design.margin.extra_delay_samples)
    values = [stated.mass, stated.damping, stated.sample_time, 0.0]
    values += [stated.current_lag or 0.0, stated.position_stiffness or 0.0]
    values += [] if hand is None else [hand.mass, hand.damping, hand.stiffness]
    values += [each for mode in stated.modes for each in (mode.frequency_hz, mode.damping_ratio)]
    for region in regions_of(design):
        (first, last), (shortest, longest) = region.delay, region.sample_time
        sides = [*region.sides()]
        sides[3] = (0.0, 0.0)
        if (hand is None) != (region.hand is None) or len(values) != len(sides):
            continue
        pairs = zip(
            [*values, late], [*sides, (first / longest, last / shortest + extra)], strict=True
        )
        if all(
            low - _AGREE * abs(low) <= value <= high + _AGREE * abs(high)
            for value, (low, high) in pairs
        ):
            return region.point(np.array(values), late)
    return None


def _numbers(part: object) -> list[float]:
    """All numbers in a part of a certificate, in order."""
    if isinstance(part, int | float):
        return [float(part)]
    inner = [value for _, value in part] if isinstance(part, HandBox | ModeBox) else part or ()
    return [number for each in cast("Iterable[object]", inner) for number in _numbers(each)]


def _differences(
    first: Mapping[str, object],
    second: Mapping[str, object],
    names: tuple[str, str],
    above: str = "",
) -> Iterator[str]:
    """Sentences about the innermost keys in which two named mappings of YAML types differ."""
    for name in dict.fromkeys((*first, *second)):
        one: object = first.get(name)
        other: object = second.get(name)
        key = f"{above}.{name}" if above else name
        if isinstance(one, dict) and isinstance(other, dict):
            parts = cast("dict[str, object]", one), cast("dict[str, object]", other)
            yield from _differences(*parts, names, key)
        elif one != other or (name in first) != (name in second):
            shown = _shown(first.get(name)), _shown(second.get(name))
            yield f"{key}: {shown[0]} in {names[0]}, {shown[1]} in {names[1]}"


def _shown(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= _SHORT else text[: _SHORT - 3] + "..."


def inconsistent(design: Design, name: str) -> Iterator[str]:
    """What one element states that nothing has to be computed for to refuse."""
    element = design.elements[name]
    yield from _wrong_keys(name, element)
    yield from _wrong_margins(design, name)
    yield from _wrong_play(name, element)
    felt = element.rendered
    if felt is None:
        yield f"{name}: rendered is missing. Tune again"
    elif not element.acting and any(map(np.any, dict(felt).values())):
        yield f"{name}: rendered says that something is felt, but no effect acts"
    if not element.acting and element.force_level:
        yield f"{name}: force_level says {element.force_level:.6g} N, but no effect acts"


def _element_failures(design: Design, name: str) -> Iterator[str]:
    """What one element of a certified design states and a calculation does not confirm."""
    setting = setting_of(design, (name,))
    yield from _wrong_ripple(design, name, setting)
    yield from _wrong_passivity(design, name, setting)
    yield from contact_failures(design, name)
    yield from jitter_failures(design, name)
    element = design.elements[name]
    for effect, word in element.limited_by.items():
        believed = word in {"wanted", "range"} or f"{name}.{effect}" in _unsettled(design)
        if not believed and getattr(element, effect):
            yield from _wrong_limit(design, name, effect)


def note_of_rehearsal(label: str) -> str:
    """The note about an effect that stability limits in simulation alone, by its label."""
    return f"rehearsal: {label} is less than other limits allow, so that it settles in simulation"


def _unsettled(design: Design) -> set[str]:
    """What is said to be limited by stability, as more of it did not settle in simulation."""
    labels = {
        f"{name}.{effect}"
        for name, element in design.elements.items()
        for effect, word in element.limited_by.items()
        if word == "stability"
    }
    return {label for label in labels if note_of_rehearsal(label) in design.notes}


def _wrong_keys(name: str, element: ElementProfile) -> Iterator[str]:
    """Effects that are named and do not act, or act and are not named."""
    if set(element.perceived_steps) != element.acting:
        yield (
            f"{name}: perceived_steps has {_listed(element.perceived_steps)}, what acts is "
            f"{_listed(element.acting)}"
        )
    words = element.limited_by
    for effect in EFFECT_NAMES:
        word, acts = words.get(effect), effect in element.acting
        if acts and word in {None, "not-perceptible"}:
            yield f"{name}: {effect} acts, limited_by says {word or 'nothing'} of it"
        if not acts and word not in {None, "not-perceptible"}:
            yield f"{name}: {effect} does not act, limited_by says {word} of it"
    if not words:
        yield f"{name}: limited_by names no effect"


def _wrong_margins(design: Design, name: str) -> Iterator[str]:
    """Margins below those that were kept, beyond what is looked for, or with too many digits."""
    said, kept = design.elements[name].margins, design.margin
    if said.absolute_gain is not None and said.gain > said.absolute_gain:
        yield (
            f"{name}: margins.gain says {said.gain:.6g}, more than the {said.absolute_gain:.6g} "
            "that is proved of its clamps"
        )
    for claim, least, most, step in (
        ("gain", kept.gain - _STEP_OF_GAIN, _MOST_GAIN, _STEP_OF_GAIN),
        ("extra_delay_samples", float(kept.extra_delay_samples), _MOST_SAMPLES, _STEP_OF_DELAY),
    ):
        value: float = getattr(said, claim)
        if not least * (1 - _WHOLE) <= value <= most:
            yield (
                f"{name}: margins.{claim} says {value:.6g}, a profile with margin {kept.name} "
                f"states {least:.6g} to {most:.6g}"
            )
        elif abs(value / step - round(value / step)) > _WHOLE * max(1, value / step):
            yield f"{name}: margins.{claim} says {value:.12g}, which is no multiple of {step:g}"


def _wrong_play(name: str, element: ElementProfile) -> Iterator[str]:
    """A fade that is missing or has nothing to fade, a wall that would pull."""
    if element.fades and not SHORTEST_FADE <= element.fade_time <= LONGEST_FADE:
        yield (
            f"{name}: fade_time says {element.fade_time:g} s, an element with mass or a negative "
            f"effect fades over {SHORTEST_FADE:g} to {LONGEST_FADE:g} s. Tune again"
        )
    if element.fade_time and not element.fades:
        yield f"{name}: fade_time says {element.fade_time:g} s, but nothing in it fades"
    if element.one_sided and element.fades:
        yield f"{name}: one_sided pushes only, but a mass or a negative effect acts"


def _wrong_ripple(design: Design, name: str, setting: Setting | None) -> Iterator[str]:
    said = design.elements[name].ripple
    seen = None if setting is None else ripple_of(design, setting)
    alike = said is seen
    if said is not None and seen is not None:
        alike = abs(said - seen) <= _RIPPLE_AGREES * seen
    if not alike:
        yield f"{name}: ripple says {four_digits(said)}, computed anew it is {four_digits(seen)}"


def _wrong_passivity(design: Design, name: str, setting: Setting | None) -> Iterator[str]:
    """Less than what is so; that more is claimed is found with the certificate."""
    said = design.elements[name].margins.passive
    region = regions_of(design)[0]
    whole = whole_delay(region)
    if whole is None or said is True:
        if whole is None and said != "not-applicable":
            yield f"{name}: margins.passive says {said}, it is not-applicable to this device"
        return
    if said == "not-applicable":
        if whole_delay(region, _WELL_WHOLE) is not None:
            yield f"{name}: margins.passive says not-applicable, but it is known for this device"
        return
    needed = max(
        0.0 if setting is None else damping_for_passivity(setting, step, whole)
        for step in region.sample_time
    )
    if region.damping[0] > needed * (1 + _EDGE):
        yield f"{name}: margins.passive says False, but a damping of {needed:.6g} is enough"


def _wrong_limit(design: Design, name: str, effect: EffectName) -> Iterator[str]:
    """A limit that is said to bind, but leaves room for much more."""
    words = design.elements[name].limited_by
    word = words[effect]

    def exceeds(
        more: float, names: Iterable[str], effects: Iterable[EffectName], spare: float = 0.0
    ) -> bool:
        elements = {**design.elements}
        for each in names:
            sizes = {e: getattr(elements[each], e) * (1 + more) for e in effects}
            elements[each] = elements[each].model_copy(update=sizes)
        return _exceeds(design.model_copy(update={"elements": elements}), name, effect, spare)

    # What is stopped by the same limit in an element goes together: a proof of clamps that fails
    # takes all of the element back at once, and each alone may have room then. A margin is of a
    # whole combination: where a proof took some slack, each element alone may have more room than
    # all, and one that hardly moves the others' loop much more. Elements leave more room for the
    # proof of a wall than it needs once all have.
    if exceeds(_GROWN, [name], [effect]):
        return
    alike: list[EffectName] = [e for e, other in words.items() if word in {other, "saturation"}]
    gives_room = word == "saturation" and not design.elements[name].one_sided
    if exceeds(_ROOM if gives_room else _GROWN, [name], alike):
        return
    together = word in _SHARED and exceeds(_GROWN, design.elements, EFFECT_NAMES)
    if together and exceeds(1.0, [name], [effect], _SPARE):
        return
    yield (
        f"{name}: {effect} is said to be limited by {word}, which would allow "
        f"{_ROOM if gives_room else _GROWN:.0%} more of it"
    )


def _exceeds(design: Design, name: str, effect: EffectName, spare: float) -> bool:
    """Whether an element is beyond the limit that is said to bind one of its effects."""
    element = design.elements[name]
    word = element.limited_by[effect]
    if word == "rendering":
        setting = setting_of(design, (name,))
        return setting is not None and bool(
            excess_over_request(design, name, impedances(design, setting))
        )
    if word == "lead":
        if not (element.one_sided and element.stiffness):
            return False
        least, most = lead_of(design, name)
        return least < 0 or most > (element.lead or 0.0)
    every = clamped_combinations(design) if word == "saturation" else design.combinations()
    if any(_breaks(design, each, word, spare) for each in every if name in each):
        return True
    device = design.device.simultaneous_box()
    lowest = {"mass": device.mass[0], "damping": device.damping[0]}.get(effect, 0.0)
    return word == "gain-margin" and -getattr(element, effect) * design.margin.gain > lowest > 0


def _breaks(design: Design, combination: tuple[str, ...], word: str, spare: float) -> bool:
    """Whether a combination breaks a limit, a proof, or a margin with this part of it to spare."""
    setting = setting_of(design, combination)
    if word == "force":
        return bool(force_failures(design, combination))
    if setting is None:
        return False
    if word == "saturation":
        seal = design.certificate if isinstance(design, SafeProfile) else None
        known = {} if seal is None else seal.absolute_stability or {}
        asked = {"gain": design.margin.gain}
        stated = {name: each.model_copy(update=asked) for name, each in known.items()}
        try:
            judge_switched(design, combination, regions_of(design), stated, _FEW_CELLS)
        except CheckFailedError:
            return True
        return False
    if word == "ripple":
        ripple = None if meets_wall(design, combination) else ripple_of(design, setting)
        return ripple is not None and ripple >= design.ripple_limit * (1 - _RIPPLE_AGREES)
    gain = (1.0 if word == "stability" else design.margin.gain) * (1 + spare)
    extra = float(design.margin.extra_delay_samples) if word == "delay-margin" else 0.0
    return any(
        found.verdict.answer != "stable"
        for region in regions_of(design)
        for found in worst_points(region, setting, [Claim(gain=gain, extra=extra)])
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _stated_failures(design: Design) -> Iterator[str]:
    """What a design says and would not say if it had been tuned; nothing is computed for it."""
    for fact in design.device.unstated():
        yield f"device.{fact} was stated by nobody. State it in the device and tune again"
    kept = MarginProfile.of(design.margin.name)
    names = "margin", f"the margin {kept.name}"
    yield from _differences(to_mapping(design.margin), to_mapping(kept), names)
    if design.together != groups_of(design.elements, design.together):
        yield "together names each set of elements once, in the order of the elements"
    if design.apart != groups_of(design.elements, design.apart):
        yield "apart names each pair of elements once, in the order of the elements"
    yield from _wrong_loop(design)
    if design.perception is None:
        yield "perception, in which steps are counted, is missing. Tune again"
    for name in design.elements:
        yield from inconsistent(design, name)
    skipped = skipped_parts(design)
    if design.skipped != skipped:
        said, seen = (", ".join(words)[:200] or "nothing" for words in (design.skipped, skipped))
        yield f"skipped says {said}, device and elements of the file skip {seen}"
    yield from _wrong_notes(design)
    yield from _wrong_methods(design)


def _wrong_loop(design: Design) -> Iterator[str]:
    """What the controller is told to run but the device is not said to do."""
    loop, device = design.loop, design.device
    for name, said, known in (
        ("sample_time", loop.sample_time, device.sample_time.value),
        ("extra_delay_samples", loop.extra_delay_samples * loop.sample_time, device.delay.value),
    ):
        if not abs(said - known) <= _AGREE * known:
            yield f"loop.{name} amounts to {said:.12g} s, the device has {known:.12g} s"
    used = loop.with_effects(
        damping=any(element.damping for element in design.elements.values()),
        mass=any(element.mass for element in design.elements.values()),
    )
    names = "loop", "the loop that the effects use"
    yield from _differences(to_mapping(loop), to_mapping(used), names)


def _wrong_notes(design: Design) -> Iterator[str]:
    """Notes are about effects that were dropped, one about each, or are less than was wanted."""
    dropped = [
        note_of_dropped(f"{name}.{effect}")
        for name, element in design.elements.items()
        for effect, word in element.limited_by.items()
        if word == "not-perceptible"
    ]
    for words in dropped:
        if sum(note.startswith(words) for note in design.notes) != 1:
            yield f"notes: one begins with '{words}'"
    begun = [
        note_of_unmet(f"{name}.{effect}")
        for name, element in design.elements.items()
        for effect, word in element.limited_by.items()
        if word not in {"not-perceptible", "wanted", "range"}
    ]
    less = [words for words in begun if any(note.startswith(words) for note in design.notes)]
    pairs = [pair for pair in design.apart if note_of_apart(pair) in design.notes]
    restless = _unsettled(design)
    if len(design.notes) != len(dropped) + len(less) + len(pairs) + len(restless):
        yield (
            f"notes: {len(design.notes)} of them, {len(dropped)} effects were dropped, {len(less)} "
            f"are less than was wanted, {len(restless)} less than rehearsed and {len(pairs)} pairs "
            "kept apart"
        )


def _wrong_methods(design: Design) -> Iterator[str]:
    """A method is named for the elements of each group in which something acts."""
    order = list(design.elements)
    for group in _connected(design):
        acts = any(design.elements[name].acting for name in group)
        name = ", ".join(sorted(group, key=order.index))
        if (name in design.method) != acts:
            yield f"method: {1 - acts:d} stated for {name[:80]}, not {acts:d}"
    if len(design.method) > len(_connected(design)):
        yield "method is stated for elements that are not tuned together"


def _connected(design: Design) -> list[set[str]]:
    """Elements that are tuned together, because groups join them; walls apart from others."""
    found: list[set[str]] = [{name} for name in design.elements]
    for group in design.together:
        for part in (set(group) & design.walls, set(group) - design.walls):
            if part:
                joined = set[str]().union(*(each for each in found if each & part))
                found = [*(each for each in found if not each & part), joined]
    return found
