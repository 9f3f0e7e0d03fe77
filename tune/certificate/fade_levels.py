"""Stability at every constant level of elements that fade, proved on the hull of their corners.

On the way in and out an element is played in part, its level anywhere in [0, 1], and each element
of a moment has a level of its own. For one device, frequency and gain the loop D + s·N is straight
in every level, so that all its values fill the convex hull of those where each level is 0 or 1:
none of them is zero if one line through zero has all of the corners on one side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import AffineForm, FloatArray
from tune.certificate.branch_and_bound import Cells, Claim, Proof, branch_and_bound
from tune.certificate.point import Setting, setting_of
from tune.certificate.region import Region
from tune.certificate.value_set import ValueSet, excludes_zero, gain_vertices, value_set
from tune.certificate.zero_exclusion import as_affine, mechanism_of, terms_of
from tune.documents.profile import Design


@dataclass(frozen=True, slots=True, kw_only=True)
class Corners:
    """A moment where each level is 0 or 1.

    Attributes:
        settings: of the corners at which anything acts.
        nothing: whether at one corner nothing does.
    """

    settings: tuple[Setting, ...]
    nothing: bool


def corners_of(design: Design, moment: tuple[str, ...]) -> Corners | None:
    """The corners of a moment's levels; None where no other is passed than what is proved alone.

    An element that fades alone goes through smaller gains of itself; beside a wall that pushes
    levels stand still, each anywhere, which is part of the proof of its clamp.
    """
    fading = [name for name in moment if design.elements[name].fades]
    if not fading or len(moment) == 1 or design.walls.intersection(moment):
        return None
    kept = [name for name in moment if name not in fading]
    found = [
        setting_of(design, tuple(name for name in moment if name in kept or name in part))
        for count in range(len(fading) + 1)
        for part in combinations(fading, count)
    ]
    settings = tuple(setting for setting in found if setting is not None)
    return Corners(settings=settings, nothing=len(settings) < len(found))


def judge_levels(
    design: Design, moment: tuple[str, ...], regions: tuple[Region, ...], most_cells: int
) -> tuple[int, str | None]:
    """(cells looked at, why a moment is not proved at every level or None).

    Args:
        design: whose margin is to be kept.
        moment: elements felt together, proved stable at their full levels like every part of them.
        regions: of device and hand.
        most_cells: budget for each.
    """
    corners = corners_of(design, moment)
    if corners is None:
        return 0, None
    margin = design.margin
    claim = Claim(gain=margin.gain, extra=float(margin.extra_delay_samples))
    cells = 0
    for region in regions:
        proof = prove_levels(region, corners, claim, most_cells)
        cells += proof.cells
        if not proof.proved:
            fading = ", ".join(name for name in moment if design.elements[name].fades)
            return cells, (
                f"{region.words(moment)}: not proved stable while {fading} fades in or out "
                f"beside the others, within {proof.cells} cells. Ask for less, or leave it out of "
                "what is felt together"
            )
    return cells, None


def prove_levels(region: Region, corners: Corners, claim: Claim, most_cells: int) -> Proof:
    """Exclude crossings everywhere in a region, at every constant level and gain of a claim.

    Args:
        region: the box.
        corners: of the levels; that one of them is stable somewhere is for others to show.
        claim: gain and extra delay.
        most_cells: budget.
    """

    def examine(merged: Region, cells: Cells) -> tuple[NDArray[np.bool_], FloatArray]:
        return _examine(merged, corners, cells)

    return branch_and_bound(region, [claim], examine, most_cells)


def _examine(
    region: Region, corners: Corners, cells: Cells
) -> tuple[NDArray[np.bool_], FloatArray]:
    """(no crossing in the cell, how much each side moves the loop)."""
    moving = [row for row in range(len(cells.low)) if np.any(cells.high[row] > cells.low[row])]
    symbols = [row for row in moving if row != 1]
    terms = terms_of(cells, symbols)
    theta = as_affine(terms[0], cells, len(symbols))
    mechanism = mechanism_of(region, terms)
    low, high = cells.low[1], cells.high[1]
    with np.errstate(all="ignore"):
        responses = [value_set(theta, mechanism, setting) for setting in corners.settings]
        springs = any(setting.stiffness for setting in corners.settings)
        turned = [
            springs and not setting.stiffness and not mechanism.grounded
            for setting in corners.settings
        ]
        forms: list[AffineForm] = []
        for response, turn in zip(responses, turned, strict=True):
            # Where no spring acts jθ has been taken out of D and N; what is left of it turns by j.
            forms += [form * 1j if turn else form for form in gain_vertices(response, low, high)]
        if corners.nothing:
            start = responses[0].start
            forms.append(start * 1j if turned[0] else start)
        excluded = excludes_zero(*forms)
        rising = _rising(responses)
        if rising is not None and region.damping[0] >= 0:
            excluded |= rising > 0
        pull = np.zeros_like(cells.low)
        for index, row in enumerate(symbols):
            pull[row] = np.max([np.abs(form.slopes[index]) for form in forms], axis=0)
        width = (high - low) / 2
        pull[1] = np.max([np.abs(each.varied.centre) * width for each in responses], axis=0)
        return excluded, pull


def _rising(responses: Sequence[ValueSet]) -> FloatArray | None:
    """The least of what each corner adds to the imaginary part; None where one does not tell."""
    found = [response.rising for response in responses if response.rising is not None]
    return np.min(found, axis=0) if len(found) == len(responses) else None
