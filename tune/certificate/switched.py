"""Clamped, switched and fading moments: what of them is nonlinear, and the proof of stability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from tune.certificate.absolute import Nonlinear, prove_absolute
from tune.certificate.branch_and_bound import Claim
from tune.certificate.point import setting_of
from tune.certificate.region import Region
from tune.certificate.zero_exclusion import prove
from tune.documents.certified import AbsoluteStability
from tune.documents.profile import Design

#: Multipliers by moment, its elements joined by " + ".
Witnesses = Mapping[str, AbsoluteStability]

#: What a proof covers, by what is there.
CLAMPED = "springs with their damping and mass that push on one side only, or are cut at a force"
GATED = "damping switched at any moment"
STEADY = "what fades, at any constant level of each element"
#: Cells of a proof. Near the resonance of a device on a stiff hand a weak wall needs 450 000, and
#: more margin would not make them fewer.
_MOST_CELLS = 1_000_000
_REMEDY = "Ask for less stiffness or damping, or name it apart from what it is not met with"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of one moment: cells looked at, and why it failed or what it is proved for."""

    cells: int = 0
    failure: str | None = None
    proved: AbsoluteStability | None = None


def is_clamped(design: Design, moment: tuple[str, ...]) -> bool:
    """Whether the clamp of some element of a moment may be reached: of a wall, or a free spring."""
    chosen = [design.elements[name] for name in moment]
    return any(each.stiffness and (each.one_sided or each.cut) for each in chosen)


def judge_switched(
    design: Design,
    moment: tuple[str, ...],
    regions: tuple[Region, ...],
    witnesses: Witnesses,
    most_cells: int | None = None,
) -> Outcome:
    """Prove one moment absolutely stable in every region, with the multipliers that are stated.

    Args:
        design: whose clamps may be reached.
        moment: elements felt together.
        regions: of device and hand.
        witnesses: multipliers and gain of this moment among them.
        most_cells: budget where less would be asked for instead; None for all that may help.
    """
    where = " + ".join(moment)
    witness = witnesses.get(where)
    if witness is None:
        return Outcome(
            failure=f"{where}: its force may be cut or push on one side only, and no multiplier is "
            "stated that proves it stable so. Tune again"
        )
    least, extra = design.margin.gain, float(design.margin.extra_delay_samples)
    if not witness.gain >= least or witness.extra_delay_samples != extra:
        return Outcome(
            failure=f"{where}: absolute_stability says a gain of {witness.gain:.6g} with "
            f"{witness.extra_delay_samples:.6g} extra samples, the margin asks for {least:.6g} "
            f"with {extra:.6g}"
        )
    stated = {False: witness.free, True: witness.held}
    for grounded, kind in ((False, "free"), (True, "held")):
        there = any(region.grounded == grounded for region in regions)
        if there != (stated[grounded] is not None):
            failure = "no multiplier is stated, and some device or hand of the box is"
            if not there:
                failure = "a multiplier is stated, and no device or hand of the box is"
            return Outcome(failure=f"{where}: absolute_stability, {kind}: {failure}. Tune again")
    sum_ = nonlinear_parts(design, moment)
    claim = Claim(gain=witness.gain, extra=extra)
    cells = 0
    for region in regions:
        multiplier, failure = stated[region.grounded], None
        assert multiplier is not None
        try:
            proof = prove_absolute(region, sum_, multiplier, claim, most_cells or _MOST_CELLS)
        except ValueError as error:
            failure = str(error)
        else:
            cells += proof.cells
            if proof.doubt is not None:
                place = region.merged().point(proof.doubt[:-1, 0], float(proof.doubt[-1, 0]))
                failure = f"the condition could not be shown at {place.words()}, {cells} cells"
        if failure is not None:
            return Outcome(
                cells=cells,
                failure=f"{region.words(moment)}: not proved stable with its clamps up to a gain "
                f"of {claim.gain:.6g} with {extra:.6g} extra samples of delay: {failure}. "
                f"{_REMEDY}",
            )
    covers = (
        CLAMPED,
        *(() if sum_.damping is None else (GATED,)),
        *((STEADY,) if sum_.steady else ()),
    )
    return Outcome(cells=cells, proved=witness.model_copy(update={"covers": covers}))


def judge_levels(
    design: Design, moment: tuple[str, ...], regions: tuple[Region, ...], most_cells: int
) -> tuple[int, str | None]:
    """(cells looked at, why a moment is not proved at every level or None).

    On the way in and out an element is played in part, each at a level of its own in [0, 1]. For
    one device, frequency and gain the loop D + s·N is straight in every level, so that its values
    fill the convex hull of those where each level is 0 or 1. Alone an element goes through smaller
    gains of itself; a moment with a clamp that may be reached is proved at any level of each.

    Args:
        design: whose margin is to be kept.
        moment: elements felt together, proved stable at their full levels like every part of them.
        regions: of device and hand.
        most_cells: budget for each.
    """
    fading = [name for name in moment if design.elements[name].fades]
    if not fading or len(moment) == 1 or is_clamped(design, moment):
        return 0, None
    corners = [
        setting_of(design, tuple(name for name in moment if name not in absent))
        for count in range(len(fading) + 1)
        for absent in combinations(fading, count)
    ]
    first, *others = [corner for corner in corners if corner is not None]
    margin = design.margin
    claim = Claim(gain=margin.gain, extra=float(margin.extra_delay_samples))
    cells = 0
    for region in regions:
        proof = prove(region, first, [claim], most_cells, others, or_nothing=None in corners)
        cells += proof.cells
        if not proof.proved:
            return cells, (
                f"{region.words(moment)}: not proved stable while {', '.join(fading)} fades in or "
                f"out beside the others, within {proof.cells} cells. Ask for less, or leave it out "
                "of what is felt together"
            )
    return cells, None


def nonlinear_parts(design: Design, moment: tuple[str, ...]) -> Nonlinear:
    """Clamps, what is damping only, and what fades without a spring."""
    played = {name: setting for name in moment if (setting := setting_of(design, (name,)))}
    clamps = {name: each for name, each in played.items() if each.stiffness}
    steady = {name for name in played if design.elements[name].fades} - clamps.keys()
    dampers = [each for name, each in played.items() if name not in {*clamps, *steady}]
    total = sum(each.damping for each in dampers)
    return Nonlinear(
        clamps=clamps,
        damping=replace(dampers[0], damping=total) if dampers else None,
        steady=tuple(each for name, each in played.items() if name in steady),
    )
