"""What a profile says of each element beside forces and stability, against what would be said."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from tune.certificate.bounds import force_failures, meets_wall, ripple_of, whole_delay
from tune.certificate.branch_and_bound import Claim
from tune.certificate.contact import contact_failures, lead_of
from tune.certificate.jitter import jitter_failures
from tune.certificate.passivity import damping_for_passivity
from tune.certificate.point import Setting, setting_of
from tune.certificate.region import regions_of
from tune.certificate.rendered import excess_over_request
from tune.certificate.switched import clamped_moments, judge_switched
from tune.certificate.worst_point import worst_points
from tune.documents.effects import EFFECT_NAMES, LONGEST_FADE, SHORTEST_FADE, EffectName
from tune.documents.errors import CheckFailedError
from tune.documents.profile import Design, ElementProfile, SafeProfile

#: Margins are looked for up to so much gain and so many samples, and stated in such steps.
_MOST_GAIN, _MOST_SAMPLES = 1000.0, 10.0
_STEP_OF_GAIN, _STEP_OF_DELAY = 1e-3, 0.1
#: Parts of a step within which a number is one of its multiples.
_WHOLE = 1e-6
#: A stated ripple has four digits.
_AGREE = 1e-3
#: Parts of a sample within which every reader takes a delay for whole.
_WELL_WHOLE = 5e-10
#: Passivity this close to its edge may be told either way.
_EDGE = 1e-6
#: What else may stop a wanted value.
_STOPPED = frozenset(
    {"stability", "gain-margin", "delay-margin", "saturation", "lead", "force", "ripple"}
)
#: A limit that is named is met where the effect is larger by this part: how closely limits are met
#: is the tuner's affair, that another one is named is found out.
_GROWN = 0.1
#: Cells in which a proof that is easy is found.
_FEW_CELLS = 20_000


def inconsistent(design: Design, name: str) -> Iterator[str]:
    """What one element states that nothing has to be computed for to refuse."""
    element = design.elements[name]
    yield from _wrong_keys(name, element)
    yield from _wrong_margins(design, name)
    yield from _wrong_play(name, element)
    felt = element.rendered
    if felt is None:
        yield f"{name}: rendered is missing. Tune again"
    elif not _acting(element) and any(
        (felt.mass, felt.damping, *felt.mass_at_ends, *felt.damping_at_ends)
    ):
        yield f"{name}: rendered says that something is felt, but no effect acts"


def element_failures(design: Design, name: str) -> Iterator[str]:
    """What one element of a certified design states and a calculation does not confirm."""
    setting = setting_of(design, (name,))
    yield from _wrong_ripple(design, name, setting)
    yield from _wrong_passivity(design, name, setting)
    yield from contact_failures(design, name)
    yield from jitter_failures(design, name)
    element = design.elements[name]
    for effect, word in element.limited_by.items():
        if word not in {"wanted", "range"} and getattr(element, effect):
            yield from _wrong_limit(design, name, effect)


def _acting(element: ElementProfile) -> set[EffectName]:
    return {effect for effect in EFFECT_NAMES if getattr(element, effect)}


def _wrong_keys(name: str, element: ElementProfile) -> Iterator[str]:
    """Effects that are named and do not act, or act and are not named."""
    acting = _acting(element)
    if set(element.perceived_steps) != acting:
        yield (
            f"{name}: perceived_steps has {_listed(element.perceived_steps)}, what acts is "
            f"{_listed(acting)}"
        )
    words = element.limited_by
    for effect in EFFECT_NAMES:
        word, acts = words.get(effect), effect in acting
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
    for claim, value, least, most, step in (
        ("gain", said.gain, kept.gain - _STEP_OF_GAIN, _MOST_GAIN, _STEP_OF_GAIN),
        (
            "extra_delay_samples",
            said.extra_delay_samples,
            float(kept.extra_delay_samples),
            _MOST_SAMPLES,
            _STEP_OF_DELAY,
        ),
    ):
        if not least * (1 - _WHOLE) <= value <= most:
            yield (
                f"{name}: margins.{claim} says {value:.6g}, a profile with margin {kept.name} "
                f"states {least:.6g} to {most:.6g}"
            )
        elif abs(value / step - round(value / step)) > _WHOLE * max(1, value / step):
            yield f"{name}: margins.{claim} says {value:.12g}, which is no multiple of {step:g}"


def _wrong_play(name: str, element: ElementProfile) -> Iterator[str]:
    """A fade that is missing or has nothing to fade, and a wall that would pull.

    An element that is played as commanded was wanted effect by effect.
    """
    words = {word for word in element.limited_by.values() if word != "not-perceptible"}
    if element.as_commanded and not words <= {"wanted", *_STOPPED}:
        yield f"{name}: as_commanded is said of an element that is limited by {_listed(words)}"
    if not element.as_commanded and words == {"wanted"}:
        yield f"{name}: every effect is as wanted, and as_commanded says it is not"
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
    if said is None or seen is None:
        if said is not seen:
            yield f"{name}: ripple says {_number(said)}, computed anew it is {_number(seen)}"
    elif not abs(said - seen) <= _AGREE * seen:
        yield f"{name}: ripple says {_number(said)}, computed anew it is {_number(seen)}"


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
    element = design.elements[name]
    word = element.limited_by[effect]
    larger = element.model_copy(update={effect: getattr(element, effect) * (1 + _GROWN)})
    grown = design.model_copy(update={"elements": {**design.elements, name: larger}})
    if word == "rendering":
        setting = setting_of(grown, (name,))
        if setting is not None and excess_over_request(grown, name, setting):
            return
    elif word == "lead":
        least, most = lead_of(grown, name)
        if element.one_sided and (least < 0 or most > (element.lead or 0.0)):
            return
    else:
        every = clamped_moments(grown) if word == "saturation" else design.moments()
        if any(_breaks(grown, moment, word) for moment in every if name in moment):
            return
        device = design.device.simultaneous_box()
        lowest = {"mass": device.mass[0], "damping": device.damping[0]}.get(effect, 0.0)
        if word == "gain-margin" and -getattr(larger, effect) * design.margin.gain > lowest > 0:
            return
    yield (
        f"{name}: {effect} is said to be limited by {word}, which would allow "
        f"{_GROWN:.0%} more of it"
    )


def _breaks(design: Design, moment: tuple[str, ...], word: str) -> bool:
    """Whether a moment breaks a limit on force or ripple, a stability margin or the proof of it."""
    setting = setting_of(design, moment)
    if word == "force":
        return bool(force_failures(design, moment))
    if setting is None:
        return False
    if word == "saturation":
        seal = design.certificate if isinstance(design, SafeProfile) else None
        asked = {"gain": design.margin.gain}
        known = {} if seal is None else seal.absolute_stability or {}
        stated = {name: each.model_copy(update=asked) for name, each in known.items()}
        try:
            judge_switched(design, moment, regions_of(design), stated, _FEW_CELLS)
        except CheckFailedError:
            return True
        return False
    if word == "ripple":
        ripple = None if meets_wall(design, moment) else ripple_of(design, setting)
        return ripple is not None and ripple >= design.ripple_limit * (1 - _AGREE)
    margin = design.margin
    claims = {
        "stability": Claim(gain=1.0, extra=0.0),
        "gain-margin": Claim(gain=margin.gain, extra=0.0),
        "delay-margin": Claim(gain=margin.gain, extra=float(margin.extra_delay_samples)),
    }
    return any(
        found.verdict.answer != "stable"
        for region in regions_of(design)
        for found in worst_points(region, setting, [claims[word]])
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _number(value: float | None) -> str:
    return "nothing" if value is None else f"{value:.4g}"
