"""The largest product of steps of elements that share combinations, by search from many places."""

# pyright: standard

from __future__ import annotations

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


def highest(
    reference: Reference, *, known: FloatArray, starts: int, rng: np.random.Generator
) -> tuple[float, FloatArray]:
    """The largest product found by searches from many starts, the best of them gone over again.

    Its logarithm, and the place in log-sizes; one that is known to be allowed is where it begins.
    """
    best = (reference.product(known), known)
    found = [best]
    for number in range(starts):
        if number % 2 or starts == 1:
            start = reference.onto(_anywhere(reference, rng), also_out=True) - 0.05
        else:
            start = known + rng.normal(0, rng.choice([0.01, 0.1, 0.5]), reference.count)
        answer = _local(reference, start, tolerance=1e-8, rounds=40)
        if answer is not None:
            found.append(answer)
    found.sort(key=lambda one: -one[0])
    for _, place in found[:_AGAIN]:
        for away in (0.0, -1e-3):
            answer = _local(reference, place + away, tolerance=1e-13, rounds=100)
            if answer is not None and answer[0] > best[0]:
                best = answer
    return best


def _local(
    reference: Reference, start: FloatArray, *, tolerance: float, rounds: int
) -> tuple[float, FloatArray] | None:
    """The logarithm of the product and the place that a search ends at, if it keeps every limit."""
    lower, upper = reference.low, reference.high
    signs = np.array([w.sign for w in reference.wanted])
    references = np.array([w.reference for w in reference.wanted])
    units = np.array([w.unit for w in reference.wanted])
    corners = np.array([w.corner for w in reference.wanted])
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
        return -reference.product(np.log(sizes)), -slope

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
    if not np.all(np.isfinite(answer.x)):
        return None
    place = np.clip(answer.x, lower, upper)
    if np.min(reference.rows(place)[0]) < -_BEYOND:
        return None
    place = reference.onto(place)
    if np.any(place < lower - _BEYOND):
        return None
    return reference.product(place), place


def _anywhere(reference: Reference, rng: np.random.Generator) -> FloatArray:
    top = np.array([reference.alone(i) for i in range(reference.count)])
    return np.clip(top - rng.uniform(0, 5, reference.count), reference.low, reference.high)
