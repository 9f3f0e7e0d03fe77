"""Weber fractions recomputed from the counts of the paper's tables, and the scale built on them."""

from __future__ import annotations

import math
from statistics import NormalDist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification import load_device
from tune.perception import (
    PAPER_STUDY,
    default_table,
    perceived_steps,
    references,
    value_at_steps,
)


@pytest.mark.parametrize(
    ("effect", "sensitivity", "percent"),
    [("stiffness", 2.38, 33.8), ("damping", 2.93, 26.7), ("mass", 1.42, 22.5)],
)
def test_weber_fractions_of_the_paper(effect: str, sensitivity: float, percent: float) -> None:
    study = PAPER_STUDY[effect]
    assert f"{study.sensitivity():.2f}" == f"{sensitivity:.2f}"
    assert 100 * getattr(default_table(), effect).value == pytest.approx(percent, abs=0.05)


def test_sensitivity_reproduces_the_counts() -> None:
    """From d' back through the equal-range model to the shares the paper printed."""
    normal = NormalDist()
    for study in PAPER_STUDY.values():
        criterion = normal.inv_cdf((1 + study.equal_right / study.equal_trials) / 2)
        equal = normal.cdf(criterion) - normal.cdf(-criterion)
        assert equal == pytest.approx(study.equal_right / study.equal_trials)
        assert normal.cdf(study.sensitivity() - criterion) == pytest.approx(
            study.different_right / study.different_trials
        )


def test_the_mass_of_one_step_on_homerehab_is_0_68_kg() -> None:
    table = default_table()
    device = load_device("homerehab")
    reference = references(device, table, 0.01)["mass"]
    assert value_at_steps(1, reference, table.mass.value, 1) == pytest.approx(0.676, abs=0.002)


def test_stiffness_reference_is_masked_force_over_penetration() -> None:
    device = load_device("homerehab")
    assert references(device, default_table(), 0.02)["stiffness"] == pytest.approx(0.8 / 0.02)


@given(steps=st.floats(0.01, 30), reference=st.floats(0.01, 100), sign=st.sampled_from([1, -1]))
def test_steps_and_values_are_inverse(steps: float, reference: float, sign: int) -> None:
    value = value_at_steps(steps, reference, 0.25, sign)
    assert math.copysign(1, value) == sign
    if value > -reference * (1 - 1e-9):
        assert perceived_steps(value, reference, 0.25) == pytest.approx(steps, rel=1e-5)
