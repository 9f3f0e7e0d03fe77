"""The lexicographic optimum of elements that share moments, by search from many places."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from tests.optimum_reference import Reference

FloatArray = NDArray[np.float64]

#: A search that ends further than this beyond a limit, in log-sizes, has not ended.
_BEYOND = 1e-5
#: Floors may be missed by this much in steps where a point is moved back onto the boundary.
_FLOOR = 1e-9
#: ... and by this much in the first round, steps.
_LOOSE = 1e-5
#: The best of the first round that are gone over again.
_AGAIN = 4
#: Heights closer than this, in steps, are one.
_TIE = 1e-6
#: Unknowns up to which the grid around the best has five points a side; two beyond.
_FEW = 3
#: Log-offsets of that grid.
_OFFSETS = (1e-4, 1e-2, 0.2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """How much higher the search stood than an answer, relative or in steps if that is less."""

    what: str
    reached: float
    best: float
    sizes: FloatArray

    @property
    def relative(self) -> float:
        return (self.best - self.reached) / max(1.0, abs(self.best))


def gaps(
    reference: Reference,
    sizes: FloatArray,
    *,
    starts: int,
    rng: np.random.Generator,
    fine: bool = True,
) -> Iterator[Gap]:
    """Everything by which an answer falls short of the lexicographic optimum.

    Of each priority, with what the search reached before as floors: the least height; of those that
    share it, each that could grow together with all that stand higher; then the least of the rest.

    Args:
        reference: what bounds the answer.
        sizes: the answer.
        starts: searches for each least height, a fifth of them for the heights after it.
        rng: of the starts.
        fine: with a grid around the best.
    """
    heights = reference.heights(sizes)
    place = np.log(sizes)
    floors: dict[int, float] = {}
    for level in sorted({one.level for one in reference.wanted}):
        active = [i for i, one in enumerate(reference.wanted) if one.level == level]
        count = starts
        while active:
            lowest = float(np.min(heights[active]))
            equals = [i for i in active if heights[i] <= lowest + _TIE]
            higher = [i for i in active if i not in equals]
            least, place = highest(reference, active, floors, known=place, starts=count, rng=rng)
            if fine and not floors:
                least, place = _on_grid(reference, active, place)
            yield _gap(reference, active, heights, least, place)
            count = max(starts // 5, 4)
            reached = dict.fromkeys(equals, least)
            for i in equals if len(equals) > 1 else ():
                raised, kept = [i, *higher], {j: reached[j] for j in equals if j != i}
                reached[i], place = highest(
                    reference, raised, floors | kept, known=place, starts=count, rng=rng
                )
                yield _gap(reference, raised, heights, reached[i], place)
            floors |= reached
            active = higher


def _gap(
    reference: Reference, raised: list[int], heights: FloatArray, best: float, place: FloatArray
) -> Gap:
    return Gap(
        what=" and ".join(reference.wanted[i].label for i in raised),
        reached=float(np.min(heights[raised])),
        best=best,
        sizes=np.exp(place),
    )


def local(
    reference: Reference,
    raised: Sequence[int],
    floors: dict[int, float],
    start: FloatArray,
    *,
    tolerance: float = 1e-13,
    rounds: int = 100,
) -> tuple[float, FloatArray] | None:
    """Height and log-sizes where the least of the raised heights ends that starts there."""
    signs = np.array([w.sign for w in reference.wanted])
    references = np.array([w.reference for w in reference.wanted])
    units = np.array([w.unit for w in reference.wanted])
    wanted = [*raised, *floors]
    known: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def limits(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = x.tobytes()
        if key not in known:
            known.clear()
            place = np.clip(x[:-1], reference.low, reference.high)
            value, slope = reference.rows(place)
            sizes = np.exp(place)
            rates = units * sizes / (references + signs * sizes)
            aims = [x[-1]] * len(raised) + list(floors.values())
            above = reference.heights(sizes)[wanted] - aims
            rows = np.zeros((len(value) + len(wanted), reference.count + 1))
            rows[: len(value), :-1] = slope
            for row, index in enumerate(wanted, start=len(value)):
                rows[row, index] = rates[index]
            rows[len(value) : len(value) + len(raised), -1] = -1.0
            known[key] = np.concatenate([value, above]), rows
        return known[key]

    first = min(reference.heights(np.exp(start))[list(raised)])
    constraints: dict[str, Any] = {
        "type": "ineq",
        "fun": lambda x: limits(x)[0],
        "jac": lambda x: limits(x)[1],
    }
    search: Any = minimize  # its stubs know no dictionary of constraints
    answer = search(
        lambda x: -x[-1],
        np.append(start, first),
        jac=lambda x: np.append(np.zeros(reference.count), -1.0),
        method="SLSQP",
        bounds=[*zip(reference.low, reference.high, strict=True), (None, None)],
        constraints=constraints,
        options={"ftol": tolerance, "maxiter": rounds},
    )
    if not np.all(np.isfinite(answer.x)):
        return None
    place = np.clip(answer.x[:-1], reference.low, reference.high)
    if np.min(reference.rows(place)[0]) < -_BEYOND:
        return None
    place = reference.onto(place)
    heights = reference.heights(np.exp(place))
    if any(heights[i] < floor - _FLOOR for i, floor in floors.items()):
        return None
    return float(np.min(heights[list(raised)])), place


def highest(
    reference: Reference,
    raised: Sequence[int],
    floors: dict[int, float],
    *,
    known: FloatArray,
    starts: int,
    rng: np.random.Generator,
) -> tuple[float, FloatArray]:
    """The highest place found by searches from many starts, the best of them gone over again.

    Args:
        raised: whose least height counts.
        floors: height by index that has to be kept.
        known: a place (log-sizes) that keeps the floors.
        starts: searches.
        rng: of the starts.
    """
    best = (float(np.min(reference.heights(np.exp(known))[list(raised)])), known)
    found = [best]
    # Floors that were reached exactly leave no room to move in: they are met in the second round.
    loose = {i: floor - _LOOSE for i, floor in floors.items()}
    for number in range(starts):
        if number % 2 or not floors:
            start = reference.onto(_anywhere(reference, rng), also_out=True) - 0.05
        else:
            start = known + rng.normal(0, rng.choice([0.01, 0.1, 0.5]), reference.count)
        start = np.clip(start, reference.low, reference.high)
        answer = local(reference, raised, loose, start, tolerance=1e-8, rounds=40)
        if answer is not None:
            found.append(answer)
    found.sort(key=lambda one: -one[0])
    for _, place in found[:_AGAIN]:
        for away in (0.0, -1e-3):
            start = np.clip(place + away, reference.low, reference.high)
            answer = local(reference, raised, floors, start)
            if answer is not None and answer[0] > best[0]:
                best = answer
    return best


def _anywhere(reference: Reference, rng: np.random.Generator) -> FloatArray:
    top = np.array([reference.alone(i) for i in range(reference.count)])
    return np.clip(top - rng.uniform(0, 5, reference.count), reference.low, reference.high)


def _on_grid(
    reference: Reference, raised: Sequence[int], place: FloatArray
) -> tuple[float, FloatArray]:
    """The highest of a place and of a grid around it, each point moved onto the boundary."""
    ways = (-1.0, -0.3, 0.0, 0.3, 1.0) if reference.count <= _FEW else (-1.0, 1.0)
    best = float(np.min(reference.heights(np.exp(place))[list(raised)])), place
    for offset in _OFFSETS:
        for way in product(ways, repeat=reference.count):
            beside = np.clip(place + offset * np.array(way), reference.low, reference.high)
            point = reference.onto(beside, also_out=True)
            value = float(np.min(reference.heights(np.exp(point))[list(raised)]))
            if value > best[0]:
                best = value, point
    return best
