"""Clamped, switched and fading moments: what of them is nonlinear, and the proof of stability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from tune.certificate.absolute import (
    Nonlinear,
    multiplier_failure,
    open_device_failure,
    prove_absolute,
)
from tune.certificate.branch_and_bound import Claim, Proof
from tune.certificate.fade_levels import Corners, prove_levels
from tune.certificate.point import Setting, setting_of
from tune.certificate.region import Region
from tune.documents.certified import AbsoluteStability, Multiplier
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
#: Clamps whose B/K and M/K agree to this part act on one signal.
_ALIKE = 1e-8
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
    for name, stated, there in (
        ("free", witness.free, not all(region.grounded for region in regions)),
        ("held", witness.held, any(region.grounded for region in regions)),
    ):
        if stated is not None and not there:
            return Outcome(
                failure=f"{where}: absolute_stability states a {name} multiplier, and no device "
                f"or hand of the box is {name}. Tune again"
            )
    sum_ = nonlinear_parts(design, moment)
    claim = Claim(gain=witness.gain, extra=extra)
    cells = 0
    for region in regions:
        multiplier = witness.held if region.grounded else witness.free
        failure, proof = _prove(region, sum_, multiplier, claim, most_cells or _MOST_CELLS)
        cells += 0 if proof is None else proof.cells
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


def nonlinear_parts(design: Design, moment: tuple[str, ...]) -> Nonlinear:
    """Clamps, what is damping only, and what fades without a spring."""
    clamps: dict[str, Setting] = {}
    steady: list[Setting] = []
    damping: Setting | None = None
    for name in moment:
        element, setting = design.elements[name], setting_of(design, (name,))
        if setting is None:
            continue
        if element.stiffness:
            # Clamps of one signal are one clamp, as stiff as their sum.
            alike = next((known for known, each in clamps.items() if _alike(each, setting)), None)
            if alike is None:
                clamps[name] = setting
            else:
                both = f"{alike} + {name}", _sum(clamps[alike], setting)
                clamps = dict(both if each[0] == alike else each for each in clamps.items())
        elif element.fades:
            steady.append(setting)
        else:
            before = 0.0 if damping is None else damping.damping
            damping = replace(setting, damping=before + setting.damping)
    return Nonlinear(clamps=clamps, damping=damping, steady=tuple(steady))


def _prove(
    region: Region,
    sum_: Nonlinear,
    multiplier: Multiplier | None,
    claim: Claim,
    most_cells: int,
) -> tuple[str | None, Proof | None]:
    """(why it is not proved or None, the proof as far as it went)."""
    failure = open_device_failure(region)
    if failure is None and multiplier is None:
        failure = "no multiplier is stated"
    if failure is None and multiplier is not None:
        failure = multiplier_failure(region, sum_, multiplier)
    if failure is not None or multiplier is None:
        return failure, None
    if sum_.steady and not _stable_alone(region, sum_.steady, claim):
        return "what fades is not proved stable by itself", None
    proof = prove_absolute(region, sum_, multiplier, claim, most_cells)
    if proof.proved:
        return None, proof
    assert proof.doubt is not None
    *_, extra = proof.doubt[:, 0]
    place = region.merged().point(proof.doubt[:-1, 0], float(extra))
    return f"the condition could not be shown at {place.words()}, {proof.cells} cells", proof


def _stable_alone(region: Region, steady: tuple[Setting, ...], claim: Claim) -> bool:
    """Whether the device is stable with what fades, at every level and gain up to the claim's."""
    sums: list[Setting] = []
    for setting in steady:
        sums += [*(_sum(each, setting) for each in sums), setting]
    corners = Corners(settings=tuple(sums), nothing=True)
    return prove_levels(region, corners, claim, _MOST_CELLS).proved


def _sum(first: Setting, second: Setting) -> Setting:
    return replace(
        first,
        stiffness=first.stiffness + second.stiffness,
        damping=first.damping + second.damping,
        mass=first.mass + second.mass,
    )


def _alike(first: Setting, second: Setting) -> bool:
    """Whether B/K and M/K agree."""
    pairs = (
        (first.damping * second.stiffness, second.damping * first.stiffness),
        (first.mass * second.stiffness, second.mass * first.stiffness),
    )
    return all(abs(a - b) <= _ALIKE * max(abs(a), abs(b)) for a, b in pairs)
