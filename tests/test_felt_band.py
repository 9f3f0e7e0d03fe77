"""What is tuned is felt as what is asked for at 400 frequencies from 0.5 to 20 Hz, and said so."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import load_device, quantity
from tests.felt import HERTZ, MOTION, beyond, felt
from tune import SafeProfile, Scene, check, optimise

#: Weber fractions of damping and mass of the study, and the force that is just noticed.
WEBER, NOTICED = (0.267, 0.225), {"linear": 0.1, "rotary": 0.005}


def _tuned(device: str, element: dict[str, Any], **loop: Any) -> SafeProfile:
    scene = {"elements": {"it": element}, "loop": loop}
    return optimise(load_device(device), Scene.model_validate(scene)).signed()


def _broken(device: str, profile: SafeProfile) -> list[str]:
    it, stated = profile.elements["it"], load_device(device)
    reach = (
        NOTICED[stated.motion] / it.motion.speed,
        NOTICED[stated.motion] / it.motion.acceleration,
    )
    assert profile.perception is not None
    weber = profile.perception.damping, profile.perception.mass
    assert weber == pytest.approx(WEBER, abs=1e-3)
    seen = felt(stated, profile.loop, it.stiffness, it.damping, it.mass)
    return beyond(stated, seen, it.damping, it.mass, weber=weber, floors=reach)


@pytest.mark.parametrize(
    ("damping", "ratio", "least"), [(10.0, 0.5, 0.9), (30.0, None, 1.6), (None, None, 1.1)]
)
def test_a_mass_one_can_use_is_felt_as_one_on_400_frequencies(
    damping: float | None, ratio: float | None, least: float, tmp_path: Path
) -> None:
    """Cut-offs are chosen, and kinds, orders and damping ratio with them where they are free.

    10 N·s/m behind 5 Hz would repay the damping of the mass by its lag at both ends of the motions;
    at 12 Hz 52 would be felt.
    """
    element = {"mass": "max", "damping": damping}
    free = {"velocity_filter": "free", "acceleration_filter": "free"}
    loop = free if ratio is None else {"filter_damping_ratio": ratio}
    profile = _tuned("homerehab", element, **loop)
    it = profile.elements["it"]
    # The paper: at most a mass "equal to the physical mass", 3 kg.
    assert least <= it.mass <= 3.0
    assert it.limited_by["mass"] in {"ripple", "rendering"}
    assert it.damping >= 0.97 * (damping or 0.0)
    assert _broken("homerehab", profile) == []
    seen = felt(load_device("homerehab"), profile.loop, it.stiffness, it.damping, it.mass)
    said = it.rendered
    assert said is not None
    # What is told is found between the 400 too.
    for told, values in (
        (said.mass_in_motion, seen.mass[MOTION]),
        (said.damping_in_motion, seen.damping[MOTION]),
        (said.mass_beyond, seen.mass[HERTZ >= 5]),
        (said.damping_beyond, seen.damping[HERTZ >= 5]),
    ):
        size = float(np.max(np.abs(values)))
        assert told == pytest.approx((values.min(), values.max()), abs=2e-3 * size)
    path = tmp_path / "profile.yaml"
    path.write_text(profile.to_yaml(), encoding="utf-8")
    check(path)


def test_a_peak_of_what_is_felt_near_20_hertz_is_kept_within_its_limit() -> None:
    """A pair of poles that rings puts it between two of few frequencies: check refused it."""
    loop = {"velocity_filter_hz": "none", "acceleration_filter_hz": 23.52}
    element = {"stiffness": "max", "damping": "max", "mass": "max"}
    profile = _tuned("homerehab", element, **loop, filter_damping_ratio=0.5)
    assert profile.elements["it"].mass > 0.9
    assert _broken("homerehab", profile) == []


@pytest.mark.parametrize(
    ("device", "effects"),
    [
        ("homerehab", ("stiffness", "damping")),
        ("stylus", ("damping", "mass")),
        ("knob", ("damping", "mass")),
        ("homerehab", ("stiffness", "damping", "mass")),
        ("stylus", ("stiffness", "damping", "mass")),
        ("knob", ("stiffness", "damping", "mass")),
    ],
)
def test_effects_raised_together_keep_to_it_with_any_filters(
    device: str, effects: tuple[str, ...]
) -> None:
    rng = np.random.default_rng(len(device) + len(effects))
    velocity, acceleration = np.exp(rng.uniform(np.log([40, 20]), np.log([200, 60])))
    profile = _tuned(
        device,
        dict.fromkeys(effects, "max"),
        velocity_filter_hz=float(velocity),
        acceleration_filter_hz=float(acceleration),
        filter_damping_ratio=float(rng.uniform(0.4, 1)),
    )
    assert _broken(device, profile) == []
    assert profile.elements["it"].perceived_steps


def test_a_late_spring_takes_no_more_damping_than_there_is() -> None:
    """One step less than so little damping would be below none."""
    late = {"damping": quantity(0.27), "delay": quantity(0.003)}
    device = load_device("stylus").model_copy(update=late)
    element = {"stiffness": "max", "mass": "max"}
    wanted = Scene.model_validate({"margin": "firm", "elements": {"it": element}})
    profile = optimise(device, wanted)
    it = profile.elements["it"]
    assert it.stiffness > 75
    seen = felt(device, profile.loop, it.stiffness, it.damping, it.mass)
    assert 0 <= 0.27 + seen.damping.min() < 0.01
