"""Search for the worst point of a region: a proof must not contradict what it finds.

From corners, faces and chance points, each the best of a start climbs to larger pole radius at the
full gain, and others to where the Nyquist curve comes nearest to -1/s for any gain s. It works in
doubles on the poles in z; only its best points are judged, in many digits. It can find that a proof
was wrong, and never that a region is stable. One file: box, climb and judgement of one search.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import FloatArray
from tune.certificate.point import Point, Setting
from tune.certificate.region import Region
from tune.certificate.roots import Verdict, judge
from tune.certificate.sampled_loops import Loops, sampled_loops, upper_half_circle
from tune.certificate.zero_exclusion import Claim

#: What a climb raises, of every loop.
Aim = Callable[[Loops], FloatArray]

#: Sides up to which every corner is looked at; beyond, as many corners by chance.
_ALL_CORNERS = 6
_CHANCE_POINTS = 96
#: Best points that climb, for either aim.
_CLIMBERS = 4
#: Steps of a climb: from a quarter of a side down to 1/500.
_STEPS = 0.25 * 0.6 ** np.arange(10)
#: Points of the circle at which the Nyquist curve is looked at, and the slowest of them over π.
_CIRCLE = upper_half_circle(160, 1e-5)
#: The generator of chance points starts here, so that a certificate can be repeated.
_SEED = 20_240_607


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstCase:
    """The worst point found, and what many digits say of it; how many points they looked at."""

    point: Point
    verdict: Verdict
    judged: int


def worst_point(
    region: Region,
    setting: Setting,
    claim: Claim,
    starts: FloatArray | None = None,
    thorough: int = 1,
) -> WorstCase:
    """Search a region for one claim; see ``worst_points``.

    The starts have shape (sides + 1, starts), SI units and samples.
    """
    return worst_points(region, setting, [claim], starts, thorough)[0]


def worst_points(
    region: Region,
    setting: Setting,
    claims: Sequence[Claim],
    starts: FloatArray | None = None,
    thorough: int = 1,
) -> list[WorstCase]:
    """Search a region for each of some claims.

    All climb at once, for what takes time is how often loops are computed, not how many.

    The starts have shape (sides + 1, starts), SI units and samples.

    Args:
        region: the box.
        setting: what is played.
        claims: gain and extra delay of each.
        starts: further starting points, one a column: the region's sides, then extra samples.
        thorough: multiplies chance points and climbers.

    Returns:
        One a claim, in their order.
    """
    boxes = [_Box.of(region, claim) for claim in claims]
    parts = [box.starts(starts, thorough) for box in boxes]

    def loops_at(places: Sequence[FloatArray]) -> list[Loops]:
        values = np.hstack(places)
        loops = sampled_loops(region, setting, values[:-1], values[-1])
        ends = np.cumsum([each.shape[1] for each in places])
        return [
            loops.rows(end - each.shape[1], end) for end, each in zip(ends, places, strict=True)
        ]

    begun = loops_at([box.unfolded(each) for box, each in zip(boxes, parts, strict=True)])
    climbs = [
        _Climb.of(box, each, aim, aim(loops), _CLIMBERS * thorough)
        for box, each, loops in zip(boxes, parts, begun, strict=True)
        for aim in box.aims()
    ]
    rising = [each for each in climbs if len(each.box.free)]
    for step in _STEPS if rising else ():
        tried = [each.tried(step) for each in rising]
        found = loops_at([each.box.unfolded(x) for each, x in zip(rising, tried, strict=True)])
        for each, x, loops in zip(rising, tried, found, strict=True):
            each.take(x, each.aim(loops))
    return [
        _worst(
            region, setting, box, np.hstack([each.highest() for each in climbs if each.box is box])
        )
        for box in boxes
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Box:
    """The sides of a region and the extra delay of a claim.

    Attributes:
        claim: gain and extra delay.
        low: ends of the sides, the extra delay last.
        high: likewise.
        free: sides that have a width.
    """

    claim: Claim
    low: FloatArray
    high: FloatArray
    free: NDArray[np.intp]

    @classmethod
    def of(cls, region: Region, claim: Claim) -> _Box:
        """The box of a region and a claim."""
        low, high = np.array((*region.sides(), (0.0, claim.extra))).T
        return cls(claim=claim, low=low, high=high, free=np.flatnonzero(high > low))

    def starts(self, more: FloatArray | None, thorough: int) -> FloatArray:
        """Where climbs may begin, parts of each free side, one a column."""
        parts = _starts(len(self.free), thorough)
        if more is None or not more.size:
            return parts
        low = self.low[self.free, None]
        width = self.high[self.free, None] - low
        return np.hstack([parts, np.clip((more[self.free] - low) / width, 0, 1)])

    def unfolded(self, parts: FloatArray) -> FloatArray:
        """Values on all sides, one column a point; ends are met exactly."""
        values = np.repeat(((self.low + self.high) / 2)[:, None], parts.shape[1], axis=1)
        low, high = self.low[self.free, None], self.high[self.free, None]
        values[self.free] = low * (1 - parts) + high * parts
        return values

    def aims(self) -> tuple[Aim, Aim]:
        """Pole radius at the full gain, and nearness to -1/s of any gain s."""
        gain = self.claim.gain
        return (lambda loops: loops.radius(gain), lambda loops: -loops.distance(gain, _CIRCLE))


@dataclass(slots=True, kw_only=True, eq=False)
class _Climb:
    """Points that move along the sides of a box as long as that raises an aim.

    Attributes:
        box: they stay in.
        aim: that is raised.
        parts: of each free side, one column a point.
        best: the aim at each.
    """

    box: _Box
    aim: Aim
    parts: FloatArray
    best: FloatArray

    @classmethod
    def of(
        cls, box: _Box, parts: FloatArray, aim: Aim, scores: FloatArray, climbers: int
    ) -> _Climb:
        """From the best of some points with known scores."""
        best = np.argsort(-scores, kind="stable")[:climbers]
        return cls(box=box, aim=aim, parts=parts[:, best], best=scores[best])

    def tried(self, step: float) -> FloatArray:
        """Each point moved by a step along each side, both ways; one column a move."""
        count = len(self.parts)
        moves = np.hstack([np.eye(count), -np.eye(count)])
        return np.clip(self.parts[:, :, None] + step * moves[:, None, :], 0, 1).reshape(count, -1)

    def take(self, tried: FloatArray, scores: FloatArray) -> None:
        """Make each point's best move, if that is better than none."""
        count, climbers = self.parts.shape
        index = np.arange(climbers, dtype=np.intp)
        scores = scores.reshape(climbers, -1)
        chosen = scores.argmax(axis=1)
        better = scores[index, chosen] > self.best
        self.best = np.where(better, scores[index, chosen], self.best)
        moved = tried.reshape(count, climbers, -1)[:, index, chosen]
        self.parts[:, better] = moved[:, better]

    def highest(self) -> FloatArray:
        """The best two, or the only place there is, as values on all sides."""
        count = 2 if len(self.box.free) else 1
        return self.box.unfolded(self.parts[:, np.argsort(-self.best, kind="stable")[:count]])


def _worst(region: Region, setting: Setting, box: _Box, candidates: FloatArray) -> WorstCase:
    """The worst of some points, one a column, in many digits; one met twice is judged once."""
    worst: WorstCase | None = None
    known: dict[bytes, WorstCase] = {}
    for column in candidates.T:
        place = column.tobytes()
        if place not in known:
            point = region.point(column[:-1], float(column[-1]))
            verdict = judge(point, setting, box.claim.gain)
            known[place] = WorstCase(point=point, verdict=verdict, judged=candidates.shape[1])
        one = known[place]
        if worst is None or _badness(one.verdict) > _badness(worst.verdict):
            worst = one
    assert worst is not None
    return worst


def _badness(verdict: Verdict) -> tuple[bool, float]:
    return verdict.answer != "stable", verdict.radius


def _starts(count: int, thorough: int) -> FloatArray:
    """Corners, points on edges and faces, points inside; parts of each side, one a column."""
    chance = np.random.default_rng(_SEED)
    if count <= _ALL_CORNERS:
        corners = np.array(list(product((0.0, 1.0), repeat=count))).T.reshape(count, 2**count)
    else:
        corners = chance.integers(0, 2, (count, 2**_ALL_CORNERS)).astype(float)
    inside = chance.random((count, _CHANCE_POINTS * thorough))
    # Half of the chance points on edges and faces: there limits bind.
    inside[:, ::2] = np.clip(np.round(3 * inside[:, ::2] - 1, 1), 0, 1)
    return np.hstack([corners, inside])
