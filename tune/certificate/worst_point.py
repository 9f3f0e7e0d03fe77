"""Search for the worst point of a region: a proof must not contradict what it finds.

From corners, faces and chance points, each the best of a start climbs to larger pole radius at the
full gain, and others to where the Nyquist curve comes nearest to -1/s for any gain s. It works in
doubles on the poles in z; only its best points are judged, in many digits. It can find that a proof
was wrong, and never that a region is stable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tune.certificate.affine import ComplexArray, FloatArray
from tune.certificate.poles import Verdict, judge, law_in_doubles
from tune.certificate.region import Point, Region, Setting, groups_of_equal_effects
from tune.certificate.time_domain import held_motion, state_space
from tune.certificate.zero_exclusion import Claim


@dataclass(frozen=True, slots=True)
class Loops:
    """Descending coefficients in z of D and N of D + s·N, each (points, degree + 1).

    Where nothing holds the position, the pole z = 1 of free motion has been divided out.
    """

    open: FloatArray
    feedback: FloatArray

    def radius(self, gain: float | FloatArray) -> FloatArray:
        """Largest pole modulus at a gain, or one a point; inf where doubles overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            full = self.open + np.reshape(gain, (-1, 1)) * self.feedback
            # Poles at zero that all loops have in common are left out.
            full = full[:, : np.flatnonzero(full.any(axis=0))[-1] + 1]
            monic = full[:, 1:] / full[:, :1]
        size = monic.shape[1]
        companion = np.zeros((len(full), size, size))
        companion[:, 0, :] = -monic
        companion[:, np.arange(1, size), np.arange(size - 1)] = 1.0
        radius = np.full(len(full), np.inf)
        finite = np.isfinite(monic).all(axis=1)
        radius[finite] = np.abs(np.linalg.eigvals(companion[finite])).max(axis=1)
        return radius

    def distance(self, gain: float | FloatArray, z: ComplexArray) -> FloatArray:
        """Least |1 + s·L| over the given points of the circle and every gain in [0, gain]."""
        # Powers of z that all loops have in common are left out.
        used = (
            int(np.flatnonzero((self.open != 0).any(axis=0) | (self.feedback != 0).any(axis=0))[-1])
            + 1
        )
        powers = np.vander(z, used).T
        (d, e), (n, m) = (
            (part[:, :used] @ powers.real, part[:, :used] @ powers.imag)
            for part in (self.open, self.feedback)
        )
        with np.errstate(all="ignore"):
            # L = (n + jm)/(d + je).
            nearest = np.clip(-(n * d + m * e) / (n * n + m * m), 0, np.reshape(gain, (-1, 1)))
            size = ((d + nearest * n) ** 2 + (e + nearest * m) ** 2) / (d * d + e * e)
        # A loop too weak or too strong for doubles comes near -1 nowhere that they can tell.
        return np.sqrt(np.min(np.where(np.isnan(size), np.inf, size), axis=1))


# What doubles cannot hold is looked at in many digits.
@np.errstate(over="ignore", invalid="ignore")
def sampled_loops(
    region: Region,
    settings: Sequence[Setting],
    values: FloatArray,
    extra: FloatArray,
    which: NDArray[np.intp] | None = None,
) -> Loops:
    """Loops at points of a region: one column of values a point, rows as in `Region.sides`.

    All settings play the same effects with the same filters; `which` tells that of each point, None
    the first at all of them.
    """
    motion, drive, read = state_space(region, values)
    step, delay = values[2], values[3]
    late = delay / step + extra
    whole = np.floor(late + 1e-9)
    fraction = np.clip(late - whole, 0.0, 1.0)
    times = np.stack([(1 - fraction) * step, fraction * step])
    (after, before), (new, early) = held_motion(motion, drive, times)
    transition, old = after @ before, (after @ early[..., None])[..., 0]
    denominator, by_new, by_old = _resolvent(transition, read, new, old)
    numerator = np.pad(by_new, ((0, 0), (0, 1))) + np.pad(by_old, ((0, 0), (1, 0)))
    which = np.zeros(len(step), dtype=np.intp) if which is None else which
    top, bottom = _laws(settings, which, step)
    if not settings[0].stiffness:
        if region.grounded:
            top = _convolved(top, np.array([[1.0, -1.0]]))
        else:
            # Free motion: divided by z - 1, the remainder being nothing but rounding.
            denominator = np.cumsum(denominator, axis=1)[:, :-1]
    most = int(whole.max())
    length = denominator.shape[1] + bottom.shape[1] + most
    open_ = np.pad(_convolved(denominator, bottom), ((0, 0), (0, most + 1)))
    feedback = np.zeros_like(open_)
    product = _convolved(numerator, top)
    for count in np.flatnonzero(np.bincount(whole.astype(np.intp))):
        rows = whole == count
        # D has its highest power first and most + 1 zeros behind; N ends at its own delay.
        end = length - (most - int(count))
        feedback[rows, end - product.shape[1] : end] = product[rows]
    return Loops(open_, feedback)


def _resolvent(
    transition: FloatArray, read: FloatArray, *drives: FloatArray
) -> tuple[FloatArray, ...]:
    """det(zI - Φ), and C·adj(zI - Φ)·Γ for each Γ; descending in z, by Faddeev and LeVerrier."""
    points, size = transition.shape[0], transition.shape[-1]
    adjugate = np.broadcast_to(np.eye(size), transition.shape)
    determinant = [np.ones(points)]
    numerators: list[list[FloatArray]] = [[] for _ in drives]
    for order in range(1, size + 1):
        for numerator, drive in zip(numerators, drives, strict=True):
            numerator.append((adjugate @ drive[..., None])[..., 0] @ read)
        product = transition @ adjugate
        coefficient = -np.trace(product, axis1=-2, axis2=-1) / order
        determinant.append(coefficient)
        adjugate = product + coefficient[:, None, None] * np.eye(size)
    return (
        np.stack(determinant, axis=1),
        *(np.stack(numerator, axis=1) for numerator in numerators),
    )


def _laws(
    settings: Sequence[Setting], which: NDArray[np.intp], step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator of the law of each point; a zero at z = 1 left out."""
    steps, at = np.unique(step, return_inverse=True)
    kinds, kind = np.unique(which * len(steps) + at, return_inverse=True)
    numbers: list[int] = kinds.tolist()
    pairs = [divmod(number, len(steps)) for number in numbers]
    laws = [_law_at(settings[setting], float(steps[place])) for setting, place in pairs]
    return np.array([top for top, _ in laws])[kind], np.array([low for _, low in laws])[kind]


@lru_cache(maxsize=1024)
def _law_at(setting: Setting, step: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Numerator and denominator of the law at one sample time, of equal length."""
    top, bottom, _ = law_in_doubles(setting, step)
    return (*[0.0] * (len(bottom) - len(top)), *top.tolist()), tuple(bottom.tolist())


def _convolved(a: FloatArray, b: FloatArray) -> FloatArray:
    product = np.zeros((len(a), a.shape[1] + b.shape[1] - 1))
    for power in range(b.shape[1]):
        product[:, power : power + a.shape[1]] += a * b[:, power : power + 1]
    return product


#: What a climb raises, of loops at gains of shape (points,); the answer has this shape too.
_Aim = Callable[[Loops, FloatArray], FloatArray]

#: Sides up to which every corner is looked at; beyond, as many corners by chance.
_ALL_CORNERS = 6
_CHANCE_POINTS = 96
#: Best points that climb, for either aim.
_CLIMBERS = 4
#: Steps of a climb: from a quarter of a side down to 1/500.
_STEPS = 0.25 * 0.6 ** np.arange(10)
#: Points of the circle at which the Nyquist curve is looked at, and the slowest of them over π.
_CIRCLE = np.exp(1j * np.pi * np.geomspace(1e-5, 1.0, 160))
#: Pole radius at the full gain, and nearness to -1/s of any gain s up to it.
_AIMS: tuple[_Aim, _Aim] = (
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


def worst_points(
    region: Region,
    setting: Setting,
    claims: Sequence[Claim],
    starts: FloatArray | None = None,
    thorough: int = 1,
) -> list[WorstCase]:
    """Search a region for each of some claims.

    The starts are further points, one a column: the region's sides, then extra samples. Chance
    points and climbers are multiplied by `thorough`.
    """
    return worst_points_of_all(region, [(setting, claims)], starts, thorough)[0]


def worst_points_of_all(
    region: Region,
    asked: Sequence[tuple[Setting, Sequence[Claim]]],
    starts: FloatArray | None = None,
    thorough: int = 1,
) -> list[list[WorstCase]]:
    """Search a region for the claims of each of some settings of the same filters."""
    found: list[list[WorstCase]] = [[] for _ in asked]
    # Settings that play the same effects climb at once, for what takes time is how often loops are
    # computed, not how many.
    for numbers in groups_of_equal_effects([setting for setting, _ in asked]):
        settings = [asked[number][0] for number in numbers]
        boxes = [
            _Box.of(region, which, claim)
            for which, number in enumerate(numbers)
            for claim in asked[number][1]
        ]
        if not boxes:  # claims of another group cover all of these
            continue
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
    climbs: list[_Climb] = []
    for aim in _AIMS:
        for box, each, scores in zip(boxes, parts, np.split(aim(loops, gain), ends), strict=True):
            best = np.argsort(-scores, kind="stable")[: _CLIMBERS * thorough]
            climbs.append(_Climb(box=box, aim=aim, parts=each[:, best], best=scores[best]))
    rising = [each for each in climbs if len(each.box.free)]
    for step in _STEPS if rising else ():
        tried = [each.tried(step) for each in rising]
        loops, gain, counts = loops_at([each.box for each in rising], tried)
        scores = np.empty(len(gain))
        for aim in _AIMS:
            rows = np.repeat([each.aim is aim for each in rising], counts)
            scores[rows] = aim(Loops(loops.open[rows], loops.feedback[rows]), gain[rows])
        for each, x, own in zip(
            rising, tried, np.split(scores, np.cumsum(counts)[:-1]), strict=True
        ):
            each.take(x, own)
    for box in boxes:
        yield box, np.hstack([each.highest() for each in climbs if each.box is box])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Box:
    """The sides of a region and the extra delay of a claim."""

    which: int  # number of the setting
    claim: Claim  # gain and extra delay
    low: FloatArray  # ends of the sides, the extra delay last
    high: FloatArray  # likewise
    free: NDArray[np.intp]  # sides that have a width

    @classmethod
    def of(cls, region: Region, which: int, claim: Claim) -> _Box:
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
    """Points that move along the sides of a box as long as that raises an aim."""

    box: _Box  # they stay in
    aim: _Aim  # that is raised
    parts: FloatArray  # of each free side, one column a point
    best: FloatArray  # the aim at each

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
    known: dict[bytes, WorstCase] = {}
    for column in candidates.T:
        place = column.tobytes()
        if place not in known:
            point = region.point(column[:-1], float(column[-1]))
            verdict = judge(point, setting, box.claim.gain)
            known[place] = WorstCase(point=point, verdict=verdict, judged=candidates.shape[1])
    return max(
        known.values(), key=lambda each: (each.verdict.answer != "stable", each.verdict.radius)
    )


@lru_cache(maxsize=16)
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
    starts = np.hstack([corners, inside])
    starts.setflags(write=False)
    return starts
