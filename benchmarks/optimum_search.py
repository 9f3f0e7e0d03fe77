"""The largest product of steps of elements that share combinations, by search from many places."""

# pyright: standard

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.optimum_reference import Reference

FloatArray = NDArray[np.float64]

#: A search that ends further than this beyond a limit, in log-sizes, has not ended.
_BEYOND = 1e-5
#: The best of the first round that are gone over again.
_AGAIN = 4
#: Unknowns up to which the grid around the best has five points a side; two beyond.
_FEW = 3
#: Log-offsets of that grid.
_OFFSETS = (1e-4, 1e-2, 0.2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """By how much the logarithm of a product that the search found exceeds that of an answer."""

    what: str
    reached: float
    best: float
    sizes: FloatArray

    @property
    def more(self) -> float:
        """How much larger it is."""
        return self.best - self.reached


def gaps(
    reference: Reference,
    sizes: FloatArray,
    *,
    starts: int,
    rng: np.random.Generator,
    fine: bool = True,
) -> Iterator[Gap]:
    """Everything by which an answer falls short of the largest product, rank after rank.

    Of each rank with those before it as they are, every effect of later ranks at one step or more.

    Args:
        reference: what bounds the answer.
        sizes: the answer.
        starts: searches.
        rng: of the starts.
        fine: with a grid around the best.
    """
    place = np.log(sizes)
    lower, upper = reference.low.copy(), reference.high.copy()
    for level in sorted({one.level for one in reference.wanted}):
        raised = [i for i, one in enumerate(reference.wanted) if one.level == level]
        best, found = highest(reference, raised, lower, upper, known=place, starts=starts, rng=rng)
        if fine and len(raised) == reference.count:
            best, found = _on_grid(reference, raised, found)
        yield Gap(
            what=" and ".join(reference.wanted[i].label for i in raised),
            reached=reference.product(place, raised),
            best=best,
            sizes=np.exp(found),
        )
        lower[raised] = upper[raised] = place[raised]


def local(
    reference: Reference,
    raised: Sequence[int],
    lower: FloatArray,
    upper: FloatArray,
    start: FloatArray,
    *,
    tolerance: float = 1e-13,
    rounds: int = 100,
) -> tuple[float, FloatArray] | None:
    """The logarithm of the product and log-sizes where it ends that starts there."""
    signs = np.array([w.sign for w in reference.wanted])
    references = np.array([w.reference for w in reference.wanted])
    units = np.array([w.unit for w in reference.wanted])
    corners = np.array([w.corner for w in reference.wanted])
    mine = np.zeros(reference.count)
    mine[list(raised)] = 1.0
    known: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def limits(place: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = place.tobytes()
        if key not in known:
            known.clear()
            known[key] = reference.rows(np.clip(place, lower, upper))
        return known[key]

    def falling(place: FloatArray) -> tuple[float, FloatArray]:
        sizes = np.exp(np.clip(place, lower, upper))
        steps = reference.steps(sizes) / units
        slope = sizes / np.maximum(references + signs * sizes, corners) / steps
        return -reference.product(np.log(sizes), raised), -mine * slope

    constraints: dict[str, Any] = {
        "type": "ineq",
        "fun": lambda x: limits(x)[0],
        "jac": lambda x: limits(x)[1],
    }
    search: Any = minimize  # its stubs know no dictionary of constraints
    answer = search(
        falling,
        np.clip(start, lower, upper),
        jac=True,
        method="SLSQP",
        bounds=[*zip(lower, upper, strict=True)],
        constraints=constraints,
        options={"ftol": tolerance, "maxiter": rounds},
    )
    return _kept(reference, raised, lower, upper, answer.x)


def _kept(
    reference: Reference,
    raised: Sequence[int],
    lower: FloatArray,
    upper: FloatArray,
    found: FloatArray,
) -> tuple[float, FloatArray] | None:
    """A place that a search ended at, with its product, if every limit is kept there."""
    if not np.all(np.isfinite(found)):
        return None
    place = np.clip(found, lower, upper)
    if np.min(reference.rows(place)[0]) < -_BEYOND:
        return None
    place = reference.onto(place)
    if np.any(place < lower - _BEYOND):
        return None
    return reference.product(place, raised), place


def highest(
    reference: Reference,
    raised: Sequence[int],
    lower: FloatArray,
    upper: FloatArray,
    *,
    known: FloatArray,
    starts: int,
    rng: np.random.Generator,
) -> tuple[float, FloatArray]:
    """The largest product found by searches from many starts, the best of them gone over again.

    Args:
        reference: what bounds the effects.
        raised: whose steps are multiplied.
        lower: least log-sizes.
        upper: largest log-sizes; those that stay have both alike.
        known: a place (log-sizes) that is allowed.
        starts: searches.
        rng: of the starts.
    """
    best = (reference.product(known, raised), known)
    found = [best]
    for number in range(starts):
        if number % 2 or starts == 1:
            start = reference.onto(_anywhere(reference, rng), also_out=True) - 0.05
        else:
            start = known + rng.normal(0, rng.choice([0.01, 0.1, 0.5]), reference.count)
        answer = local(reference, raised, lower, upper, start, tolerance=1e-8, rounds=40)
        if answer is not None:
            found.append(answer)
    found.sort(key=lambda one: -one[0])
    for _, place in found[:_AGAIN]:
        for away in (0.0, -1e-3):
            answer = local(reference, raised, lower, upper, place + away)
            if answer is not None and answer[0] > best[0]:
                best = answer
    return best


def _anywhere(reference: Reference, rng: np.random.Generator) -> FloatArray:
    top = np.array([reference.alone(i) for i in range(reference.count)])
    return np.clip(top - rng.uniform(0, 5, reference.count), reference.low, reference.high)


def _on_grid(
    reference: Reference, raised: Sequence[int], place: FloatArray
) -> tuple[float, FloatArray]:
    """The best of a place and of a grid around it, each point moved onto the boundary."""
    ways = (-1.0, -0.3, 0.0, 0.3, 1.0) if reference.count <= _FEW else (-1.0, 1.0)
    best = reference.product(place, raised), place
    for offset in _OFFSETS:
        for way in product(ways, repeat=reference.count):
            beside = np.clip(place + offset * np.array(way), reference.low, reference.high)
            point = reference.onto(beside, also_out=True)
            value = reference.product(point, raised)
            if np.all(point >= reference.low) and value > best[0]:
                best = value, point
    return best
