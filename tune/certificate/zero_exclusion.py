"""Zero exclusion by branch and bound: no pole crosses the unit circle anywhere in a region.

In a cell of θ, of everything not known exactly and of gains between two ends, the condition of a
crossing D + s·N = 0 cannot be met if one straight line through zero has D + s·N strictly on one
side for both end gains: then also for every gain between them. Where no line is found the cell is
split across what moves D + s·N most, until every cell is excluded or the budget is spent. With one
point known to be stable, a region without crossings is stable throughout.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import ROUNDING, AffineForm, FloatArray, Term
from tune.certificate.branch_and_bound import (
    Cells,
    Claim,
    Proof,
    branch_and_bound,
    decide,
    initial_cells,
)
from tune.certificate.mechanism import Mechanism
from tune.certificate.point import Setting, Sizes, groups_of_equal_effects
from tune.certificate.region import Region
from tune.certificate.value_set import excludes_zero, gain_vertices, sampled_plant, value_set


def prove(
    region: Region,
    setting: Setting,
    claims: Sequence[Claim],
    most_cells: int,
    others: Sequence[Setting] = (),
    *,
    or_nothing: bool = False,
) -> Proof:
    """Exclude crossings everywhere in a region, for several claims at once.

    Args:
        region: the box.
        setting: what is played, not nothing.
        claims: gains and extra delays.
        most_cells: budget.
        others: played as well as all that lies between it and these.
        or_nothing: whether what lies between it and nothing is, beside the others.
    """
    corners = [(each, each.sizes) for each in (setting, *others)]
    return branch_and_bound(
        region,
        claims,
        lambda merged, cells: _exclusion_test(merged, corners, cells, or_nothing=or_nothing),
        most_cells,
    )


def prove_all(
    region: Region, asked: Sequence[tuple[Setting, Sequence[Claim]]], most_cells: int
) -> list[Proof]:
    """Exclude crossings everywhere in a region for each of some settings of the same filters.

    Settings that play the same effects are examined in one run, as what takes time is how often
    cells are examined, not how many; where that run leaves a doubt, each of them has its own.

    Args:
        region: the box.
        asked: settings, none of them nothing, and the claims of each.
        most_cells: budget of one run.

    Returns:
        One proof a setting, in their order.
    """
    found: dict[int, Proof] = {}
    for numbers in groups_of_equal_effects([setting for setting, _ in asked]):
        together = [asked[number] for number in numbers]
        proofs = _proved_at_once(region, together, most_cells) if len(together) > 1 else None
        if proofs is None:
            proofs = [prove(region, *each, most_cells) for each in together]
        found |= zip(numbers, proofs, strict=True)
    return [found[number] for number in range(len(asked))]


def _proved_at_once(
    region: Region, asked: Sequence[tuple[Setting, Sequence[Claim]]], most_cells: int
) -> list[Proof] | None:
    """Proofs of settings that play the same effects, from one run; None if it leaves a doubt.

    A further side of each cell, without a width, is the number of its setting.
    """
    region = region.merged()
    parts = [initial_cells(region, claims) for _, claims in asked]
    number = np.repeat(np.arange(len(asked), dtype=np.float64), [len(part) for part in parts])
    sizes = np.array([setting.sizes for setting, _ in asked]).T
    seen = np.zeros(len(asked), dtype=np.intp)

    def examine(cells: Cells) -> tuple[NDArray[np.bool_], FloatArray]:
        which = cells.low[-1].astype(np.intp)
        np.add.at(seen, which, 1)
        plain = Cells(cells.low[:-1], cells.high[:-1])
        stiffness, damping, mass = sizes[:, which]
        played = (asked[0][0], (stiffness, damping, mass))
        holds, pull = _exclusion_test(region, [played], plain)
        return holds, np.vstack([pull, np.zeros(len(cells))])

    begun = Cells(
        np.vstack([np.hstack([part.low for part in parts]), number]),
        np.vstack([np.hstack([part.high for part in parts]), number]),
    )
    if not decide(begun, examine, most_cells).proved:
        return None
    return [Proof(proved=True, cells=int(count)) for count in seen]


def _exclusion_test(
    region: Region,
    corners: Sequence[tuple[Setting, Sizes]],
    cells: Cells,
    *,
    or_nothing: bool = False,
) -> tuple[NDArray[np.bool_], FloatArray]:
    """(no crossing in the cell, how much each side moves the loop).

    D + s·N is straight in what is played: what lies between corners is in their convex hull.
    """
    moving = [row for row in range(len(cells.low)) if np.any(cells.high[row] > cells.low[row])]
    symbols = [row for row in moving if row != 1]
    terms = terms_of(cells, symbols)
    theta, mechanism = as_affine(terms[0], cells, len(symbols)), mechanism_of(region, terms)
    low, high = cells.low[1], cells.high[1]
    with np.errstate(all="ignore"):
        plant = sampled_plant(theta, mechanism)
        found = [value_set(theta, mechanism, *corner, plant) for corner in corners]
        forms = [form for each in found for form in gain_vertices(each, low, high)]
        excluded = excludes_zero(*forms, *((found[0].start,) if or_nothing else ()))
        rising = [each.rising for each in found if each.rising is not None]
        if len(rising) == len(found) and region.damping[0] >= 0:
            excluded |= np.min(rising, axis=0) > 0
        pull = np.zeros_like(cells.low)
        pull[symbols] = np.max([np.abs(form.slopes) for form in forms], axis=0)
        pull[1] = np.max([np.abs(each.varied.centre) for each in found], axis=0) * (high - low) / 2
        return excluded, pull


def terms_of(cells: Cells, symbols: Sequence[int]) -> list[Term]:
    """Each row as a form in its own symbol, or as a number where all cells agree."""
    terms: list[Term] = []
    for row in range(len(cells.low)):
        low, high = cells.low[row], cells.high[row]
        if row not in symbols and np.all(low == low[0]):
            terms.append(float(low[0]))
            continue
        centre = (low + high) / 2
        slopes = np.zeros((len(symbols), len(low)), dtype=np.complex128)
        if row in symbols:
            slopes[symbols.index(row)] = (high - low) / 2
        error = ROUNDING * np.maximum(np.abs(low), np.abs(high))
        terms.append(AffineForm(centre + 0j, slopes, error, np.zeros_like(error)))
    return terms


def as_affine(term: Term, cells: Cells, symbols: int) -> AffineForm:
    """A term as a form in so many symbols, a number as one that none of them moves."""
    if isinstance(term, AffineForm):
        return term
    count = len(cells)
    zero = np.zeros(count)
    return AffineForm(np.full(count, term + 0j), np.zeros((symbols, count), complex), zero, zero)


def mechanism_of(region: Region, terms: list[Term]) -> Mechanism:
    """What may be anywhere in each cell, from the terms of its sides."""
    theta, _, extra, mass, damping, step, delay, lag, slope, *rest = terms
    del theta
    hand = None
    if region.hand is not None:
        hand = (rest[0], rest[1], rest[2])
        rest = rest[3:]
    return Mechanism(
        mass=mass,
        damping=damping,
        sample_time=step,
        delay=_samples(delay, step, extra, terms[0]),
        lag=lag,
        position_stiffness=slope,
        hand=hand,
        modes=tuple((rest[2 * i], rest[2 * i + 1]) for i in range(len(region.modes))),
        participations=tuple((mode.at_encoder, mode.at_handle) for mode in region.modes),
        grounded=region.grounded,
    )


def _samples(delay: Term, step: Term, extra: Term, like: Term) -> AffineForm:
    """τ/T + extra as a form, whatever is known exactly."""
    assert isinstance(like, AffineForm)  # θ always has a width
    per_step = step.inverse() if isinstance(step, AffineForm) else 1 / step
    return like * 0.0 + (delay * per_step + extra)
