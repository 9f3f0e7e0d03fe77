"""Search for the worst point of a region: a proof must not contradict what it finds.

From corners, faces and chance points, each the best of a start climbs to larger pole radius at the
full gain, and others to where the Nyquist curve comes nearest to -1/s for any gain s. It works in
doubles on the poles in z; only its best points are judged, in many digits. It can find that a proof
was wrong, and never that a region is stable. One file: box, climb and judgement of one search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import FloatArray
from tune.certificate.branch_and_bound import Claim
from tune.certificate.point import Point, Setting, groups_of_equal_effects
from tune.certificate.region import Region
from tune.certificate.roots import Verdict, judge
from tune.certificate.sampled_loops import Loops, sampled_loops, upper_half_circle

#: What a climb raises, of loops at gains of shape (points,); the answer has this shape too.
Aim = Callable[[Loops, FloatArray], FloatArray]

#: Sides up to which every corner is looked at; beyond, as many corners by chance.
_ALL_CORNERS = 6
_CHANCE_POINTS = 96
#: Best points that climb, for either aim.
_CLIMBERS = 4
#: Steps of a climb: from a quarter of a side down to 1/500.
_STEPS = 0.25 * 0.6 ** np.arange(10)
#: Points of the circle at which the Nyquist curve is looked at, and the slowest of them over π.
_CIRCLE = upper_half_circle(160, 1e-5)
#: Pole radius at the full gain, and nearness to -1/s of any gain s up to it.
_AIMS: tuple[Aim, Aim] = (
    lambda loops, gain: loops.radius(gain),
    lambda loops, gain: -loops.distance(gain, _CIRCLE),
)
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
    return worst_points_of_all(region, [(setting, claims)], starts, thorough)[0]


def worst_points_of_all(
    region: Region,
    asked: Sequence[tuple[Setting, Sequence[Claim]]],
    starts: FloatArray | None = None,
    thorough: int = 1,
) -> list[list[WorstCase]]:
    """Search a region for the claims of each of some settings of the same filters.

    Settings that play the same effects climb at once, for what takes time is how often loops are
    computed, not how many. Arguments as of ``worst_points``; the starts have shape (sides + 1,
    starts).

    Returns:
        One list a setting, in their order, of one a claim.
    """
    found: list[list[WorstCase]] = [[] for _ in asked]
    for numbers in groups_of_equal_effects([setting for setting, _ in asked]):
        settings = [asked[number][0] for number in numbers]
        boxes = [
            _Box.of(region, which, claim)
            for which, number in enumerate(numbers)
            for claim in asked[number][1]
        ]
        for box, candidates in _climbed(region, settings, boxes, starts, thorough):
            worst = _worst(region, settings[box.which], box, candidates)
            found[numbers[box.which]].append(worst)
    return found


def _climbed(
    region: Region,
    settings: Sequence[Setting],
    boxes: Sequence[_Box],
    starts: FloatArray | None,
    thorough: int,
) -> Iterator[tuple[_Box, FloatArray]]:
    """Each box and the places where climbing in it ended, one a column, values on all sides."""
    parts = [box.starts(starts, thorough) for box in boxes]

    def loops_at(
        where: Sequence[_Box], places: Sequence[FloatArray]
    ) -> tuple[Loops, FloatArray, list[int]]:
        """Loops at places of each box, the gain of each, and how many a box has."""
        counts = [each.shape[1] for each in places]
        values = np.hstack([box.unfolded(each) for box, each in zip(where, places, strict=True)])
        which = np.repeat([box.which for box in where], counts)
        gain = np.repeat([box.claim.gain for box in where], counts)
        return sampled_loops(region, settings, values[:-1], values[-1], which), gain, counts

    loops, gain, counts = loops_at(boxes, parts)
    ends = np.cumsum(counts)[:-1]
    climbs = [
        _Climb.of(box, each, aim, scores, _CLIMBERS * thorough)
        for aim in _AIMS
        for box, each, scores in zip(boxes, parts, np.split(aim(loops, gain), ends), strict=True)
    ]
    rising = [each for each in climbs if len(each.box.free)]
    for step in _STEPS if rising else ():
        tried = [each.tried(step) for each in rising]
        loops, gain, counts = loops_at([each.box for each in rising], tried)
        scores = np.empty(len(gain))
        for aim in _AIMS:
            rows = np.repeat([each.aim is aim for each in rising], counts)
            scores[rows] = aim(loops.chosen(rows), gain[rows])
        for each, x, own in zip(
            rising, tried, np.split(scores, np.cumsum(counts)[:-1]), strict=True
        ):
            each.take(x, own)
    for box in boxes:
        yield box, np.hstack([each.highest() for each in climbs if each.box is box])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Box:
    """The sides of a region and the extra delay of a claim.

    Attributes:
        which: number of the setting.
        claim: gain and extra delay.
        low: ends of the sides, the extra delay last.
        high: likewise.
        free: sides that have a width.
    """

    which: int
    claim: Claim
    low: FloatArray
    high: FloatArray
    free: NDArray[np.intp]

    @classmethod
    def of(cls, region: Region, which: int, claim: Claim) -> _Box:
        """The box of a region and a claim."""
        low, high = np.array((*region.sides(), (0.0, claim.extra))).T
        return cls(which=which, claim=claim, low=low, high=high, free=np.flatnonzero(high > low))

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
