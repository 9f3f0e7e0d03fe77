"""Elements and what walls meet are smaller gains of others: one proof agrees with one for each."""

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from tests.test_edges import (
    AXIS,
    FILTERED,
    FILTERS,
    GAIN,
    LONG,
    MASS,
    OFF,
    SPRING,
    THREE,
    WALL,
    Channel,
    Sizes,
    design,
    element,
    holds,
    late_limit,
    limit,
    proof,
    reach_of,
    said,
)
from tests.thinned import thinned
from tune.documents.profile import AbsoluteStability

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


#: What stands beside a wall: its size for a factor of one, and the channel of a multiplier.
BESIDE: dict[str, tuple[Sizes, Channel | None]] = {
    "damper": ((0.0, 30.0, 0.0), ("damping", 8e-4, ())),
    "spring": ((500.0, 0.0, 0.0), ("", 0.0, LONG)),
    "mass": ((0.0, 0.0, 2.0), None),
}


@cache
def largest_part(kind: str, wall: float = 1.0) -> float:
    """The factor of an element and of a part of the wall beside it up to which both hold."""
    (K, B, M), channel = BESIDE[kind]
    more = [] if channel is None else [(K, B, *channel[1:])]
    low, high = 0.1, 10.0
    while high > low * 1.0002:
        part = float(np.sqrt(low * high))
        channels = [(wall * WALL[0], wall * WALL[1], 0.0, THREE), *more]
        scaled = [(part * K, part * B, *rest) for K, B, *rest in channels]
        low, high = (part, high) if holds(scaled, steady=part * M) else (low, part)  # type: ignore[arg-type]
    return low


def pair(wall: str, name: str, kind: str) -> dict[str, AbsoluteStability]:
    """What proves a wall and an element beside it."""
    channel = BESIDE[kind][1]
    own = [] if channel is None else [(channel[0] or name, *channel[1:])]
    return {f"{wall} + {name}": proof((wall, 0.0, THREE), *own)}


def of_wall(part: float, lead: float = 1.0) -> Any:
    return element(part * WALL[0], lead * part * WALL[1], one_sided=True)


@pytest.mark.parametrize("kind", BESIDE)
def test_a_sum_of_which_one_part_is_larger_is_covered_by_no_other(kind: str) -> None:
    """Though the wall of the other, of the same signal, is much stiffer."""
    within, edge = largest_part(kind), largest_part(kind, 0.3)
    proofs = pair("wall", "weak", kind) | pair("door", "weak", kind) | pair("door", "strong", kind)

    def words(part: float) -> str:
        elements = {
            "wall": of_wall(0.9 * within),
            "door": of_wall(0.3 * part * edge),
            "weak": element(*(0.2 * within * size for size in BESIDE[kind][0])),
            "strong": element(*(part * edge * size for size in BESIDE[kind][0])),
        }
        made = design(elements, loop=FILTERS, device=DEVICE, apart=[("wall", "strong")])
        return said(made, proofs)

    assert words(1 - OFF) == ""
    assert "door + strong: not proved stable with its clamps" in words(1 + OFF)


@pytest.mark.parametrize(("lead", "taps"), [(0.0, THREE), (1.0, LONG)])
def test_a_wall_of_another_signal_or_multiplier_is_covered_by_no_other(
    lead: float, taps: Sequence[tuple[int, float]]
) -> None:
    """Though it is less stiff and less damped."""
    stiff, least = (
        reach_of([(WALL[0], each * WALL[1], 0.0, own)])
        for each, own in ((1.0, THREE), (lead, taps))
    )
    assert least < 0.8 * stiff
    proofs = {"wall": proof(("wall", 0.0, THREE)), "door": proof(("door", 0.0, taps))}
    within, beyond = (
        {"wall": of_wall(0.9 * stiff), "door": of_wall(part * least, lead)}
        for part in (1 - OFF, 1 + OFF)
    )
    assert said(design(within, loop=FILTERS), proofs) == ""
    assert "door: not proved stable with its clamps" in said(design(beyond, loop=FILTERS), proofs)


@pytest.mark.parametrize("claim", [{"gain": 60.0}, {"extra_delay_samples": 9.0}])
def test_what_is_claimed_beyond_the_proof_that_covers_it_is_looked_at(
    claim: dict[str, float],
) -> None:
    most = largest_part("damper")
    made = {
        "wall": of_wall(0.9 * most),
        "weak": element(0.0, 6.0, margins=claim),
        "strong": element(0.0, 27.0 * most),
    }
    proofs = pair("wall", "weak", "damper") | pair("wall", "strong", "damper")
    alone = design({"weak": made["weak"]}, loop=FILTERS, device=DEVICE)
    assert said(alone) == ""
    words = said(design(made, loop=FILTERS, device=DEVICE), proofs)
    assert words.startswith("wall + weak: claimed")
    made["weak"] = element(0.0, 6.0)
    assert said(design(made, loop=FILTERS, device=DEVICE), proofs) == ""


def test_a_sum_that_states_a_higher_gain_is_covered_by_no_other() -> None:
    most = reach_of([(*WALL, 0.0, THREE)])
    made = design({"wall": of_wall(0.9 * most), "door": of_wall(0.45 * most)}, loop=FILTERS)
    for times, words in ((1.9, ""), (2.3, "door: not proved stable")):
        stated = {"wall": proof(("wall", 0.0, THREE))}
        stated["door"] = proof(("door", 0.0, THREE), gain=GAIN * times)
        told = said(made, stated)
        assert told.startswith(words)
        assert bool(told) == bool(words)


@cache
def least_part(kinds: frozenset[str]) -> float:
    return min(map(largest_part, kinds))


@pytest.mark.parametrize("seed", thinned(range(120), 4))
def test_what_walls_meet_is_certified_as_each_pair_by_itself(seed: int) -> None:
    """Smaller gains of a proved sum are not proved again: those of one signal, of all parts."""
    rng = np.random.default_rng([136, seed])
    kinds = rng.choice([*BESIDE], 4, p=[0.4, 0.4, 0.2])
    ratio = float(rng.choice([1.0, 1.0, 1.02]))
    least = least_part(frozenset(kinds))

    def part() -> float:
        return least * float(rng.choice([0.4, 0.7, 0.97, 1.0, 1.05], p=[0.2, 0.2, 0.35, 0.2, 0.05]))

    walls: dict[str, Any] = {}
    others: dict[str, Any] = {}
    proofs: dict[str, AbsoluteStability] = {}
    for name, size in (("wall", part()), ("door", ratio * part())):
        lead = ratio if name == "door" else 1.0
        walls[name] = of_wall(size, lead)
    for number, kind in enumerate(kinds):
        sizes = BESIDE[kind][0]
        name, size = f"e{number}", part()
        claims = {"gain": 1.3 * GAIN, "extra_delay_samples": 4.0}
        claimed = {claim: most for claim, most in claims.items() if rng.random() < 0.3}
        others[name] = element(*(size * each for each in sizes), margins=claimed)
        for wall in walls:
            proofs |= pair(wall, name, kind)
    alone = {
        both: said(
            design({wall: walls[wall], name: others[name]}, device=DEVICE, loop=FILTERS),
            {both: proofs[both]},
        )
        for wall, name in product(walls, others)
        for both in [f"{wall} + {name}"]
    }
    words = said(design(walls | others, device=DEVICE, loop=FILTERS), proofs)
    assert bool(words) == any(alone.values())
    assert all(alone.get(line.partition(":")[0], True) for line in words.splitlines())
