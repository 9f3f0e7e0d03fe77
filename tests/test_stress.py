"""Two thousand draws of the whole range of numbers, of tune, of verdicts and of identify."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.stress_identification import identified
from tests.stress_tuning import Outcome, judged, tuned
from tests.thinned import thinned

#: Draws of a test.
_BLOCK = 100
_BLOCKS = range(20)


def _wrong(outcome: Callable[[int], Outcome], block: int, count: int = _BLOCK) -> list[str]:
    seeds = range(block * _BLOCK, block * _BLOCK + count)
    outcomes = {seed: outcome(seed) for seed in seeds}
    return [f"{seed}: {each.words}" for seed, each in outcomes.items() if each.kind == "wrong"]


@pytest.mark.parametrize("count", thinned([5, 2000], 1))
def test_limits_and_verdicts_are_those_of_exact_roots(count: int) -> None:
    assert not _wrong(judged, 0, count)


@pytest.mark.parametrize("seed", [850, 1953])
def test_a_motion_that_dies_within_a_sample_is_not_taken_for_a_slower_one(seed: int) -> None:
    """Mass and an unstated delay are then nearly one: the log is refused, not read as 7 times m."""
    assert identified(seed).kind == "refused"


@pytest.mark.long
@pytest.mark.parametrize("block", _BLOCKS)
def test_what_is_tuned_is_stable_at_every_corner(block: int) -> None:
    assert not _wrong(tuned, block)


@pytest.mark.long
@pytest.mark.parametrize("block", _BLOCKS)
def test_what_is_identified_is_true_and_does_not_depend_on_units(block: int) -> None:
    assert not _wrong(identified, block)
