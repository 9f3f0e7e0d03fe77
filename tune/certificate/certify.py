"""Certify a design over its whole box: every device, hand, delay, gain and moment.

One file: the steps of one certificate, in their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Literal

import numpy as np

from tune.certificate.assumptions import assumptions, method, not_assessed
from tune.certificate.bounds import (
    force_failures,
    meets_wall,
    passivity_failures,
    ripple_failures,
)
from tune.certificate.moments import MomentInRegion, judge_moments, place_of
from tune.certificate.point import setting_of
from tune.certificate.refusal import refuse_unbalanced
from tune.certificate.region import Region, regions_of
from tune.certificate.rendered import rendering_failures
from tune.certificate.switched import clamped_moments, judge_levels, judge_switched
from tune.certificate.worst_point import WorstCase
from tune.documents.certified import (
    AbsoluteStability,
    Certificate,
    HandBox,
    ModeBox,
    WorstPoint,
)
from tune.documents.errors import CheckFailedError
from tune.documents.profile import Design

#: Cells looked at for one moment before it counts as not proved. With a fifth of margin to spare a
#: plain device takes a hundred, on the edge some thousands; a hand and modes take ten times more.
MOST_CELLS = 200_000
#: Samples of delay, margins included, that are looked at.
_LONGEST_DELAY = 64


@dataclass(slots=True)
class _Findings:
    """What was found so far."""

    failures: list[str]
    unstable: list[WorstPoint] = field(default_factory=list[WorstPoint])
    worst: tuple[tuple[str, ...], float, WorstCase] | None = None
    absolute: dict[str, AbsoluteStability] = field(default_factory=dict[str, AbsoluteStability])
    points: int = 0
    cells: int = 0

    def add(self, outcome: MomentInRegion) -> None:
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
    clamped = clamped_moments(design)
    played = [
        (moment, setting)
        for moment in design.moments()
        if (setting := setting_of(design, moment)) is not None
    ]
    judged = [judge_moments(design, played, region, most_cells or MOST_CELLS) for region in regions]
    for number, (moment, setting) in enumerate(played):
        found.failures += force_failures(design, moment)
        outcomes = [each[number] for each in judged]
        for each in outcomes:
            found.add(each)
        if not all(each.proved for each in outcomes):
            # Ripple, passivity and what is felt have no numbers where the loop may be unstable.
            continue
        try:
            found.cells += judge_levels(design, moment, regions, most_cells or MOST_CELLS)
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


def _longest(design: Design, region: Region) -> float:
    extras = [element.margins.extra_delay_samples for element in design.elements.values()]
    extra = max(design.margin.extra_delay_samples, *extras, 0.0)
    return region.delay[1] / region.sample_time[0] + extra


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
        worst=place_of(moment, gain, worst.point, worst.verdict.radius),
        assumes=assumptions(design),
        not_assessed=not_assessed(design),
        versions={name: version(name) for name in ("haptune", "numpy", "python-flint")},
    )


def _samples(delay: float, step: float) -> float:
    """A delay in samples, to the digits that a quotient of printed numbers has."""
    return float(np.round(delay / step, 9))
