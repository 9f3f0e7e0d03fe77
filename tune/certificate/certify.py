"""Certify a design over its whole box, and say on which assumptions.

The box holds every device, hand, delay, gain and combination.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Literal

import numpy as np

from identification import Device
from tune.certificate.absolute import (
    clamped_combinations,
    judge_levels,
    judge_switched,
    outermost_of,
)
from tune.certificate.claims import (
    force_failures,
    meets_wall,
    passivity_failures,
    rendering_failures,
    ripple_failures,
)
from tune.certificate.region import Point, Region, Setting, regions_of, setting_of
from tune.certificate.worst_point import WorstCase, worst_points, worst_points_of_all
from tune.certificate.zero_exclusion import Claim, Proof, prove_all
from tune.documents import CheckFailedError
from tune.documents.profile import (
    AbsoluteStability,
    Certificate,
    Design,
    ModeBox,
    ModePlace,
    WorstPoint,
)
from tune.documents.scene import EFFECT_NAMES, UNITS, EffectName

#: How much more the search does where a proof was not found.
_THOROUGH = 8
#: Cells of one combination before it counts as not proved, and how many times as many for a mode.
#: With a fifth of margin to spare a plain device takes a hundred, on the edge some thousands.
MOST_CELLS, _OF_A_MODE = 200_000, 4
#: Samples of delay, margins included, that are looked at.
_LONGEST_DELAY = 64

_Combination = tuple[str, ...]
#: Claims of a combination, each with its name, the margin first.
_NamedClaims = list[tuple[Claim, str]]

_METHOD = (
    "no pole can cross the unit circle anywhere in the box: excluded by subdivision with "
    "first-order forms and bounds of the rest, over frequency and its aliases; poles at single "
    "points isolated in 400-bit balls; a search for the worst point found none that contradicts"
)
_ASSUMES = (
    "constant sample time within its interval; a missed period holds the force, is bridged by a "
    "straight line and counts as one extra sample of delay",
    "a linear loop: forces stay below the limit, the force of saturation is not relied on",
    "elements and gains change slowly against the loop; switching is not part of the proof",
    "the controller runs the very filters named, on every reading of the axis",
    "Coulomb friction gives no damping",
    "everything within its interval, in any combination, and constant while the loop runs",
)
#: What is said instead where some combinations are proved absolutely stable.
_LINEAR_ELSEWHERE = (
    "a linear loop, but for combinations with absolute_stability: forces stay below the limit, the "
    "force of saturation is not relied on"
)
_SLOW_ELSEWHERE = (
    "elements and gains change slowly against the loop; of combinations with absolute_stability "
    "clamps may push on one side only or cut at any level that falls, and damping may be switched, "
    "at any moment; a level rises, and a face or rest moves, only while its clamp gives no force"
)
_ASSUMES_WITH_WALLS = (_ASSUMES[0], _LINEAR_ELSEWHERE, _SLOW_ELSEWHERE, *_ASSUMES[3:])
#: Of designs in which something fades, or does beside a clamp that may be reached.
_FADES = (
    "elements with mass or a negative effect fade over fade_time: proved at every constant level "
    "of each; that no hand pumps by entering and leaving in time was looked for in waves of the "
    "level on the device alone, and is not proved"
)
_FADING_SPRINGS = (
    "elements whose spring fades with their mass are entered and left all the way: on a device "
    "that loses little, a hand that hovers between could pump it"
)
_NOT_CUT = (
    "levels of what fades stand still while a wall pushes; its force is not cut: where a wall is "
    "pushed so hard that the sum reaches the force limit, the hand is taken to hold it without "
    "swinging"
)
_MISSED = (
    "a period missed at a wall counts as one extra sample of delay for all of the contact; periods "
    "missed by chance were played, not proved"
)
_OPPOSITE = (
    "walls on opposite sides push one at a time; a swing to and fro between walls of unlike B/K is "
    "played, not proved"
)
_CURVE = (
    "friction that rises with speed is rehearsed as damping of its least and its largest slope, "
    "not as the curve"
)
_MULTIPLIER = (
    "; absolute stability by the stated multipliers, their condition shown in every cell of the box"
)
NO_HAND = "no hand: the device alone"
WITH_HAND = (
    "the device alone, and with any hand within the intervals: a mass, a damper and a spring to a "
    "place that rests"
)
_HELD = (
    "friction with a memory slides, or holds the device by a spring without loss of {:.6g} to "
    "{:.6g} {} beside it"
)
_RIGID = "a rigid mechanism: no vibration mode is stated"
_SPRUNG = (
    "the device's own force by position is proportional to it over all the travel, and acts on the "
    "rigid mass; no gravity"
)
_OF_AXES = (
    "one law, the same on every axis of {}, at poses of the envelope that do not move; faces of "
    "one wall leave a convex room, those of several walls are parallel; that a part of a sample of "
    "delay makes no direction worse than the box was looked at in 4 000 points, not proved"
)
_WITH_MODES = "no vibration modes but those stated"
_NO_LAG = "no lag of the current loop but what the delay holds"
_SLOPES = (
    "friction that rises with speed acts as some constant damping between its least and its "
    "largest slope"
)
_UNEVEN = "steps that vary in length: margins.jitter is assessed at corners of the box, not proved"
_NOT_ASSESSED = (
    _UNEVEN,
    "bounce on a one-sided wall, and sustained oscillation from quantiser and friction: the "
    "simulator's part",
)
_NOT_ASSESSED_OF_WALLS = (
    _UNEVEN,
    "sustained oscillation from quantiser and friction: the simulator's part",
    "clamps that rise under force; a grip that changes during contact",
)
_FACTS = "facts of the device as stated, which a log cannot show: {} motion, {}"
_LOG_UNITS = (
    "logs in SI units: force in {}, not volts or amperes (those need --force-gain, the torque "
    "constant and transmission), and position in {}; a unit changes no residual"
)
_ASSUMED = "of the device, what was only assumed: {}"
#: What to do about a device that its own force pushes away, or turns over.
_BALANCE = (
    "Counterbalance the axis, level it, take off the spring or magnet, or let the controller "
    "compensate the force; then log again, with the compensation running."
)


def trusted_facts(device: Device) -> tuple[str, ...]:
    """Facts that no log and no calculation can confirm, and who has to answer for them."""
    units = ("N", "m") if device.motion == "linear" else ("N m", "rad")
    facts = ["sample time", "delay"]
    facts += ["encoder resolution"] if device.encoder_resolution is not None else []
    facts += ["force limit"] if device.force_limit is not None else []
    assumed = [name.replace("_", " ") for name in device.assumed()]
    return (
        _FACTS.format(device.motion, ", ".join(facts)),
        *((_LOG_UNITS.format(*units),) if device.logs else ()),
        *((_ASSUMED.format(", ".join(assumed)),) if assumed else ()),
    )


def _assumptions(design: Design) -> tuple[str, ...]:
    """What the proof takes for granted."""
    device = design.device
    spring, unit = device.presliding_stiffness, UNITS[device.motion]["stiffness"]
    return (
        *(_ASSUMES if not _walls(design) else _ASSUMES_WITH_WALLS),
        *((_FADES,) if _fades(design) else ()),
        *((_FADING_SPRINGS,) if _fades(design, "stiffness") else ()),
        *((_NOT_CUT,) if _fades(design) and _walls(design) else ()),
        *((_MISSED,) if _walls(design) else ()),
        *((_OPPOSITE,) if len(design.walls) > 1 else ()),
        *trusted_facts(device),
        NO_HAND if design.hand is None else WITH_HAND,
        *(() if device.slope_at_zero == 0 else (_SPRUNG,)),
        *(() if device.axes is None else (_OF_AXES.format(", ".join(device.axes)),)),
        _WITH_MODES if device.modes else _RIGID,
        *(() if device.current_lag is not None else (_NO_LAG,)),
        *(() if device.damping_slope is None else (_SLOPES,)),
        *(() if spring is None else (_HELD.format(spring.low, spring.high, unit),)),
    )


def _not_assessed(design: Design) -> tuple[str, ...]:
    """What the proof leaves out."""
    # Friction that the logs show and no slope over speed covers.
    uncovered = (
        f"{force.words}, {force.share:.1%} of the force in {log.source}: the certified loop has "
        "none"
        for log in design.device.logs
        for force in log.unmodelled_forces
        if not force.rises
        and not (force.kind == "memory" and design.device.presliding_stiffness is not None)
    )
    return (
        *uncovered,
        *(_NOT_ASSESSED_OF_WALLS if _walls(design) else _NOT_ASSESSED),
        *(() if design.device.damping_slope is None else (_CURVE,)),
    )


def _walls(design: Design) -> bool:
    """Whether some combination is proved absolutely stable."""
    return any(
        element.one_sided or (element.stiffness and element.motion.penetration is None)
        for element in design.elements.values()
    )


def _fades(design: Design, effect: EffectName | None = None) -> bool:
    """Whether some element fades, one with an effect if that is named."""
    return any(
        element.fades and (effect is None or getattr(element, effect))
        for element in design.elements.values()
    )


def skipped_parts(design: Design) -> tuple[str, ...]:
    """What was not asked for, or is not known, and nothing was spent on."""
    device, loop = design.device, design.loop
    wished = {effect for element in design.elements.values() for effect in element.limited_by}
    parts = (
        *((effect, effect not in wished) for effect in EFFECT_NAMES),
        ("velocity filter", loop.velocity_filter_hz is None),
        ("acceleration filter", loop.acceleration_filter_hz is None),
        ("ripple: the encoder resolution is not known", device.encoder_resolution is None),
        ("force: the force limit is not known", device.force_limit is None),
        ("hand", design.hand is None),
        ("modes", not device.modes),
    )
    return tuple(words for words, skipped in parts if skipped)


def note_of_apart(pair: tuple[str, ...]) -> str:
    """The note about two elements that the scene did not tell apart."""
    return (
        f"kept apart: {' and '.join(pair)} are proved only with less of each, if at all (together: "
        "asks for that); the guard gives no force where both are asked for"
    )


def note_of_dropped(label: str) -> str:
    """How the note about an effect that is left out begins, by its label element.effect."""
    return f"{label} dropped: "


def note_of_unmet(label: str) -> str:
    """How the note about a wanted value of which less is played begins, by its label."""
    return f"{label}: "


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why no effect on a device can be certified: what was seen, what is needed, what to do."""

    seen: str
    needed: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.seen}; needed: {self.needed}. {self.remedy}"


def refusal_of(device: Device, *, held: bool = False) -> Refusal | None:
    """Why no effect on a device, ``held`` by a hand or not, can be certified; None if some can."""
    if held and device.axes is not None:
        return Refusal(
            seen=f"a hand holds a device of {len(device.axes)} axes",
            needed="no hand, which is proved beside a device of one axis only",
            remedy="Leave the scene's 'hand' out: the device alone is what is proved.",
        )
    # Every gain in (0, g] is to be stable, and so the device at next to none. One that its own
    # force pushes away from where it is, anywhere in its box or on its travel, runs away by itself.
    low, high = device.simultaneous_box().position_stiffness
    unit = UNITS[device.motion]["stiffness"]
    if device.gravity is not None and any(
        side
        for part in (device.gravity.sine, device.gravity.cosine)
        for side in (part.low, part.high)
    ):
        return Refusal(
            seen=f"gravity: the slope of the device's own force runs from {low:.4g} to {high:.4g} "
            f"{unit} as the axis turns; "
            + (
                "where it is negative the device falls by itself, beside any effect that is weak"
                if low < 0
                else "what is proved holds for a slope that does not change"
            ),
            needed="no gravity",
            remedy=_BALANCE,
        )
    if low > 0 or low == high == 0:
        return None
    return Refusal(
        seen=f"position_stiffness: {low:.4g} to {high:.4g} {unit} over the box of the device; "
        "where it is not positive nothing brings the device back, and it runs away by itself "
        "beside any effect that is weak",
        needed=f"above 0 {unit} throughout, or none",
        remedy=_BALANCE + (" A log of more travel narrows the interval." if high > 0 else ""),
    )


def refuse_unbalanced(device: Device, *, held: bool = False) -> None:
    """Raise CheckFailedError where `refusal_of` a device has a reason."""
    refusal = refusal_of(device, held=held)
    if refusal is not None:
        raise CheckFailedError((f"device: {refusal}",))


@dataclass(slots=True, kw_only=True)
class _CombinationInRegion:
    """What became of one combination in one region."""

    combination: _Combination  # elements that are felt at once
    where: str  # the combination for people
    proved: bool = False  # stable throughout
    failures: list[str] = field(default_factory=list[str])  # sentences, none if proved
    unstable: list[WorstPoint] = field(default_factory=list[WorstPoint])  # points found
    worst: tuple[float, WorstCase] | None = None  # gain, and of the margin, where that is stable
    points: int = 0  # judged
    cells: int = 0  # looked at by the proof
    spent: bool = False  # that were all it had

    def refuse(self, gain: float, words: str, worst: WorstCase) -> None:
        """Keep a point that is not stable, and the sentence about it."""
        verdict = worst.verdict
        # Where the poles could not be isolated there is no radius to tell.
        if math.isfinite(verdict.radius):
            self.unstable.append(_place_of(self.combination, gain, worst.point, verdict.radius))
        self.failures.append(
            f"{self.where}: {words}: {verdict.answer} at {worst.point.words()}, gain "
            f"{gain:.6g}: {verdict.reason}"
        )


def _judge_combinations(
    design: Design,
    played: Sequence[tuple[_Combination, Setting]],
    region: Region,
    most_cells: int,
    clamped: Mapping[_Combination, AbsoluteStability],
    covered: Collection[_Combination],
) -> list[_CombinationInRegion]:
    """Search combinations for an unstable point; where none is found, prove that there is none."""

    # What the clamps of a combination are to be proved for says it of the linear loop too, so that
    # is not proved here, nor looked at where the proof is of another combination that covers it.
    def beyond(names: _Combination, claims: _NamedClaims) -> _NamedClaims:
        """What clamps are not to be proved for."""
        known = clamped.get(names)
        return [each for each in claims if known is None or _exceeds(each[0], known)]

    rays = [_ray_of(setting) for _, setting in played]
    all_claims = [(names, list(_claims(design, names))) for names, _ in played]
    named = _outermost(
        [beyond(names, each) if names in covered else each for names, each in all_claims], rays
    )
    asked = [
        (setting, [claim for claim, _ in claims])
        for (_, setting), claims in zip(played, named, strict=True)
    ]
    judged = [
        _CombinationInRegion(combination=names, where=region.words(names)) for names, _ in played
    ]
    searched = worst_points_of_all(region, asked)
    for outcome, claims, found in zip(judged, named, searched, strict=True):
        for (claim, words), worst in zip(claims, found, strict=True):
            outcome.points += worst.judged
            if worst.verdict.answer != "stable":
                outcome.refuse(claim.gain, words, worst)
            elif words == "margin":
                outcome.worst = claim.gain, worst
    left = [n for n, outcome in enumerate(judged) if named[n] and not outcome.failures]
    open_ = {n: rest for n in left if (rest := beyond(played[n][0], named[n]))}
    to_prove = [(asked[n][0], [claim for claim, _ in rest]) for n, rest in open_.items()]
    proofs = dict(zip(open_, prove_all(region, to_prove, most_cells), strict=True))
    for number in left:
        outcome, (setting, claims) = judged[number], asked[number]
        proof = proofs.get(number, Proof(proved=True, cells=0))
        outcome.cells, outcome.proved, outcome.spent = proof.cells, proof.proved, proof.spent
        if proof.proved:
            continue
        doubted = worst_points(region, setting, claims, proof.doubt, thorough=_THOROUGH)
        for (claim, words), worst in zip(named[number], doubted, strict=True):
            if worst.verdict.answer != "stable":
                outcome.refuse(claim.gain, words, worst)
                break
        else:
            worst = searched[number][0]
            outcome.failures.append(
                f"{outcome.where}: not proved for every device of the box within {proof.cells} "
                "cells; nothing unstable was found, worst is a pole radius of "
                f"{worst.verdict.radius:.9g} at {worst.point.words()}, gain {claims[0].gain:.6g}. "
                "Ask for less, or narrow the intervals of the device"
            )
    short = {rays[n][0] for n, outcome in enumerate(judged) if named[n] and not outcome.proved}
    for outcome, (ray, _) in zip(judged, rays, strict=True):
        outcome.proved = ray not in short
    return judged


def _exceeds(claim: Claim, known: AbsoluteStability) -> bool:
    return claim.gain > known.gain or claim.extra > known.extra_delay_samples


def _ray_of(setting: Setting) -> tuple[tuple[float, ...], float]:
    """What a setting shares with its smaller and larger gains, and its own gain along that."""
    # To the last digit those are settings of one effect, or equal ones.
    if sum(map(bool, setting.sizes)) > 1:
        return setting.sizes, 1.0
    size = sum(setting.sizes)
    return tuple(np.sign(setting.sizes).tolist()), abs(size)


def _outermost(
    named: Sequence[_NamedClaims], rays: Sequence[tuple[tuple[float, ...], float]]
) -> list[_NamedClaims]:
    """Of the claims of each combination those that no other on its ray covers."""
    # A claim is of every smaller gain and shorter delay too. The margin of the largest setting of a
    # ray is kept, so that its worst point is told.
    order = [
        ((ray, -own * claim.gain, -claim.extra), -own, number, place)
        for number, (claims, (ray, own)) in enumerate(zip(named, rays, strict=True))
        for place, (claim, _) in enumerate(claims)
    ]
    by_size = sorted(range(len(rays)), key=lambda number: rays[number][1])
    kept = {(number, 0) for number in {rays[number][0]: number for number in by_size}.values()}
    longest: dict[tuple[float, ...], float] = {}
    for (ray, _, late), _, number, place in sorted(order):
        if -late > longest.get(ray, -1.0):
            kept.add((number, place))
            longest[ray] = -late
    return [
        [each for place, each in enumerate(claims) if (number, place) in kept]
        for number, claims in enumerate(named)
    ]


def _claims(design: Design, combination: tuple[str, ...]) -> Iterator[tuple[Claim, str]]:
    """The margin kept, and what the elements claim beyond it, each with its name."""
    margin = design.margin
    yield Claim(gain=margin.gain, extra=float(margin.extra_delay_samples)), "margin"
    claims = [design.elements[name].margins for name in combination]
    # A single element claims for every combination it is in; its strongest claim covers the others.
    gain = max(claim.gain for claim in claims)
    if gain > margin.gain:
        yield Claim(gain=gain, extra=0.0), "claimed gain margin"
    extra = max(claim.extra_delay_samples for claim in claims)
    if extra > margin.extra_delay_samples:
        yield Claim(gain=1.0, extra=float(extra)), "claimed delay margin"


def _place_of(combination: _Combination, gain: float, point: Point, radius: float) -> WorstPoint:
    return WorstPoint(
        elements=combination,
        mass=point.mass,
        damping=point.damping,
        sample_time=point.sample_time,
        delay_samples=point.delay_samples,
        modes=tuple(
            ModePlace(frequency_hz=mode.frequency_hz, damping_ratio=mode.damping_ratio)
            for mode in point.modes
        ),
        current_lag=point.current_lag or None,
        position_stiffness=point.position_stiffness or None,
        hand=point.hand,
        gain=gain,
        pole_radius=radius,
    )


def certify(
    design: Design,
    most_cells: int | None = None,
    witnesses: Mapping[str, AbsoluteStability] | None = None,
) -> Certificate:
    """Prove a design stable in its whole box, and look for a point that says otherwise.

    Cells are for one combination, fewer than MOST_CELLS where less would be asked for instead;
    witnesses are multipliers for one-sided combinations, a wrong one proves nothing. The first of
    elements that are alike stands for all. Raises CheckFailedError with elements, point and reason.
    """
    design = design.one_of_each()
    refuse_unbalanced(design.device, held=design.hand is not None)
    regions = regions_of(design)
    extras = [element.margins.extra_delay_samples for element in design.elements.values()]
    extra = max(design.margin.extra_delay_samples, *extras, 0.0)
    longest = regions[0].delay[1] / regions[0].sample_time[0] + extra
    if longest > _LONGEST_DELAY:
        raise CheckFailedError(
            (f"delays up to {longest:.6g} samples are claimed, at most {_LONGEST_DELAY} judged",)
        )
    failures: list[str] = []
    absolute: dict[str, AbsoluteStability] = {}
    interior: dict[str, Literal["proved"]] = {}
    stated = witnesses or {}
    outermost = outermost_of(design, clamped_combinations(design), stated)
    played = [
        (combination, setting)
        for combination in design.combinations()
        if (setting := setting_of(design, combination)) is not None
    ]
    modes = len(design.device.modes)
    most = (most_cells or MOST_CELLS) * (1 + _OF_A_MODE * modes)
    covered = {names for names, other in outermost.items() if other != names}
    clamped = {names: stated[key] for names in outermost if (key := " + ".join(names)) in stated}
    judged = [
        _judge_combinations(design, played, region, most, clamped, covered) for region in regions
    ]
    outcomes, cells, spent = list(zip(*judged, strict=True)), 0, False
    every = [each for found in outcomes for each in found]
    in_vain = most_cells is not None and not all(each.proved for each in every)
    for (combination, setting), found in zip(played, outcomes, strict=True):
        failures += force_failures(design, combination)
        failures += [words for each in found for words in each.failures]
        if in_vain or not all(each.proved for each in found):
            # What may be unstable has no ripple; where less is asked for next no clamp is proved.
            continue
        try:
            cells += judge_levels(design, combination, regions, most)
            if combination in outermost:
                proved, seen = judge_switched(
                    design, combination, regions, stated, most_cells, covered=combination in covered
                )
                absolute[" + ".join(combination)] = proved
                cells += seen
        except CheckFailedError as error:
            failures += error.failures
            spent |= error.spent
            continue
        interior[" + ".join(combination)] = "proved"
        if not meets_wall(design, combination):
            failures += ripple_failures(design, combination, setting)
        failures += passivity_failures(design, combination, setting, regions[0])
        if len(combination) == 1:
            failures += rendering_failures(design, combination[0], setting)
    if failures:
        points = tuple(point for each in every for point in each.unstable)
        unproved = tuple(names for names, _ in played if " + ".join(names) not in interior)
        spent |= most_cells is None and any(each.spent for each in every)
        raise CheckFailedError(tuple(failures), points, unproved, spent=spent and modes > 0)
    if not every:
        raise CheckFailedError(("the profile plays no effect at all",))
    return _certificate(design, every, cells, absolute, interior)


def _certificate(
    design: Design,
    every: Sequence[_CombinationInRegion],
    cells: int,
    absolute: dict[str, AbsoluteStability],
    interior: dict[str, Literal["proved"]],
) -> Certificate:
    """From what became of each combination in each region, and the further cells proved."""
    combination, gain, worst = max(
        ((each.combination, *each.worst) for each in every if each.worst is not None),
        key=lambda found: found[2].verdict.radius,
    )
    regions = regions_of(design)
    region, hand = regions[0], regions[-1].hand
    held = None if design.device.presliding_stiffness is None else regions[1].position_stiffness
    return Certificate(
        method=_METHOD + (_MULTIPLIER if _walls(design) else ""),
        confidence=0.999,
        mass=region.mass,
        damping=region.damping,
        sample_time=region.sample_time,
        delay=region.delay,
        delay_samples=(
            _samples(region.delay[0], region.sample_time[1]),
            _samples(region.delay[1], region.sample_time[0]),
        ),
        modes=tuple(
            ModeBox(frequency_hz=mode.frequency_hz, damping_ratio=mode.damping_ratio)
            for mode in region.modes
        ),
        current_lag=None if design.device.current_lag is None else region.current_lag,
        position_stiffness=region.position_stiffness if any(region.position_stiffness) else None,
        presliding_stiffness=held,
        hand=hand,
        gain=design.margin.gain,
        extra_delay_samples=float(design.margin.extra_delay_samples),
        points=sum(each.points for each in every),
        cells=cells + sum(each.cells for each in every),
        interior=interior,
        absolute_stability=absolute or None,
        worst=_place_of(combination, gain, worst.point, worst.verdict.radius),
        assumes=_assumptions(design),
        not_assessed=_not_assessed(design),
        versions={name: version(name) for name in ("haptune", "numpy", "python-flint")},
    )


def _samples(delay: float, step: float) -> float:
    """A delay in samples, to the digits that a quotient of printed numbers has."""
    return float(np.round(delay / step, 9))
