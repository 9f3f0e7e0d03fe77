"""Zero exclusion by branch and bound: no pole crosses the unit circle anywhere in a region.

In a cell of θ, of everything not known exactly and of gains between two ends, the condition of a
crossing D + s·N = 0 cannot be met if one straight line through zero has D + s·N strictly on one
side for both end gains: then also for every gain between them. Where no line is found the cell is
split across what moves D + s·N most, until every cell is excluded or the budget is spent. With one
point known to be stable, a region without crossings is stable throughout.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import (
    ROUNDING,
    AffineForm,
    FloatArray,
    Term,
    anywhere_between,
    ends_of,
    inverse,
)
from tune.certificate.region import Interval, Region, Setting, Sizes, groups_of_equal_effects
from tune.certificate.value_set import (
    Mechanism,
    excludes_zero,
    gain_vertices,
    sampled_plant,
    value_set,
)

#: Cells looked at together: enough to keep numpy busy, few enough to stay in the cache.
_BATCH = 4096
#: Cells narrower than this, relative to the region, in whatever would be split next: a crossing is
#: all but certain there, and doubles would not tell otherwise.
_NARROWEST = 1e-9
#: Ratio of neighbouring frequencies to begin with.
_RATIO = 1.5
#: A side that moves nothing is split when it is so many times wider than what would be.
_STARVED = 16.0
#: Ends that are so many times apart are split at their geometric mean.
_WIDE = 2.0
#: Frequency below which what acts in another proportion at aliases is not known at all, rad/s.
_STILL = 1e-9
#: A second side is split at once if it moves the loop by more than this part of the first.
_ALSO = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """What is to hold in the whole region: every gain in (0, gain], delay up to extra samples."""

    gain: float
    extra: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Outcome of branch and bound."""

    proved: bool  # every cell was excluded
    cells: int  # looked at
    # a place that could not be excluded: values of the merged region's sides, then the extra
    # samples of delay, shape (sides + 1, 1); None if proved
    doubt: FloatArray | None = None
    spent: bool = False  # the budget ended it, no cell too narrow to be split


@dataclass(frozen=True, slots=True)
class Cells:
    """Lower and upper ends, shape (sides, cells): θ, gain, extra delay, sides of the region."""

    low: FloatArray
    high: FloatArray

    def __len__(self) -> int:
        return self.low.shape[1]

    def chosen(self, which: NDArray[np.bool_] | slice) -> Cells:
        """Some of the cells, by their places or by a mask."""
        return Cells(self.low[:, which], self.high[:, which])

    def with_(self, other: Cells) -> Cells:
        """These and others."""
        return Cells(np.hstack([self.low, other.low]), np.hstack([self.high, other.high]))


def decide(
    waiting: Cells,
    examine: Callable[[Cells], tuple[NDArray[np.bool_], FloatArray]],
    most_cells: int,
) -> Proof:
    """Split cells until what is to hold does in every one, or the budget is spent."""
    widest = (waiting.high - waiting.low).max(axis=1, keepdims=True)
    seen = 0
    while len(waiting):
        cells = waiting.chosen(slice(-_BATCH, None))
        waiting = waiting.chosen(slice(None, -_BATCH))
        seen += len(cells)
        # What holds, shape (cells,), and how much each side moves it, shape (sides, cells).
        holds, pull = examine(cells)
        open_ = cells.chosen(~holds)
        if not len(open_):
            continue
        parts, narrow = _branch(open_, pull[:, ~holds], widest)
        if narrow is not None or seen + len(waiting) + len(parts) > most_cells:
            index = 0 if narrow is None else narrow
            middle = (open_.low[:, index] + open_.high[:, index]) / 2
            doubt = np.append(middle[3:], middle[2])[:, None]
            return Proof(proved=False, cells=seen, doubt=doubt, spent=narrow is None)
        waiting = waiting.with_(parts)
    return Proof(proved=True, cells=seen)


def initial_cells(region: Region, claims: Sequence[Claim]) -> Cells:
    """Frequencies in steps of one ratio down to where the device's damping takes over."""
    least = min(1.0, max(1e-9, region.damping[0] * region.sample_time[0] / region.mass[1]))
    count = max(2, int(np.ceil(np.log(np.pi / (0.3 * least)) / np.log(_RATIO))))
    edges = np.concatenate([[0.0], np.pi * _RATIO ** -np.arange(count, -1.0, -1.0)])
    # Beyond π by a rounding: the response is symmetric there.
    edges[-1] = np.nextafter(np.pi, 4)
    columns: list[tuple[FloatArray, FloatArray]] = []
    for claim in claims:
        for extra, delay in _delays(region, claim.extra):
            lows, highs = np.array(replace(region, delay=delay).sides()).T
            if (both := region.reactive()) is not None:
                # One side is the way of both, the other is not looked at.
                wide = np.any(highs[[*both]] > lows[[*both]])
                lows[[*both]], highs[[*both]] = 0.0, [float(wide), 0.0]
            for bottom, top in pairwise(edges):
                columns.append(
                    (
                        np.array([bottom, 0.0, extra[0], *lows]),
                        np.array([top, claim.gain, extra[1], *highs]),
                    )
                )
    return Cells(
        np.column_stack([low for low, _ in columns]), np.column_stack([high for _, high in columns])
    )


def _delays(region: Region, extra: float) -> Iterator[tuple[Interval, Interval]]:
    """(extra samples, delay of the device) in pieces of half a sample of either."""
    step, (low, high) = region.sample_time[1], region.delay
    # Where the step is known and the delay is not, they are one side: the phase is of their sum.
    if region.sample_time[0] < step or low == high or not extra:
        pieces = max(1, int(np.ceil(2 * extra)))
        for piece in range(pieces):
            yield (extra * piece / pieces, extra * (piece + 1) / pieces), region.delay
        return
    # One step outwards against rounding of the sum.
    high = float(np.nextafter(high + extra * step, np.inf))
    ends = np.linspace(low, high, 1 + int(np.ceil(2 * (high - low) / step)))
    for start, end in pairwise(ends.tolist()):
        yield (0.0, 0.0), (start, end)


def _branch(cells: Cells, pull: FloatArray, widest: FloatArray) -> tuple[Cells, int | None]:
    """(halves across what moves the loop most, index of a cell too narrow to be split)."""
    pull = np.where(np.isfinite(pull), pull, 0.0)
    width = cells.high - cells.low
    relative = width / np.where(widest > 0, widest, 1.0)
    # Where nothing is bounded yet every side counts by its width.
    pull = np.where(pull.max(axis=0) > 0, pull, relative)
    pull = np.where(width > 0, pull, -1.0)
    order = np.argsort(-pull, axis=0, kind="stable")
    index = np.arange(len(cells))
    # A side too wide to be followed, as the delay is where a phase turns far, has no pull at all:
    # it has its turn when what would be split has become much narrower.
    starved = np.where(pull == 0, relative, 0.0)
    neglected = starved.max(axis=0) > _STARVED * relative[order[0], index]
    first = order[0]
    first[neglected] = starved.argmax(axis=0)[neglected]
    narrow = np.flatnonzero(relative[first, index] < _NARROWEST)
    if narrow.size:
        return cells, int(narrow[0])
    halves = _halved(cells, first)
    second = order[1]
    both = ~neglected & (pull[second, index] > _ALSO * pull[first, index])
    twice = np.concatenate([both, both])
    sides = np.concatenate([second, second])
    return (halves.chosen(~twice).with_(_halved(halves.chosen(twice), sides[twice])), None)


def _halved(cells: Cells, side: NDArray[np.intp]) -> Cells:
    index = np.arange(len(cells))
    low, high = cells.low[side, index], cells.high[side, index]
    middle = (low + high) / 2
    wide = (low > 0) & (high > _WIDE * low)
    middle[wide] = np.sqrt(low[wide] * high[wide])
    below, above = cells.high.copy(), cells.low.copy()
    below[side, index] = middle
    above[side, index] = middle
    return Cells(np.hstack([cells.low, above]), np.hstack([below, cells.high]))


def prove(
    region: Region,
    setting: Setting,
    claims: Sequence[Claim],
    most_cells: int,
    others: Sequence[Setting] = (),
    *,
    or_nothing: bool = False,
) -> Proof:
    """Exclude crossings everywhere in a region, for several claims at once."""
    region = region.merged()
    # With others, all that lies between the setting and these is played, and with nothing all
    # between it and nothing.
    corners = [(each, each.sizes) for each in (setting, *others)]
    proof = decide(
        initial_cells(region, claims),
        lambda cells: _exclusion_test(region, corners, cells, or_nothing=or_nothing),
        most_cells,
    )
    return proof if proof.doubt is None else replace(proof, doubt=values_of(region, proof.doubt))


def prove_all(
    region: Region, asked: Sequence[tuple[Setting, Sequence[Claim]]], most_cells: int
) -> list[Proof]:
    """One proof for each of some settings of the same filters, none of them nothing."""
    found: dict[int, Proof] = {}
    # Settings that play the same effects are examined in one run, as what takes time is how often
    # cells are examined, not how many; where that run leaves a doubt, each of them has its own.
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
    """Proofs of settings that play the same effects, from one run; None if it leaves a doubt."""
    region = region.merged()
    parts = [initial_cells(region, claims) for _, claims in asked]
    # A further side of each cell, without a width, is the number of its setting.
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
    """(no crossing in the cell, how much each side moves the loop)."""
    moving = [row for row in range(len(cells.low)) if np.any(cells.high[row] > cells.low[row])]
    symbols = [row for row in moving if row != 1]
    terms = terms_of(cells, symbols)
    theta, mechanism = mechanism_of(region, terms)
    low, high = cells.low[1], cells.high[1]
    with np.errstate(all="ignore"):
        plant = sampled_plant(theta, mechanism)
        found = [value_set(theta, mechanism, *corner, plant) for corner in corners]
        forms = [form for each in found for form in gain_vertices(each, low, high)]
        # D + s·N is straight in what is played: what lies between corners is in their convex hull.
        excluded = excludes_zero(*forms, *((found[0].start,) if or_nothing else ()))
        rising = [each.rising for each in found if each.rising is not None]
        if len(rising) == len(found) and region.damping[0] >= 0:
            excluded |= np.min(rising, axis=0) > 0
        pull = np.zeros_like(cells.low)
        pull[symbols] = np.max([np.abs(form.slopes) for form in forms], axis=0)
        # What is not straight comes from products: by the squares of their factors' slopes.
        factors = theta, plant.numerator, plant.denominator, *(each.varied for each in found)
        bent = np.sum([np.abs(each.slopes / each.centre) ** 2 for each in factors], axis=0)
        bent = np.nan_to_num(bent, posinf=1e6) + np.finfo(float).tiny
        rest = np.max([np.hypot(form.real, form.imag) for form in forms], axis=0)
        pull[symbols] += rest * bent / bent.sum(axis=0)
        pull[1] = np.max([np.abs(each.varied.centre) for each in found], axis=0) * (high - low) / 4
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


def mechanism_of(region: Region, terms: list[Term]) -> tuple[AffineForm, Mechanism]:
    """θ, and what may be anywhere in each cell, from the terms of its sides."""
    aliased, terms = _by_reactance(region, terms)
    theta, _, extra, mass, damping, step, delay, lag, slope, *rest = terms
    assert isinstance(theta, AffineForm)  # it always has a width
    hand = None
    if region.hand is not None:
        hand = (rest[0], rest[1], rest[2])
        rest = rest[3:]
    return theta, Mechanism(
        mass=mass,
        damping=damping,
        sample_time=step,
        delay=theta * 0.0 + (delay * inverse(step) + extra),
        lag=lag,
        position_stiffness=slope,
        hand=hand,
        modes=tuple((rest[2 * i], rest[2 * i + 1]) for i in range(len(region.modes))),
        participations=tuple((mode.at_encoder, mode.at_handle) for mode in region.modes),
        grounded=region.grounded,
        aliased=aliased,
    )


def _by_reactance(
    region: Region, terms: list[Term]
) -> tuple[tuple[Term, Term, Term] | None, list[Term]]:
    """(mass, that of the grip and its stiffness at aliases; terms with both of `reactive`)."""
    both = region.reactive()
    if both is None:
        return None, terms
    inertia, spring = (3 + place for place in both)
    (light, heavy), (soft, stiff) = (region.sides()[place] for place in both)
    # Aliases have another frequency: there both are whatever has the same reactance at some
    # frequency of the cell.
    theta, way, terms = terms[0], terms[inertia], list(terms)
    assert isinstance(theta, AffineForm)
    start, end = ends_of(way)
    slowest = np.maximum(ends_of(theta)[0], 0.0) / ends_of(terms[5])[1]
    more = (stiff - soft) / np.maximum(slowest, _STILL) ** 2
    least = np.maximum(heavy - end * (heavy - light + more), light)
    most = np.minimum(heavy - start * (heavy - light) + (1 - start) * more, heavy)
    known = anywhere_between(least, most, theta)
    springs = anywhere_between(np.full_like(least, soft), np.full_like(least, stiff), theta)
    terms[inertia] = way * -(heavy - light) + heavy
    terms[spring] = way * (stiff - soft) + soft
    return (known, 0.0, springs) if inertia == 3 else (terms[3], known, springs), terms


def values_of(region: Region, place: FloatArray) -> FloatArray:
    """All sides of a region at a place in doubt, both of `reactive` included."""
    if (both := region.reactive()) is not None:
        (light, heavy), (soft, stiff) = (region.sides()[each] for each in both)
        way, place = place[both[0]], place.copy()
        place[both[0]], place[both[1]] = heavy - way * (heavy - light), soft + way * (stiff - soft)
    return place
