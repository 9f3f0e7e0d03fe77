"""Steps and chances built on the study, and tables of one's own."""

from __future__ import annotations

import math
from pathlib import Path
from statistics import NormalDist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification import InvalidInputError, load_device, load_document, quantity
from tune.documents.perception import (
    PerceptionTable,
    Scale,
    WeberFraction,
    chance_to_tell_apart,
    default_table,
)
from tune.documents.scene import DEFAULT_MOTION

MOTION = DEFAULT_MOTION["linear"]


def test_stiffness_reference_is_masked_force_over_penetration() -> None:
    scale = Scale.of("stiffness", load_device("homerehab"), default_table(), MOTION)
    assert scale.reference == pytest.approx(0.8 / 0.01)


@given(
    steps=st.floats(0.01, 30),
    reference=st.floats(0.01, 100),
    floor=st.floats(1e-3, 100),
    sign=st.sampled_from([1, -1]),
)
def test_steps_are_the_integral_of_webers_law_with_a_floor(
    steps: float, reference: float, floor: float, sign: int
) -> None:
    """In 20 digits: ∫ dI/max(I, corner), over ln(1 + w), from the device to device and effect."""
    import mpmath

    scale = Scale(reference=reference, weber=0.25, floor=floor)
    value = scale.value_at(steps, sign)
    assert math.copysign(1, value) == sign
    with mpmath.workdps(20):
        step = mpmath.log(mpmath.mpf("1.25"))
        corner = floor / step
        ends = sorted([mpmath.mpf(reference), mpmath.mpf(reference) + value])
        places = [ends[0], *([corner] if ends[0] < corner < ends[1] else []), ends[1]]
        found = mpmath.quad(lambda each: 1 / max(each, corner), places) / step
    assert scale.steps(value) == pytest.approx(steps, rel=1e-6)
    if value > -reference * (1 - 1e-9):
        assert float(found) == pytest.approx(steps, rel=1e-5)


def test_steps_carry_the_interval_of_the_fraction() -> None:
    """1 kg on 3 kg: the step it was shown as is d', 1.415 of them, 1.06 to 1.78 by the counts."""
    table = default_table()
    scale = Scale(reference=3.0, weber=table.mass.value, floor=0.01)
    found = scale.estimate(1.0, table.mass)
    assert found.value == pytest.approx(1.415, abs=1e-3)
    weber = table.mass.estimate()
    assert weber.low is not None
    assert weber.high is not None
    assert found.low == pytest.approx(math.log(4 / 3) / math.log(1 + weber.high))
    assert found.high == pytest.approx(math.log(4 / 3) / math.log(1 + weber.low))
    bare = WeberFraction(value=0.2, source="mine")
    assert scale.estimate(3.0, bare).low is None
    ranged = WeberFraction(value=0.2, low=0.1, high=0.3, source="mine")
    plain = Scale(reference=5.0, weber=0.2, floor=0.01)
    assert plain.estimate(1.0, ranged).high == pytest.approx(math.log(1.2) / math.log(1.1))


def test_one_step_is_told_in_84_percent_of_forced_choices() -> None:
    device = load_device("homerehab")
    table = default_table()
    one = Scale.of("mass", device, table, MOTION).value_at(1.0, 1)
    telling = chance_to_tell_apart("mass", 0.0, one, device=device)
    assert telling.steps.value == pytest.approx(1)
    assert telling.forced_choice.value == pytest.approx(0.8413, abs=1e-4)
    assert chance_to_tell_apart("mass", one, one, device=device).forced_choice.value == 0.5


def test_walls_fainter_than_what_the_device_masks_are_no_different_from_none() -> None:
    device = load_device("homerehab")  # masks 0.8 N, 80 N/m at 10 mm
    assert chance_to_tell_apart("stiffness", 0.0, 79.0, device=device).steps.value == 0.0
    assert chance_to_tell_apart(
        "stiffness", 0.0, 160.0, device=device
    ).steps.value == pytest.approx(
        chance_to_tell_apart("stiffness", 500.0, 1000.0, device=device).steps.value
    )


def test_nothing_left_to_feel_forms_no_ratio() -> None:
    device = load_device("homerehab").model_copy(update={"mass": quantity(3.0)})
    with pytest.raises(ValueError, match=r"mass felt is -1"):
        chance_to_tell_apart("mass", -4.0, 0.0, device=device)


NORMAL = NormalDist()

TABLE = """\
schema: haptune/perception/1
name: mine
stiffness: {value: 0.23, source: a paper, people: 11}
damping: {value: 0.2, low: 0.15, high: 0.3, source: a paper}
mass: {source: ours, study: {equal_right: 30, equal_trials: 50, different_right: 40,
  different_trials: 50, lower: 2.0, upper: 3.0}}
force_threshold: {value: 0.2, source: a paper}
torque_threshold: {value: 0.01, source: a paper}
"""


def test_a_table_of_ones_own_by_fraction_and_by_counts(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(TABLE, encoding="utf-8")
    table = load_document(PerceptionTable, path)
    c, shift = NORMAL.inv_cdf(0.8), NORMAL.inv_cdf(0.8)
    assert table.mass.value == pytest.approx(1.5 ** (1 / (c + shift)) - 1)
    device = load_device("homerehab")
    plain = chance_to_tell_apart("stiffness", 500.0, 700.0, device=device, table=table)
    assert plain.steps.value == pytest.approx(math.log(1.4) / math.log(1.23))
    assert plain.forced_choice.low is None
    assert plain.answers is None
    ranged = chance_to_tell_apart("damping", 0.0, 10.0, device=device, table=table)
    assert ranged.forced_choice.low == pytest.approx(NORMAL.cdf(math.log(2) / math.log(1.3)))


#: what the refusal must say, what is replaced, by what
WRONG = (
    ("give either value or study", "value: 0.23, ", ""),
    ("give low and high together", "low: 0.15, ", ""),
    ("needs low <= value <= high", "low: 0.15", "low: 0.25"),
    ("less than 10", "value: 0.23", "value: 23.0"),
    ("schema is 'haptune/scene/1'", "haptune/perception/1", "haptune/scene/1"),
    ("people", "people: 11", "people: 0"),
    ("stiffness.stated: is no key", "value: 0.23", "stated: 0.23"),
    ("mass.study.lower: is missing", "lower: 2.0, ", ""),
    ("damping: is missing", "damping: {value: 0.2, low: 0.15, high: 0.3, source: a paper}\n", ""),
    ("50 of 50 right", "different_right: 40", "different_right: 50"),
)


@pytest.mark.parametrize(("words", "old", "new"), WRONG)
def test_what_no_table_can_be(tmp_path: Path, words: str, old: str, new: str) -> None:
    path = tmp_path / "mine.yaml"
    assert old in TABLE
    path.write_text(TABLE.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidInputError, match=words):
        load_document(PerceptionTable, path)
