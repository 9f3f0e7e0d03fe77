"""Linear stability of every moment over one region: searched, then proved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from tune.certificate.branch_and_bound import Claim
from tune.certificate.point import Point, Setting
from tune.certificate.region import Region
from tune.certificate.worst_point import WorstCase, worst_points, worst_points_of_all
from tune.certificate.zero_exclusion import prove_all
from tune.documents.certified import ModePlace, WorstPoint
from tune.documents.profile import Design

#: How much more the search does where a proof was not found.
_THOROUGH = 8

Moment = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Named:
    """A claim and what it is called."""

    claim: Claim
    words: str


@dataclass(slots=True, kw_only=True)
class MomentInRegion:
    """What became of one moment in one region.

    Attributes:
        moment: elements that are felt at once.
        where: the moment for people.
        proved: stable throughout.
        failures: sentences, none if proved.
        unstable: points found.
        worst: gain, and the worst point of the margin, where that is stable.
        points: judged.
        cells: looked at by the proof.
    """

    moment: Moment
    where: str
    proved: bool = False
    failures: list[str] = field(default_factory=list[str])
    unstable: list[WorstPoint] = field(default_factory=list[WorstPoint])
    worst: tuple[float, WorstCase] | None = None
    points: int = 0
    cells: int = 0

    def refuse(self, each: _Named, worst: WorstCase) -> None:
        """Keep a point that is not stable, and the sentence about it."""
        gain, verdict = each.claim.gain, worst.verdict
        # Where the poles could not be isolated there is no radius to tell.
        if math.isfinite(verdict.radius):
            self.unstable.append(place_of(self.moment, gain, worst.point, verdict.radius))
        self.failures.append(
            f"{self.where}: {each.words}: {verdict.answer} at {worst.point.words()}, gain "
            f"{gain:.6g}: {verdict.reason}"
        )


def judge_moments(
    design: Design,
    played: Sequence[tuple[Moment, Setting]],
    region: Region,
    most_cells: int,
) -> list[MomentInRegion]:
    """Search each moment for an unstable point; where none is found, prove that there is none.

    Args:
        design: whose margins are claimed.
        played: moments and what they play.
        region: the box.
        most_cells: of the proof of one moment.

    Returns:
        One a moment, in their order.
    """
    named = [list(_claims(design, moment)) for moment, _ in played]
    asked = [
        (setting, [each.claim for each in claims])
        for (_, setting), claims in zip(played, named, strict=True)
    ]
    judged = [MomentInRegion(moment=moment, where=region.words(moment)) for moment, _ in played]
    searched = worst_points_of_all(region, asked)
    for outcome, claims, found in zip(judged, named, searched, strict=True):
        for each, worst in zip(claims, found, strict=True):
            outcome.points += worst.judged
            if worst.verdict.answer != "stable":
                outcome.refuse(each, worst)
            elif each.words == "margin":
                outcome.worst = each.claim.gain, worst
    left = [number for number, outcome in enumerate(judged) if not outcome.failures]
    proofs = prove_all(region, [asked[number] for number in left], most_cells)
    for number, proof in zip(left, proofs, strict=True):
        outcome, (setting, claims) = judged[number], asked[number]
        outcome.cells, outcome.proved = proof.cells, proof.proved
        if proof.proved:
            continue
        doubted = worst_points(region, setting, claims, proof.doubt, thorough=_THOROUGH)
        for each, worst in zip(named[number], doubted, strict=True):
            if worst.verdict.answer != "stable":
                outcome.refuse(each, worst)
                break
        else:
            outcome.failures.append(_undecided(outcome, claims[0].gain, searched[number][0]))
    return judged


def _undecided(outcome: MomentInRegion, gain: float, worst: WorstCase) -> str:
    return (
        f"{outcome.where}: not proved for every device of the box within {outcome.cells} cells; "
        f"nothing unstable was found, worst is a pole radius of {worst.verdict.radius:.9g} at "
        f"{worst.point.words()}, gain {gain:.6g}. Ask for less, or narrow the intervals of the "
        "device"
    )


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


def place_of(moment: Moment, gain: float, point: Point, radius: float) -> WorstPoint:
    """A point as a certificate stores it, with the gain, no unit, and pole radius there."""
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
