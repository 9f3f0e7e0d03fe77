"""Weber's law with a floor, from scale to profile: light devices move, the paper's does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import load_device, to_mapping, to_yaml
from tests.commands import digest_of
from tests.simulated.experiment import EFFECTS, EffectName
from tune import SafeProfile, Scale, Scene, chance_to_tell_apart, check, default_table, optimise
from tune.documents import CheckFailedError
from tune.documents.scene import DEFAULT_MOTION, Motion

#: Smallest forces that are noticed, N and N·m, over depth, speed and acceleration.
FLOORS = {
    "stylus": {"stiffness": 0.1 / 0.01, "damping": 0.1 / 0.2, "mass": 0.1 / 2.0},
    "knob": {"stiffness": 0.005 / 0.1, "damping": 0.005 / 2.0, "mass": 0.005 / 20.0},
}


def _scale(name: str, effect: EffectName) -> Scale:
    device = load_device(name)
    return Scale.of(effect, device, default_table(), DEFAULT_MOTION[device.motion])


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
        "loop": {"velocity_filter_hz": 60.0, "acceleration_filter_hz": 20.0},
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
