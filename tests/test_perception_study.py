"""The study recomputed from the paper's own tables, and its uncertainty."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from identification import load_device
from tests.simulated.experiment import EFFECTS, EffectName
from tests.simulated.user_study import AREA_1, AREA_2, PEOPLE
from tests.study_replay import COLUMN, TABLE_3, equal_trials, study_of
from tune.documents.perception import Study, chance_to_tell_apart, default_table

#: Table 3: the success rates with equal and with different settings as printed, %.
PRINTED: dict[EffectName, tuple[float, float]] = {
    "stiffness": (45.0, 96.25),
    "damping": (75.0, 96.25),
    "mass": (51.67, 76.25),
}
#: What the device itself adds to what is felt (section 3: m ≈ 3 kg, b almost 10 N·s/m).
OWN: dict[EffectName, float] = {"stiffness": 0, "mass": 3, "damping": 10}


def _study(effect: EffectName) -> Study:
    return study_of(default_table(), effect)


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_shipped_counts_are_those_of_tables_2_and_3(effect: EffectName) -> None:
    study, column = _study(effect), COLUMN[effect]
    equal = int(np.sum(equal_trials(effect)))
    right_equal, right_different = TABLE_3[effect]
    percent_equal, percent_different = PRINTED[effect]
    assert study.equal_trials == equal * PEOPLE
    assert study.different_trials == (len(AREA_2) - equal) * PEOPLE
    assert (study.equal_right, study.different_right) == (right_equal, right_different)
    assert 100 * right_equal / study.equal_trials == pytest.approx(percent_equal, abs=0.005)
    assert 100 * right_different / study.different_trials == pytest.approx(percent_different)
    settings = sorted(OWN[effect] + area[column] for area in (AREA_1, AREA_2[-1]))
    assert [study.lower, study.upper] == settings
    assert default_table().fraction(effect).people == PEOPLE


@pytest.mark.parametrize(
    ("effect", "sensitivity", "percent"),
    [("stiffness", 2.378, 33.8), ("damping", 2.931, 26.7), ("mass", 1.415, 22.5)],
)
def test_weber_fractions_of_the_paper(
    effect: EffectName, sensitivity: float, percent: float
) -> None:
    """d' and w from the printed rates by the mpmath quantile, and as the theory states them."""
    import mpmath

    equal, different = (rate / 100 for rate in PRINTED[effect])
    c = math.sqrt(2) * float(mpmath.erfinv(equal))
    exact = c + math.sqrt(2) * float(mpmath.erfinv(2 * different - 1))
    study = _study(effect)
    assert study.sensitivity() == pytest.approx(exact, abs=2e-4)  # rates are printed to 0.01 %
    assert study.sensitivity() == pytest.approx(sensitivity, abs=5e-4)
    assert 100 * default_table().fraction(effect).value == pytest.approx(percent, abs=0.05)


def test_the_paper_calls_damping_best_and_mass_least_discriminated() -> None:
    """Section 5, though mass was shown at a smaller ratio: its Weber fraction is the least."""
    order = sorted(EFFECTS, key=lambda effect: _study(effect).sensitivity())
    assert order == ["mass", "stiffness", "damping"]
    assert default_table().mass.value < default_table().damping.value


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_prediction_gives_back_the_rates_of_the_study(effect: EffectName) -> None:
    device = load_device("homerehab")
    low, high = (area[COLUMN[effect]] for area in (AREA_1, AREA_2[-1]))
    different = chance_to_tell_apart(effect, low, high, device=device).answers
    same = chance_to_tell_apart(effect, high, high, device=device).answers
    assert different is not None
    assert same is not None
    equal_share, different_share = (rate / 100 for rate in PRINTED[effect])
    assert different.right.value == pytest.approx(different_share, abs=1e-4)
    assert same.equal.value == pytest.approx(equal_share, abs=1e-4)
    assert same.right.value == pytest.approx(same.wrong.value)


@pytest.mark.parametrize(
    ("effect", "low", "high"),
    [("stiffness", 25, 43), ("damping", 21, 32), ("mass", 17, 31)],
)
def test_intervals_lie_where_resampling_puts_them(effect: EffectName, low: int, high: int) -> None:
    """The theory's ranges, percentiles of resampled counts; these cover up to 2 % more above."""
    found = default_table().fraction(effect).estimate()
    assert found.low is not None
    assert found.high is not None
    assert 100 * found.low == pytest.approx(low, abs=2)
    assert 100 * found.high == pytest.approx(high, abs=2.1)


#: what the refusal must say, changed counts
REFUSED: tuple[tuple[str, dict[str, Any]], ...] = (
    ("80 of 80 right bounds no threshold", {"different_right": 80}),
    ("60 of 60 right", {"equal_right": 60}),
    ("greater than 0", {"equal_right": 0}),
    ("hardly better than by guessing", {"different_right": 8}),
    ("must exceed lower", {"lower": 4.0, "upper": 3.0}),
)


@pytest.mark.parametrize(("words", "change"), REFUSED, ids=str)
def test_counts_that_bound_no_threshold_are_refused(words: str, change: dict[str, Any]) -> None:
    content = _study("mass").model_dump() | change
    with pytest.raises(ValueError, match=words):
        Study.model_validate(content)
