"""Switched and saturating moments: what of them is nonlinear, and the proof of stability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from tune.certificate.absolute import multiplier_failure, open_device_failure, prove_absolute
from tune.certificate.branch_and_bound import Claim, Proof
from tune.certificate.point import Setting
from tune.certificate.region import Region
from tune.certificate.roots import judge
from tune.certificate.zero_exclusion import prove
from tune.documents.certified import AbsoluteStability, Multiplier
from tune.documents.profile import Design

#: Multipliers by moment, its elements joined by " + ".
Witnesses = Mapping[str, AbsoluteStability]

#: What a proof covers, by what is there.
ONE_SIDED = "springs that push on one side only, or are cut at a force"
GATED = "damping switched at any moment"
STEADY = "mass and negative effects at any constant part of what they are"
#: Cells of a proof. Near the resonance of a device on a stiff hand a weak wall needs 450 000, and
#: more margin would not make them fewer.
_MOST_CELLS = 1_000_000
_REMEDY = "Ask for less stiffness or damping, or leave out one_sided"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of one moment: cells looked at, and why it failed or what it is proved for."""

    cells: int = 0
    failure: str | None = None
    proved: AbsoluteStability | None = None


def judge_switched(
    design: Design,
    moment: tuple[str, ...],
    setting: Setting,
    regions: tuple[Region, ...],
    witnesses: Witnesses,
) -> Outcome:
    """Prove one moment absolutely stable in every region, with the multipliers that are stated.

    Args:
        design: whose elements are one-sided.
        moment: elements felt together.
        setting: their sum.
        regions: of device and hand.
        witnesses: multipliers and gain of this moment among them.
    """
    where = " + ".join(moment)
    witness = witnesses.get(where)
    if witness is None:
        return Outcome(
            failure=f"{where}: pushes on one side only, and no multiplier is stated that proves it "
            "stable so. Tune again"
        )
    least, extra = design.margin.gain, float(design.margin.extra_delay_samples)
    if not witness.gain >= least or witness.extra_delay_samples != extra:
        return Outcome(
            failure=f"{where}: absolute_stability says a gain of {witness.gain:.6g} with "
            f"{witness.extra_delay_samples:.6g} extra samples, the margin asks for {least:.6g} "
            f"with {extra:.6g}"
        )
    if _apart(design, moment):
        return Outcome(
            failure=f"{where}: pushes on one side only, or is cut, beside several elements that "
            "fade and whose masses and negative effects are not alike, so that their levels are "
            "not proved one by one. Let only one of them be felt together with it"
        )
    switched, steady = split_moment(design, moment, setting)
    claim = Claim(gain=witness.gain, extra=extra)
    cells = 0
    for region in regions:
        multiplier = witness.held if region.grounded else witness.free
        failure, proof = _prove(region, switched, steady, multiplier, claim)
        cells += 0 if proof is None else proof.cells
        if failure is not None:
            return Outcome(
                cells=cells,
                failure=f"{region.words(moment)}: not proved stable as a one-sided wall up to a "
                f"gain of {claim.gain:.6g} with {extra:.6g} extra samples of delay: {failure}. "
                f"{_REMEDY}",
            )
    covers = (
        *((ONE_SIDED,) if switched.stiffness else ()),
        *((GATED,) if switched.damping else ()),
        *((STEADY,) if steady is not None else ()),
    )
    return Outcome(cells=cells, proved=witness.model_copy(update={"covers": covers}))


def split_moment(
    design: Design, moment: tuple[str, ...], setting: Setting
) -> tuple[Setting, Setting | None]:
    """(springs and positive dampers, what fades slowly and is part of the device meanwhile)."""
    chosen = [design.elements[name] for name in moment]
    against = sum(min(element.damping, 0.0) for element in chosen)
    mass = sum(element.mass for element in chosen)
    switched = replace(
        setting, damping=sum(max(element.damping, 0.0) for element in chosen), mass=0.0
    )
    if not against and not any(element.mass for element in chosen):
        return switched, None
    return switched, replace(setting, stiffness=0.0, damping=against, mass=mass)


def _apart(design: Design, moment: tuple[str, ...]) -> bool:
    """Whether levels of its own for each element give sums that no common level gives."""
    chosen = [design.elements[name] for name in moment]
    steady = [(each.mass, min(each.damping, 0.0)) for each in chosen if each.fades]
    return any(
        mass * other_loss != other_mass * loss or mass * other_mass < 0
        for (mass, loss), (other_mass, other_loss) in combinations(steady, 2)
    )


def _prove(
    region: Region,
    switched: Setting,
    steady: Setting | None,
    multiplier: Multiplier | None,
    claim: Claim,
) -> tuple[str | None, Proof | None]:
    """(why it is not proved or None, the proof as far as it went)."""
    failure = open_device_failure(region)
    if failure is None and multiplier is None:
        failure = "no multiplier is stated"
    if failure is None and multiplier is not None:
        failure = multiplier_failure(region, switched, multiplier)
    if failure is not None or multiplier is None:
        return failure, None
    if steady is not None and not _stable_alone(region, steady, claim):
        return "mass and negative effects are not proved stable by themselves", None
    proof = prove_absolute(region, switched, steady, multiplier, claim, _MOST_CELLS)
    if proof.proved:
        return None, proof
    assert proof.doubt is not None
    *_, extra = proof.doubt[:, 0]
    place = region.merged().point(proof.doubt[:-1, 0], float(extra))
    return f"the condition could not be shown at {place.words()}, {proof.cells} cells", proof


def _stable_alone(region: Region, steady: Setting, claim: Claim) -> bool:
    """Whether the device is stable with what acts steadily, at every gain up to the claim's."""
    if not (steady.damping or steady.mass):
        return True
    point = region.point(region.middle(), 0.0)
    return (
        judge(point, steady, claim.gain).answer == "stable"
        and prove(region, steady, [claim], _MOST_CELLS).proved
    )
