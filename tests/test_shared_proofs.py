"""Elements by themselves are smaller gains of others: one proof agrees with one for each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.test_edges import (
    AXIS,
    FILTERED,
    FILTERS,
    MASS,
    SPRING,
    Sizes,
    design,
    element,
    late_limit,
    limit,
    said,
)
from tests.thinned import thinned

DAMPER = (0.0, 1.0, 0.0)
#: Sizes and claims over the largest that hold.
PARTS, CLAIMS = (0.05, 0.3, 0.9, 0.995, 1.005), (0.9, 0.995, 1.005)
DEVICE = {"mass": {"value": 3.0, "low": 2.999, "high": 3.0}}


def drawn(rng: np.random.Generator) -> Any:
    """A spring, a damper or a mass near its limit, with claims of which some do not hold."""
    K, B, M = (SPRING, SPRING, DAMPER, MASS)[int(rng.integers(4))]
    case = AXIS if K else FILTERED
    size = late_limit([case], (K, B, M)) * float(rng.choice(PARTS, p=[0.25, 0.25, 0.2, 0.25, 0.05]))
    sizes: Sizes = (K * size, B * size, M * size)
    claims: dict[str, float] = {}
    if rng.random() < 0.4:
        claims["gain"] = limit(case, sizes) * float(rng.choice(CLAIMS, p=[0.3, 0.6, 0.1]))
    if rng.random() < 0.3:
        claims["extra_delay_samples"] = float(rng.choice([1.5, 2.0, 3.0]))
    return element(*sizes, margins=claims)


@pytest.mark.parametrize("seed", thinned(range(90), 8))
def test_elements_are_certified_as_each_by_itself(seed: int) -> None:
    rng = np.random.default_rng([35, seed])
    elements = {f"e{number}": drawn(rng) for number in range(int(rng.integers(2, 7)))}
    alone = {
        name: said(design({name: each}, device=DEVICE, loop=FILTERS))
        for name, each in elements.items()
    }
    words = said(design(elements, device=DEVICE, loop=FILTERS))
    assert bool(words) == any(alone.values())
    assert all(alone[line.partition(":")[0]] for line in words.splitlines())


def test_more_elements_than_are_looked_at_in_one_run_may_all_be_covered_by_one() -> None:
    most = late_limit([FILTERED], DAMPER)
    elements = {
        f"e{number}": element(0.0, (0.1 + number * 0.01) * most, 0.0) for number in range(70)
    }
    assert not said(design(elements, device=DEVICE, loop=FILTERS))
    elements["e69"] = element(0.0, 1.005 * most, 0.0)
    assert "e69" in said(design(elements, device=DEVICE, loop=FILTERS))
