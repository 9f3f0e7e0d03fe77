"""What a profile says a hand feels, recomputed from the law in balls."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from identification import load_device, quantity, to_mapping
from tests.thinned import thinned
from tune.certificate.claims import rendering_failures
from tune.certificate.region import setting_of
from tune.documents.profile import Design, SafeProfile
from tune.documents.scene import Scene
from tune.optimisation._optimise import optimise

LOOPS: tuple[dict[str, Any], ...] = (
    {},
    {"velocity_filter_hz": 12.0, "acceleration_filter_hz": 30.0},
    {"velocity_filter_hz": 60.0, "velocity_filter_order": 2, "acceleration_filter_hz": 8.0},
    {"velocity_window_samples": 15, "acceleration_filter_hz": 25.0, "acceleration_filter_order": 1},
)


def _profile(name: str, loop: dict[str, Any], *, lag: bool, delay: float) -> SafeProfile:
    device = load_device(name)
    step = device.sample_time.value
    changes: dict[str, Any] = {"delay": quantity(delay * step)}
    if lag:
        changes["current_lag"] = quantity(0.4 * step)
    scene = {
        "elements": {
            "wall": {"stiffness": "max", "damping": "max"},
            "cup": {"mass": "max", "damping": "max"},
            "feather": {"mass": "min", "damping": "max"},
        },
        "ripple_limit": 1e3,
        "loop": loop,
    }
    return optimise(device.model_copy(update=changes), Scene.model_validate(scene))


@pytest.mark.parametrize("loop", thinned(LOOPS, 1), ids=lambda loop: " ".join(loop) or "free")
@pytest.mark.parametrize(("lag", "delay"), thinned([(True, 2.3), (False, 1.0)], 1))
@pytest.mark.parametrize("name", thinned(["homerehab", "knob"], 1))
def test_what_is_written_is_what_the_law_makes_felt(
    name: str, loop: dict[str, Any], lag: bool, delay: float
) -> None:
    profile = _profile(name, loop, lag=lag, delay=delay)
    assert profile.perception is not None
    for element, said in profile.elements.items():
        setting = setting_of(profile, (element,))
        assert setting is not None
        assert said.perceived_steps
        assert rendering_failures(profile, element, setting) == []


def test_every_number_is_looked_at() -> None:
    content = to_mapping(_profile("homerehab", LOOPS[3], lag=False, delay=1.0))
    places = [
        (element, part, key)
        for element, said in content["elements"].items()
        for part in ("rendered", "perceived_steps")
        for key in said[part]
    ]
    assert len(places) == 3 * 4 + 6
    for element, part, key in places:
        forged = Design.model_validate(
            {k: v for k, v in content.items() if k not in {"certificate", "digest"}}
        )
        said = getattr(forged.elements[element], part)
        truth = np.ravel(content["elements"][element][part][key])
        more = (truth + 0.2 * max(1.0, float(np.max(np.abs(truth))))).tolist()
        value = more[0] if len(more) == 1 else tuple(more)
        changed = (
            {**said, key: value}
            if part == "perceived_steps"
            else said.model_copy(update={key: value})
        )
        forged.elements[element] = forged.elements[element].model_copy(update={part: changed})
        setting = setting_of(forged, (element,))
        assert setting is not None
        assert any(
            f"{part}.{key} says" in words for words in rendering_failures(forged, element, setting)
        )


def test_a_profile_that_does_not_say_how_fine_hands_are_is_checked_for_the_rest() -> None:
    profile = _profile("homerehab", LOOPS[1], lag=False, delay=1.0)
    wall = profile.elements["wall"]
    wrong = wall.model_copy(update={"perceived_steps": {"stiffness": 99.0}})
    design = profile.model_copy(
        update={"perception": None, "elements": {**profile.elements, "wall": wrong}}
    )
    setting = setting_of(design, ("wall",))
    assert setting is not None
    assert rendering_failures(design, "wall", setting) == []


def test_a_mass_that_is_honey_is_refused_unless_a_person_asked_for_it() -> None:
    """At 20 Hz one kilogram lags by 17 ms: at 5 Hz it brakes by 15 N·s/m, the device by 10."""
    cup = {"cup": {"mass": 1.0, "acceleration": 2.0}}
    scene = {"elements": cup, "loop": {"acceleration_filter_hz": 20.0}}
    wanted = optimise(load_device("homerehab"), Scene.model_validate(scene))
    setting = setting_of(wanted, ("cup",))
    assert setting is not None
    assert wanted.elements["cup"].as_commanded
    assert rendering_failures(wanted, "cup", setting) == []
    claimed = wanted.elements["cup"].model_copy(update={"as_commanded": False})
    forged = wanted.model_copy(update={"elements": {"cup": claimed}})
    (honey,) = rendering_failures(forged, "cup", setting)
    assert honey.startswith("cup: at 5 Hz a hand feels 15.1")
    assert "0 is asked for" in honey
