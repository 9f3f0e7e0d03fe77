"""Perceived steps, with a floor of Weber's law, the Weber fractions shipped, and own tables."""

import math
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification import InvalidInputError, load_device, load_document, to_mapping, to_yaml
from tests.commands import digest_of
from tests.simulated.experiment import EFFECTS, EffectName
from tune import (
    CheckFailedError,
    PerceptionTable,
    SafeProfile,
    Scale,
    Scene,
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


TABLE = """\
schema: haptune/perception/1
name: mine
stiffness: {value: 0.23, source: a paper, people: 11}
damping: {value: 0.2, low: 0.15, high: 0.3, source: a paper}
mass: {value: 0.22, source: ours}
force_threshold: {value: 0.2, source: a paper}
torque_threshold: {value: 0.01, source: a paper}
"""


def test_a_table_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(TABLE, encoding="utf-8")
    table = load_document(PerceptionTable, path)
    device = load_device("homerehab")
    plain = Scale.of("mass", device, table, MOTION).estimate(3.0, table.mass)
    assert plain.value == pytest.approx(math.log(2) / math.log(1.22))
    assert (plain.low, plain.high) == (None, None)
    ranged = Scale.of("damping", device, table, MOTION).estimate(10.0, table.damping)
    assert ranged.low == pytest.approx(math.log(2) / math.log(1.3))


#: what the refusal must say, what is replaced, by what
WRONG = (
    ("stiffness.value: is missing", "value: 0.23, ", ""),
    ("give low and high together", "low: 0.15, ", ""),
    ("needs low <= value <= high", "low: 0.15", "low: 0.25"),
    ("less than 10", "value: 0.23", "value: 23.0"),
    ("schema is 'haptune/scene/1'", "haptune/perception/1", "haptune/scene/1"),
    ("people", "people: 11", "people: 0"),
    ("stiffness.stated: is no key", "value: 0.23", "stated: 0.23"),
    ("damping: is missing", "damping: {value: 0.2, low: 0.15, high: 0.3, source: a paper}\n", ""),
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


def test_a_hand_that_is_slow_feels_less_of_a_damper() -> None:
    device, table = load_device("stylus"), default_table()
    found = [
        Scale.of("damping", device, table, Motion(speed=speed, acceleration=2.0)).steps(0.05)
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


#: Table 3 as printed: of 60 equal and of 80 different pairs those that were told rightly, %.
PRINTED: dict[EffectName, tuple[float, float]] = {
    "stiffness": (45.0, 96.25),
    "damping": (75.0, 96.25),
    "mass": (51.67, 76.25),
}
#: Ratio of the two settings that were shown, with what the device itself adds (section 3).
RATIO: dict[EffectName, float] = {"stiffness": 2.0, "damping": 2.0, "mass": 4 / 3}


@pytest.mark.parametrize(
    ("effect", "sensitivity", "percent"),
    [("stiffness", 2.378, 33.8), ("damping", 2.931, 26.7), ("mass", 1.415, 22.5)],
)
def test_weber_fractions_of_the_paper(
    effect: EffectName, sensitivity: float, percent: float
) -> None:
    """d' and w from the counts by the mpmath quantile, and as the theory states them."""
    import mpmath

    equal, different = (
        round(n * rate / 100) for n, rate in zip((60, 80), PRINTED[effect], strict=True)
    )
    c = mpmath.sqrt(2) * mpmath.erfinv(mpmath.mpf(equal) / 60)
    exact = c + mpmath.sqrt(2) * mpmath.erfinv(2 * mpmath.mpf(different) / 80 - 1)
    assert float(exact) == pytest.approx(sensitivity, abs=5e-4)
    found = default_table().fraction(effect)
    assert found.value == pytest.approx(RATIO[effect] ** (1 / float(exact)) - 1, rel=1e-12)
    assert 100 * found.value == pytest.approx(percent, abs=0.05)
    assert found.people == 20


@pytest.mark.parametrize("effect", EFFECTS)
def test_intervals_are_those_of_the_counts(effect: EffectName) -> None:
    """95 % of Jeffreys' posterior of both rates, by chance draws of it."""
    lot, normal = np.random.default_rng(0), NormalDist()
    equal, different = (
        round(n * rate / 100) for n, rate in zip((60, 80), PRINTED[effect], strict=True)
    )
    draws = zip(
        lot.beta(equal + 0.5, 60 - equal + 0.5, 40_000),
        lot.beta(different + 0.5, 80 - different + 0.5, 40_000),
        strict=True,
    )
    felt = [normal.inv_cdf((1 + e) / 2) + normal.inv_cdf(d) for e, d in draws]
    high, low = RATIO[effect] ** (1 / np.quantile(felt, [0.025, 0.975])) - 1
    found = default_table().fraction(effect)
    assert (found.low, found.high) == pytest.approx((low, high), rel=0.01)
