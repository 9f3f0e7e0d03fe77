"""Branch and bound: split a region into cells until a condition holds in every one of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import FloatArray
from tune.certificate.region import Region

#: Cells looked at together: enough to keep numpy busy, few enough to stay in the cache.
_BATCH = 4096
#: Cells narrower than this, relative to the region, in whatever would be split next: a crossing is
#: all but certain there, and doubles would not tell otherwise.
_NARROWEST = 1e-9
#: Ratio of neighbouring frequencies to begin with.
_RATIO = 1.5
#: A side that moves nothing is split when it is so many times wider than what would be.
_STARVED = 16.0
#: A second side is split at once if it moves the loop by more than this part of the first.
_ALSO = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """What is to hold in the whole region: every gain in (0, gain], delay up to extra samples."""

    gain: float
    extra: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Outcome of branch and bound.

    Attributes:
        proved: every cell was excluded.
        cells: looked at.
        doubt: a place that could not be excluded: values of the merged region's sides, then the
            extra samples of delay, shape (sides + 1, 1); None if proved.
    """

    proved: bool
    cells: int
    doubt: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Cells:
    """Lower and upper ends, shape (sides, cells): θ, gain, extra delay, sides of the region."""

    low: FloatArray
    high: FloatArray

    def __len__(self) -> int:
        return self.low.shape[1]

    def chosen(self, which: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Cells:
        """Some of the cells, by their places or by a mask of shape (cells,)."""
        return Cells(self.low[:, which], self.high[:, which])

    def with_(self, other: Cells) -> Cells:
        """These and others."""
        return Cells(np.hstack([self.low, other.low]), np.hstack([self.high, other.high]))


#: (what is to hold holds in each cell, how much each side moves it).
Examine = Callable[[Region, Cells], tuple[NDArray[np.bool_], FloatArray]]


def branch_and_bound(
    region: Region, claims: Sequence[Claim], examine: Examine, most_cells: int
) -> Proof:
    """Split a region until everything asked for holds in every cell.

    Args:
        region: the box.
        claims: gains and extra delays.
        examine: is called with the merged region and some of its cells.
        most_cells: budget.
    """
    region = region.merged()
    return decide(initial_cells(region, claims), lambda cells: examine(region, cells), most_cells)


def decide(
    waiting: Cells,
    examine: Callable[[Cells], tuple[NDArray[np.bool_], FloatArray]],
    most_cells: int,
) -> Proof:
    """Split cells until what is to hold does in every one, or the budget is spent.

    Args:
        waiting: cells to begin with.
        examine: of some cells: what holds, shape (cells,), and how much each side moves it, shape
            (sides, cells).
        most_cells: budget.
    """
    widest = (waiting.high - waiting.low).max(axis=1, keepdims=True)
    seen = 0
    while len(waiting):
        cells = waiting.chosen(slice(-_BATCH, None))
        waiting = waiting.chosen(slice(None, -_BATCH))
        seen += len(cells)
        holds, pull = examine(cells)
        open_ = cells.chosen(~holds)
        if not len(open_):
            continue
        parts, narrow = _branch(open_, pull[:, ~holds], widest)
        if narrow is not None or seen + len(waiting) + len(parts) > most_cells:
            index = 0 if narrow is None else narrow
            middle = (open_.low[:, index] + open_.high[:, index]) / 2
            return Proof(proved=False, cells=seen, doubt=np.append(middle[3:], middle[2])[:, None])
        waiting = waiting.with_(parts)
    return Proof(proved=True, cells=seen)


def initial_cells(region: Region, claims: Sequence[Claim]) -> Cells:
    """Frequencies in steps of one ratio down to where the device's damping takes over."""
    least = min(1.0, max(1e-9, region.damping[0] * region.sample_time[0] / region.mass[1]))
    count = max(2, int(np.ceil(np.log(np.pi / (0.3 * least)) / np.log(_RATIO))))
    edges = np.concatenate([[0.0], np.pi * _RATIO ** -np.arange(count, -1.0, -1.0)])
    # Beyond π by a rounding: the response is symmetric there.
    edges[-1] = np.nextafter(np.pi, 4)
    lows, highs = np.array(region.sides()).T
    columns: list[tuple[FloatArray, FloatArray]] = []
    for claim in claims:
        pieces = max(1, int(np.ceil(2 * claim.extra)))
        for piece in range(pieces):
            start, end = claim.extra * piece / pieces, claim.extra * (piece + 1) / pieces
            for bottom, top in pairwise(edges):
                columns.append(
                    (
                        np.array([bottom, 0.0, start, *lows]),
                        np.array([top, claim.gain, end, *highs]),
                    )
                )
    return Cells(
        np.column_stack([low for low, _ in columns]), np.column_stack([high for _, high in columns])
    )


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
    return (
        halves.chosen(~twice).with_(_halved(halves.chosen(twice), sides[twice])),
        None,
    )


def _halved(cells: Cells, side: NDArray[np.intp]) -> Cells:
    index = np.arange(len(cells))
    middle = (cells.low[side, index] + cells.high[side, index]) / 2
    below, above = cells.high.copy(), cells.low.copy()
    below[side, index] = middle
    above[side, index] = middle
    return Cells(np.hstack([cells.low, above]), np.hstack([below, cells.high]))
