"""The worst point of a region by search: what a proof must not contradict.

From corners, faces and chance points, each the best of a start climbs to larger pole radius at the
full gain, and others to where the Nyquist curve comes nearest to -1/s for any gain s. It works in
doubles on the poles in z; only its best points are judged, in many digits. It can find that a proof
was wrong, and never that a region is stable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from tune.certificate.forms import FloatArray
from tune.certificate.point import Point, Setting
from tune.certificate.proof import Claim
from tune.certificate.region import Region
from tune.certificate.roots import Verdict, judge
from tune.certificate.sampled import sampled_loops, whole_circle

#: Sides up to which every corner is looked at; beyond, as many corners by chance.
_ALL_CORNERS = 6
_CHANCE_POINTS = 96
#: Best points that climb, for either aim.
_CLIMBERS = 4
#: Steps of a climb: from a quarter of a side down to 1/500.
_STEPS = 0.25 * 0.6 ** np.arange(10)
#: Points of the circle at which the Nyquist curve is looked at, and the slowest of them over π.
_CIRCLE = whole_circle(160, 1e-5)
#: The generator of chance points starts here, so that a certificate can be repeated.
_SEED = 20_240_607


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
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
) -> Worst:
    """Search a region.

    Args:
        region: the box.
        setting: what is played.
        claim: gain and extra delay.
        starts: further starting points, one a column: the region's sides, then extra samples.
        thorough: multiplies chance points and climbers.
    """
    sides = (*region.sides(), (0.0, claim.extra))
    low, high = np.array(sides).T
    free = np.flatnonzero(high > low)

    def unfolded(parts: FloatArray) -> FloatArray:
        values = np.repeat(((low + high) / 2)[:, None], parts.shape[1], axis=1)
        # Ends are met exactly.
        within = low[free, None] * (1 - parts) + high[free, None] * parts
        values[free] = within
        return values

    def radius(values: FloatArray) -> FloatArray:
        loops = sampled_loops(region, setting, values[:-1], values[-1])
        return loops.radius(claim.gain)

    def nearness(values: FloatArray) -> FloatArray:
        loops = sampled_loops(region, setting, values[:-1], values[-1])
        return -loops.distance(claim.gain, _CIRCLE)

    parts = _starts(len(free), thorough)
    if starts is not None and starts.size:
        width = (high - low)[free, None]
        parts = np.hstack([parts, np.clip((starts[free] - low[free, None]) / width, 0, 1)])
    found: list[FloatArray] = []
    for aim in (radius, nearness):
        if not len(free):
            found.append(parts[:, :1])
            continue
        scores = aim(unfolded(parts))
        best = parts[:, np.argsort(-scores, kind="stable")[: _CLIMBERS * thorough]]
        found.append(_climbed(best, lambda x, aim=aim: aim(unfolded(x))))
    worst: Worst | None = None
    candidates = unfolded(np.hstack(found))
    for column in candidates.T:
        point = region.point(column[:-1], float(column[-1]))
        verdict = judge(point, setting, claim.gain)
        one = Worst(point=point, verdict=verdict, judged=candidates.shape[1])
        if worst is None or _badness(verdict) > _badness(worst.verdict):
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


def _climbed(parts: FloatArray, aim: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Each column moved along its sides as long as that raises the aim; only the best two kept."""
    count, climbers = parts.shape
    parts = parts.copy()
    best = aim(parts)
    index = np.arange(climbers, dtype=np.intp)
    moves = np.hstack([np.eye(count), -np.eye(count)])
    for step in _STEPS:
        tried = np.clip(parts[:, :, None] + step * moves[:, None, :], 0, 1)
        scores = aim(tried.reshape(count, -1)).reshape(climbers, -1)
        chosen = scores.argmax(axis=1)
        better = scores[index, chosen] > best
        best = np.where(better, scores[index, chosen], best)
        parts[:, better] = tried[:, index, chosen][:, better]
    return parts[:, np.argsort(-best, kind="stable")[:2]]
