"""Steps, chances and studies of perception, with a floor of Weber's law, and own tables."""

from __future__ import annotations

import math
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification import (
    InvalidInputError,
    load_device,
    load_document,
    to_mapping,
    to_yaml,
)
from tests.commands import digest_of
from tests.simulated.experiment import EFFECTS, EffectName
from tune import (
    CheckFailedError,
    PerceptionTable,
    SafeProfile,
    Scale,
    Scene,
    Study,
    chance_to_tell_apart,
    check,
    default_table,
    optimise,
)
from tune.documents.scene import Motion

_WALL = Scene.model_validate({"elements": {"wall": {"stiffness": "max"}}})
MOTION = _WALL.motion("wall", "linear")


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


def test_one_step_is_told_in_84_percent_of_forced_choices() -> None:
    device = load_device("homerehab")
    table = default_table()
    one = Scale.of("mass", device, table, MOTION).value_at(1.0, 1)
    telling = chance_to_tell_apart("mass", 0.0, one, device=device)
    assert telling.steps.value == pytest.approx(1)
    assert telling.forced_choice.value == pytest.approx(0.8413, abs=1e-4)
    assert chance_to_tell_apart("mass", one, one, device=device).forced_choice.value == 0.5


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


#: Smallest forces that are noticed, N and N·m, over depth, speed and acceleration.
FLOORS = {
    "stylus": {"stiffness": 0.1 / 0.01, "damping": 0.1 / 0.2, "mass": 0.1 / 2.0},
    "knob": {"stiffness": 0.005 / 0.1, "damping": 0.005 / 2.0, "mass": 0.005 / 20.0},
}


def _scale(name: str, effect: EffectName) -> Scale:
    device = load_device(name)
    return Scale.of(
        effect, device, default_table(), _WALL.motion("wall", device.motion or "linear")
    )


@pytest.mark.parametrize("effect", EFFECTS)
def test_on_the_papers_device_steps_are_logarithms_to_the_last_bit(effect: EffectName) -> None:
    scale = _scale("homerehab", effect)
    printed = {"stiffness": 34.3, "damping": 2.11, "mass": 0.246}
    assert scale.corner == pytest.approx(printed[effect], rel=2e-3)
    for part in (-0.7, -0.4, 1e-6, 0.3, 1.0, 7.0, 1e4):
        # A tenth of the device is above the corner of each effect but stiffness.
        value = part * scale.reference * (0.5 if effect == "stiffness" else 1.0)
        expected = abs(np.log(1 + value / scale.reference)) / np.log1p(scale.weber)
        assert scale.steps(value) == expected
        again = scale.reference * np.expm1(np.sign(value) * np.log1p(scale.weber) * expected)
        assert scale.value_at(expected, int(np.sign(value))) == pytest.approx(again, rel=1e-15)


@pytest.mark.parametrize("name", FLOORS)
@pytest.mark.parametrize("effect", EFFECTS)
def test_on_light_devices_a_step_is_the_smallest_force(name: str, effect: EffectName) -> None:
    scale, floor = _scale(name, effect), FLOORS[name][effect]
    assert scale.reference < scale.corner
    for part in (0.1, 0.5, 1.0):
        assert scale.steps(part * floor) == pytest.approx(part)
    telling = chance_to_tell_apart(
        effect, scale.reference, scale.reference + floor, device=load_device(name)
    )
    assert telling.steps.value == pytest.approx(1.0)


def test_a_hand_that_is_slow_feels_less_of_a_damper() -> None:
    device = load_device("stylus")
    found = [
        chance_to_tell_apart(
            "damping", 0.0, 0.05, device=device, motion=Motion(speed=speed, acceleration=2.0)
        ).steps.value
        for speed in (0.02, 0.2, 2.0)
    ]
    assert found[:2] == pytest.approx([0.01, 0.1])
    assert 0.9 < found[2] < np.log(0.25 / 0.2) / np.log1p(0.267)


def _tuned(**element: Any) -> SafeProfile:
    scene = {
        "elements": {"it": element},
        "loop": {
            "velocity_filter_hz": 200.0 if "mass" in element else 60.0,
            "acceleration_filter_hz": 40.0,
        },
    }
    return optimise(load_device("stylus"), Scene.model_validate(scene))


def test_a_spring_takes_the_damping_that_the_smallest_force_is_not_felt_of() -> None:
    """A lag of 1.5 ms: K is 0.5 N·s/m over it, where a quarter of 0.2 + 1.2 N·s/m was allowed."""
    it = _tuned(stiffness="max", damping={"min": 0.0, "max": 1.2}).elements["it"]
    assert it.limited_by == {"stiffness": "rendering", "damping": "range"}
    assert it.rendered is not None
    missing = max(1.2 - end for end in it.rendered.damping_at_ends)
    assert 0.99 * 0.5 < missing <= 0.5


@pytest.mark.parametrize("effect", ["damping", "mass"])
def test_check_counts_steps_with_the_floor_and_refuses_others(
    tmp_path: Path, effect: EffectName
) -> None:
    profile = _tuned(damping="max", mass="max")
    path = tmp_path / "profile.yaml"
    path.write_text(profile.to_yaml(), encoding="utf-8")
    check(path)
    said = profile.elements["it"].perceived_steps[effect]
    device, it = load_device("stylus"), profile.elements["it"]
    own = {"damping": device.damping.value, "mass": device.mass.value}[effect]
    plain = np.log1p(getattr(it, effect) / own) / np.log1p(_scale("stylus", effect).weber)
    assert plain > 1.3 * said
    for wrong in (1.003 * said, 0.997 * said, float(plain)):
        content: dict[str, Any] = to_mapping(profile)
        content["elements"]["it"]["perceived_steps"][effect] = float(wrong)
        content["digest"] = digest_of(content)
        path.write_text(to_yaml(content, "forged"), encoding="utf-8")
        with pytest.raises(CheckFailedError, match=f"perceived_steps.{effect} says"):
            check(path)


#: Table 2: the areas by stiffness (N/m), damping (N·s/m), mass (kg); area 1 in every trial, ...
AREA_1 = (500.0, 0.0, 0.0)
#: ... and area 2 in each of the seven.
AREA_2 = (
    (1000.0, 0.0, 0.0),
    (500.0, 10.0, 0.0),
    (500.0, 0.0, 1.0),
    (1000.0, 10.0, 0.0),
    (1000.0, 0.0, 1.0),
    (500.0, 10.0, 1.0),
    (1000.0, 10.0, 1.0),
)
COLUMN: dict[EffectName, int] = {"stiffness": 0, "damping": 1, "mass": 2}
#: Section 3.2.
PEOPLE = 20
#: Table 3 as printed: successes of 60 equal and of 80 different pairs.
TABLE_3: dict[EffectName, tuple[int, int]] = {
    "stiffness": (27, 77),
    "damping": (45, 77),
    "mass": (31, 61),
}
#: Table 3: the success rates with equal and with different settings as printed, %.
PRINTED: dict[EffectName, tuple[float, float]] = {
    "stiffness": (45.0, 96.25),
    "damping": (75.0, 96.25),
    "mass": (51.67, 76.25),
}
#: What the device itself adds to what is felt (section 3: m ≈ 3 kg, b almost 10 N·s/m).
OWN: dict[EffectName, float] = {"stiffness": 0, "mass": 3, "damping": 10}


def _study(effect: EffectName) -> Study:
    study = default_table().fraction(effect).study
    assert study is not None
    return study


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_shipped_counts_are_those_of_tables_2_and_3(effect: EffectName) -> None:
    study, column = _study(effect), COLUMN[effect]
    equal = sum(area[column] == AREA_1[column] for area in AREA_2)
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
