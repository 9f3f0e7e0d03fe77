"""Certify a design over its whole box: every device, hand, delay, gain and moment.

One file: the steps of one certificate, in their order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Literal

import numpy as np

from tune.certificate.assumptions import assumptions, method, not_assessed
from tune.certificate.bounds import force_failures, passivity_failures, ripple_failures
from tune.certificate.fade_levels import judge_levels
from tune.certificate.point import Point, Setting, setting_of
from tune.certificate.refusal import refuse_unbalanced
from tune.certificate.region import Region, regions_of
from tune.certificate.rendered import rendering_failures
from tune.certificate.worst_point import WorstCase, worst_points
from tune.certificate.zero_exclusion import Claim, prove
from tune.documents.certified import (
    AbsoluteStability,
    Certificate,
    HandBox,
    ModeBox,
    ModePlace,
    WorstPoint,
)
from tune.documents.errors import CheckFailedError
from tune.documents.profile import Design

#: Cells looked at for one moment before it counts as not proved. With a fifth of margin to spare a
#: plain device takes a hundred, on the edge some thousands; a hand and modes take ten times more.
MOST_CELLS = 200_000
#: Samples of delay, margins included, that are looked at.
_LONGEST_DELAY = 64
#: How much more the search does where a proof was not found.
_THOROUGH = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class _Named:
    """A claim and what it is called."""

    claim: Claim
    words: str


@dataclass(slots=True)
class _Findings:
    """What was found so far."""

    failures: list[str]
    unstable: list[WorstPoint] = field(default_factory=list[WorstPoint])
    worst: tuple[tuple[str, ...], float, WorstCase] | None = None
    absolute: dict[str, AbsoluteStability] = field(default_factory=dict[str, AbsoluteStability])
    points: int = 0
    cells: int = 0


def certify(
    design: Design,
    most_cells: int | None = None,
    witnesses: Mapping[str, AbsoluteStability] | None = None,
) -> Certificate:
    """Prove a design stable in its whole box, and look for a point that says otherwise.

    Args:
        design: uncertified.
        most_cells: for one moment, fewer than MOST_CELLS where less would be asked for instead.
        witnesses: multipliers for the moments that are one-sided; a wrong one proves nothing.

    Raises:
        CheckFailedError: with every failure, each naming elements, point and reason.
    """
    refuse_unbalanced(design.device)
    regions = regions_of(design)
    bare = regions[0]
    longest = _longest(design, bare)
    if longest > _LONGEST_DELAY:
        raise CheckFailedError(
            (f"delays up to {longest:.6g} samples are claimed, at most {_LONGEST_DELAY} judged",)
        )
    found = _Findings([])
    interior: dict[str, Literal["proved"]] = {}
    for moment in design.moments():
        setting = setting_of(design, moment)
        if setting is None:
            continue
        found.failures += force_failures(design, moment)
        proved = [
            _judge(design, moment, setting, region, found, most_cells or MOST_CELLS)
            for region in regions
        ]
        if not all(proved):
            # Ripple, passivity and what is felt have no numbers where the loop may be unstable.
            continue
        cells, failure = judge_levels(design, moment, regions, most_cells or MOST_CELLS)
        found.cells += cells
        if failure is not None:
            found.failures.append(failure)
            continue
        if any(design.elements[name].one_sided or design.elements[name].cut for name in moment):
            from tune.certificate.switched import judge_switched

            outcome = judge_switched(
                design, moment, setting, regions, witnesses or {}, most_cells or MOST_CELLS
            )
            found.cells += outcome.cells
            if outcome.proved is None:
                found.failures.append(outcome.failure or "")
                continue
            found.absolute[" + ".join(moment)] = outcome.proved
        interior[" + ".join(moment)] = "proved"
        found.failures += ripple_failures(design, moment, setting)
        found.failures += passivity_failures(design, moment, setting, bare)
        if len(moment) == 1:
            found.failures += rendering_failures(design, moment[0], setting)
    if found.failures:
        raise CheckFailedError(tuple(found.failures), tuple(found.unstable))
    if found.worst is None:
        raise CheckFailedError(("the profile plays no effect at all",))
    return _certificate(design, found, interior)


def _longest(design: Design, region: Region) -> float:
    extras = [element.margins.extra_delay_samples for element in design.elements.values()]
    extra = max(design.margin.extra_delay_samples, *extras, 0.0)
    return region.delay[1] / region.sample_time[0] + extra


def _claims(design: Design, moment: tuple[str, ...]) -> Iterator[_Named]:
    """The margin kept, and what the elements claim beyond it."""
    margin = design.margin
    yield _Named(
        claim=Claim(gain=margin.gain, extra=float(margin.extra_delay_samples)), words="margin"
    )
    claims = [design.elements[name].margins for name in moment]
    # A single element claims for every moment it is in; its strongest claim covers the others.
    gain = max(claim.gain for claim in claims)
    if gain > margin.gain:
        yield _Named(claim=Claim(gain=gain, extra=0.0), words="claimed gain margin")
    extra = max(claim.extra_delay_samples for claim in claims)
    if extra > margin.extra_delay_samples:
        yield _Named(claim=Claim(gain=1.0, extra=float(extra)), words="claimed delay margin")


def _judge(
    design: Design,
    moment: tuple[str, ...],
    setting: Setting,
    region: Region,
    found: _Findings,
    most_cells: int,
) -> bool:
    """Search for an unstable point; where none is found, prove that there is none: True."""
    where = " + ".join(moment) + (" in a hand" if region.hand is not None else "")
    named = list(_claims(design, moment))
    unstable = False
    searched = worst_points(region, setting, [each.claim for each in named])
    for each, worst in zip(named, searched, strict=True):
        found.points += worst.judged
        if worst.verdict.answer != "stable":
            unstable = True
            _refuse(found, moment, where, each, worst)
        elif each.words == "margin" and (
            found.worst is None or worst.verdict.radius > found.worst[2].verdict.radius
        ):
            found.worst = (moment, each.claim.gain, worst)
    if unstable:
        return False
    proof = prove(region, setting, [each.claim for each in named], most_cells)
    found.cells += proof.cells
    if proof.proved:
        return True
    assert proof.doubt is not None
    doubted = worst_points(
        region, setting, [each.claim for each in named], proof.doubt, thorough=_THOROUGH
    )
    for each, worst in zip(named, doubted, strict=True):
        if worst.verdict.answer != "stable":
            _refuse(found, moment, where, each, worst)
            return False
    worst = searched[0]
    found.failures.append(
        f"{where}: not proved for every device of the box within {proof.cells} cells; nothing "
        f"unstable was found, worst is a pole radius of {worst.verdict.radius:.9g} at "
        f"{worst.point.words()}, gain {named[0].claim.gain:.6g}. Ask for less, or narrow the "
        "intervals of the device"
    )
    return False


def _refuse(
    found: _Findings, moment: tuple[str, ...], where: str, each: _Named, worst: WorstCase
) -> None:
    """Keep a point that is not stable, and the sentence about it."""
    gain, verdict = each.claim.gain, worst.verdict
    # Where the poles could not be isolated there is no radius to tell.
    if math.isfinite(verdict.radius):
        found.unstable.append(_place(moment, gain, worst.point, verdict.radius))
    found.failures.append(
        f"{where}: {each.words}: {verdict.answer} at {worst.point.words()}, gain {gain:.6g}: "
        f"{verdict.reason}"
    )


def _certificate(
    design: Design, found: _Findings, interior: dict[str, Literal["proved"]]
) -> Certificate:
    assert found.worst is not None
    moment, gain, worst = found.worst
    regions = regions_of(design)
    region, hand = regions[0], regions[-1].hand
    held = None if design.device.presliding_stiffness is None else regions[1].position_stiffness
    return Certificate(
        method=method(design),
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
        hand=hand and HandBox(mass=hand.mass, damping=hand.damping, stiffness=hand.stiffness),
        gain=design.margin.gain,
        extra_delay_samples=float(design.margin.extra_delay_samples),
        points=found.points,
        cells=found.cells,
        interior=interior,
        absolute_stability=found.absolute or None,
        worst=_place(moment, gain, worst.point, worst.verdict.radius),
        assumes=assumptions(design),
        not_assessed=not_assessed(design),
        versions={name: version(name) for name in ("haptune", "numpy", "python-flint")},
    )


def _samples(delay: float, step: float) -> float:
    """A delay in samples, to the digits that a quotient of printed numbers has."""
    return float(np.round(delay / step, 9))


def _place(moment: tuple[str, ...], gain: float, point: Point, radius: float) -> WorstPoint:
    return WorstPoint(
        elements=moment,
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
