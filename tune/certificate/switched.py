"""Clamped, switched and fading moments: what of them is nonlinear, and the proof of stability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

from tune.certificate.absolute import Nonlinear, prove_absolute
from tune.certificate.branch_and_bound import Claim
from tune.certificate.point import setting_of
from tune.certificate.region import Region
from tune.certificate.zero_exclusion import prove
from tune.documents.certified import AbsoluteStability
from tune.documents.errors import CheckFailedError
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


def is_clamped(design: Design, moment: tuple[str, ...]) -> bool:
    """Whether the clamp of some element of a moment may be reached: of a wall, or a free spring."""
    chosen = [design.elements[name] for name in moment]
    return any(each.stiffness and (each.one_sided or each.cut) for each in chosen)


def clamped_moments(design: Design) -> tuple[tuple[str, ...], ...]:
    """Moments with a clamp that may be reached and are part of no other such moment.

    What is proved of them covers their parts: a clamp that never pushes is nondecreasing, what is
    switched may stay off, and what fades may be at nothing.
    """
    played = {name for name in design.elements if setting_of(design, (name,))}
    moments = [played.intersection(each) for each in design.moments() if is_clamped(design, each)]
    largest = [each for each in moments if not any(each < other for other in moments)]
    return tuple(each for each in design.moments() if set(each) in largest)


def judge_switched(
    design: Design,
    moment: tuple[str, ...],
    regions: tuple[Region, ...],
    witnesses: Witnesses,
    most_cells: int | None = None,
) -> tuple[AbsoluteStability, int]:
    """What a moment is proved for in every region, by stated multipliers, and cells looked at.

    The budget of cells is for where less would be asked for instead; None for all that may help.

    Raises:
        CheckFailedError: it is not proved.
    """
    where, margin = " + ".join(moment), design.margin

    def refused(words: str) -> CheckFailedError:
        return CheckFailedError((f"{where}: {words}. Tune again",))

    witness = witnesses.get(where)
    if witness is None:
        raise refused(
            "its force may be cut or push on one side only, and no multiplier is stated that "
            "proves it stable so"
        )
    gain, extra = witness.gain, witness.extra_delay_samples
    if not gain >= margin.gain or extra != margin.extra_delay_samples:
        raise refused(
            f"absolute_stability says a gain of {gain:.6g} with {extra:.6g} extra samples, the "
            f"margin asks for {margin.gain:.6g} with {margin.extra_delay_samples}"
        )
    sum_, claim, cells = nonlinear_parts(design, moment), Claim(gain=gain, extra=extra), 0
    for grounded, kind in ((False, "free"), (True, "held")):
        multiplier = witness.held if grounded else witness.free
        own = [region for region in regions if region.grounded == grounded]
        if (multiplier is None) == bool(own):
            words = "no multiplier is stated, and some" if own else "a multiplier is stated, and no"
            raise refused(f"absolute_stability, {kind}: {words} device or hand of the box is")
        for region in own:
            try:
                cells += prove_absolute(region, sum_, multiplier, claim, most_cells or _MOST_CELLS)
            except ValueError as error:
                words = (
                    f"{region.words(moment)}: not proved stable with its clamps up to a gain of "
                    f"{gain:.6g} with {extra:.6g} extra samples of delay: {error}. {_REMEDY}"
                )
                raise CheckFailedError((words,)) from None
    gated, steady = (GATED,) if sum_.damping else (), (STEADY,) if sum_.steady else ()
    return witness.model_copy(update={"covers": (CLAMPED, *gated, *steady)}), cells


def judge_levels(
    design: Design, moment: tuple[str, ...], regions: tuple[Region, ...], most_cells: int
) -> int:
    """Cells looked at to prove a moment at every level of what fades.

    On the way in and out an element is played in part, each at a level of its own in [0, 1]. For
    one device, frequency and gain the loop D + s·N is straight in every level, so that its values
    fill the convex hull of those where each level is 0 or 1. Alone an element goes through smaller
    gains of itself; a moment with a clamp that may be reached is proved at any level of each.

    The moment and each part of it are proved stable at their full levels before.

    Raises:
        CheckFailedError: it is not proved.
    """
    fading = [name for name in moment if design.elements[name].fades]
    if not fading or len(moment) == 1 or is_clamped(design, moment):
        return 0
    corners = [
        setting_of(design, tuple(name for name in moment if name not in absent))
        for count in range(len(fading) + 1)
        for absent in combinations(fading, count)
    ]
    first, *others = [corner for corner in corners if corner is not None]
    margin, cells = design.margin, 0
    claim = Claim(gain=margin.gain, extra=float(margin.extra_delay_samples))
    for region in regions:
        proof = prove(region, first, [claim], most_cells, others, or_nothing=None in corners)
        if not proof.proved:
            words = (
                f"{region.words(moment)}: not proved stable while {', '.join(fading)} fades in or "
                f"out beside the others, within {proof.cells} cells. Ask for less, or leave it out "
                "of what is felt together"
            )
            raise CheckFailedError((words,))
        cells += proof.cells
    return cells


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
