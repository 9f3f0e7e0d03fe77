"""What is neither one-sided nor reaches the force limit is tuned as if nothing ever were."""

from __future__ import annotations

from typing import NoReturn

import pytest

from tests.optimum_pairs import random_pair
from tests.unlimited import stated
from tune import NoFeasibleEffectError, SafeProfile, optimise
from tune.optimisation import saturation, solve


def _tuned(seed: int) -> SafeProfile | None:
    """The profile of a random device and scene without walls, None where nothing is feasible."""
    pair = random_pair(seed)
    assert not any(one.one_sided for one in pair.scene.elements.values())
    assert all(one.penetration for one in pair.scene.elements.values() if one.stiffness)
    try:
        return optimise(stated(pair.device), pair.scene)
    except NoFeasibleEffectError:
        return None


@pytest.mark.parametrize(
    "seed", [3, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(60) if seed != 3)]
)
def test_sizes_are_the_same_without_the_code_of_walls(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = _tuned(seed)

    def asked(*_: object, **__: object) -> NoReturn:
        raise AssertionError("a multiplier was asked for")

    def nothing_cut(*_: object) -> frozenset[str]:
        return frozenset()

    monkeypatch.setattr(saturation, "prove_moments", asked)
    monkeypatch.setattr(saturation, "witness_of", asked)
    monkeypatch.setattr(solve, "may_saturate", nothing_cut)
    without = _tuned(seed)
    if usual is None:
        assert without is None
        return
    assert without is not None
    assert without.elements == usual.elements
    assert without.certificate == usual.certificate
