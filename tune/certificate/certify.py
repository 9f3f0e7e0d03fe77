"""Certify a design over its whole box: every device, hand, delay, gain and moment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Literal

import numpy as np

from tune.certificate.absolute import clamped_moments, judge_levels, judge_switched
from tune.certificate.assumptions import assumptions, method, not_assessed, refuse_unbalanced
from tune.certificate.claims import (
    force_failures,
    meets_wall,
    passivity_failures,
    rendering_failures,
    ripple_failures,
)
from tune.certificate.region import Point, Region, Setting, regions_of, setting_of
from tune.certificate.worst_point import WorstCase, worst_points, worst_points_of_all
from tune.certificate.zero_exclusion import Claim, prove_all
from tune.documents import CheckFailedError
from tune.documents.certified import (
    AbsoluteStability,
    Certificate,
    ModeBox,
    ModePlace,
    WorstPoint,
)
from tune.documents.profile import Design

#: How much more the search does where a proof was not found.
_THOROUGH = 8
#: Cells looked at for one moment before it counts as not proved. With a fifth of margin to spare a
#: plain device takes a hundred, on the edge some thousands; a hand and modes take ten times more.
MOST_CELLS = 200_000
#: Samples of delay, margins included, that are looked at.
_LONGEST_DELAY = 64

_Moment = tuple[str, ...]


@dataclass(slots=True, kw_only=True)
class _MomentInRegion:
    """What became of one moment in one region."""

    moment: _Moment  # elements that are felt at once
    where: str  # the moment for people
    proved: bool = False  # stable throughout
    failures: list[str] = field(default_factory=list[str])  # sentences, none if proved
    unstable: list[WorstPoint] = field(default_factory=list[WorstPoint])  # points found
    worst: tuple[float, WorstCase] | None = None  # gain, and of the margin, where that is stable
    points: int = 0  # judged
    cells: int = 0  # looked at by the proof

    def refuse(self, gain: float, words: str, worst: WorstCase) -> None:
        """Keep a point that is not stable, and the sentence about it."""
        verdict = worst.verdict
        # Where the poles could not be isolated there is no radius to tell.
        if math.isfinite(verdict.radius):
            self.unstable.append(_place_of(self.moment, gain, worst.point, verdict.radius))
        self.failures.append(
            f"{self.where}: {words}: {verdict.answer} at {worst.point.words()}, gain "
            f"{gain:.6g}: {verdict.reason}"
        )


def _judge_moments(
    design: Design, played: Sequence[tuple[_Moment, Setting]], region: Region, most_cells: int
) -> list[_MomentInRegion]:
    """Search each moment for an unstable point; where none is found, prove that there is none."""
    named = [list(_claims(design, moment)) for moment, _ in played]
    asked = [
        (setting, [claim for claim, _ in claims])
        for (_, setting), claims in zip(played, named, strict=True)
    ]
    judged = [_MomentInRegion(moment=moment, where=region.words(moment)) for moment, _ in played]
    searched = worst_points_of_all(region, asked)
    for outcome, claims, found in zip(judged, named, searched, strict=True):
        for (claim, words), worst in zip(claims, found, strict=True):
            outcome.points += worst.judged
            if worst.verdict.answer != "stable":
                outcome.refuse(claim.gain, words, worst)
            elif words == "margin":
                outcome.worst = claim.gain, worst
    left = [number for number, outcome in enumerate(judged) if not outcome.failures]
    proofs = prove_all(region, [asked[number] for number in left], most_cells)
    for number, proof in zip(left, proofs, strict=True):
        outcome, (setting, claims) = judged[number], asked[number]
        outcome.cells, outcome.proved = proof.cells, proof.proved
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
    return judged


def _claims(design: Design, moment: tuple[str, ...]) -> Iterator[tuple[Claim, str]]:
    """The margin kept, and what the elements claim beyond it, each with its name."""
    margin = design.margin
    yield Claim(gain=margin.gain, extra=float(margin.extra_delay_samples)), "margin"
    claims = [design.elements[name].margins for name in moment]
    # A single element claims for every moment it is in; its strongest claim covers the others.
    gain = max(claim.gain for claim in claims)
    if gain > margin.gain:
        yield Claim(gain=gain, extra=0.0), "claimed gain margin"
    extra = max(claim.extra_delay_samples for claim in claims)
    if extra > margin.extra_delay_samples:
        yield Claim(gain=1.0, extra=float(extra)), "claimed delay margin"


def _place_of(moment: _Moment, gain: float, point: Point, radius: float) -> WorstPoint:
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


@dataclass(slots=True)
class _Findings:
    """What was found so far."""

    failures: list[str]
    unstable: list[WorstPoint] = field(default_factory=list[WorstPoint])
    worst: tuple[tuple[str, ...], float, WorstCase] | None = None
    absolute: dict[str, AbsoluteStability] = field(default_factory=dict[str, AbsoluteStability])
    points: int = 0
    cells: int = 0

    def add(self, outcome: _MomentInRegion) -> None:
        """What became of a moment in a region."""
        self.failures += outcome.failures
        self.unstable += outcome.unstable
        self.points += outcome.points
        self.cells += outcome.cells
        if outcome.worst is not None:
            gain, worst = outcome.worst
            if self.worst is None or worst.verdict.radius > self.worst[2].verdict.radius:
                self.worst = outcome.moment, gain, worst


def certify(
    design: Design,
    most_cells: int | None = None,
    witnesses: Mapping[str, AbsoluteStability] | None = None,
) -> Certificate:
    """Prove a design stable in its whole box, and look for a point that says otherwise.

    Cells are for one moment, fewer than MOST_CELLS where less would be asked for instead; witnesses
    are multipliers for the moments that are one-sided, a wrong one proves nothing. Raises
    CheckFailedError with every failure, each naming elements, point and reason.
    """
    refuse_unbalanced(design.device)
    regions = regions_of(design)
    bare = regions[0]
    extras = [element.margins.extra_delay_samples for element in design.elements.values()]
    extra = max(design.margin.extra_delay_samples, *extras, 0.0)
    longest = bare.delay[1] / bare.sample_time[0] + extra
    if longest > _LONGEST_DELAY:
        raise CheckFailedError(
            (f"delays up to {longest:.6g} samples are claimed, at most {_LONGEST_DELAY} judged",)
        )
    found = _Findings([])
    interior: dict[str, Literal["proved"]] = {}
    clamped = clamped_moments(design)
    played = [
        (moment, setting)
        for moment in design.moments()
        if (setting := setting_of(design, moment)) is not None
    ]
    most = most_cells or MOST_CELLS
    judged = [_judge_moments(design, played, region, most) for region in regions]
    for number, (moment, setting) in enumerate(played):
        found.failures += force_failures(design, moment)
        outcomes = [each[number] for each in judged]
        for each in outcomes:
            found.add(each)
        if not all(each.proved for each in outcomes):
            # Ripple, passivity and what is felt have no numbers where the loop may be unstable.
            continue
        try:
            found.cells += judge_levels(design, moment, regions, most)
            if moment in clamped:
                proved, cells = judge_switched(design, moment, regions, witnesses or {}, most_cells)
                found.absolute[" + ".join(moment)] = proved
                found.cells += cells
        except CheckFailedError as error:
            found.failures += error.failures
            continue
        interior[" + ".join(moment)] = "proved"
        if not meets_wall(design, moment):
            found.failures += ripple_failures(design, moment, setting)
        found.failures += passivity_failures(design, moment, setting, bare)
        if len(moment) == 1:
            found.failures += rendering_failures(design, moment[0], setting)
    if found.failures:
        raise CheckFailedError(tuple(found.failures), tuple(found.unstable))
    if found.worst is None:
        raise CheckFailedError(("the profile plays no effect at all",))
    return _certificate(design, found, interior)


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
        hand=hand,
        gain=design.margin.gain,
        extra_delay_samples=float(design.margin.extra_delay_samples),
        points=found.points,
        cells=found.cells,
        interior=interior,
        absolute_stability=found.absolute or None,
        worst=_place_of(moment, gain, worst.point, worst.verdict.radius),
        assumes=assumptions(design),
        not_assessed=not_assessed(design),
        versions={name: version(name) for name in ("haptune", "numpy", "python-flint")},
    )


def _samples(delay: float, step: float) -> float:
    """A delay in samples, to the digits that a quotient of printed numbers has."""
    return float(np.round(delay / step, 9))
