"""Each ``limited_by`` is true: relax that constraint alone, and the value grows."""

from __future__ import annotations

from typing import Any

import pytest

from identification import Device, load_device, parse_document, to_mapping
from tune.optimisation import optimise
from tune.profile import SafeProfile
from tune.scene import Scene

FIXED = {"loop": {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0}}


def _device(**changes: Any) -> Device:
    stated = to_mapping(load_device("homerehab"))
    return parse_document(Device, {**stated, **changes}, "device.yaml")


def _tuned(device: Device, element: dict[str, Any], **scene: Any) -> SafeProfile:
    wish = Scene.model_validate({**FIXED, **scene, "elements": {"it": element}})
    return optimise(device, wish)


BOUNDLESS = {"continuous": 1e5, "peak": 1e5}

#: (effect, its limit, device, element, scene, what is relaxed in device, element and scene).
CASES: list[tuple[str, str, dict[str, Any], dict[str, Any], dict[str, Any], tuple[Any, ...]]] = [
    (
        "stiffness",
        "force",
        {},
        {"stiffness": "max"},
        {},
        ({"force_limit": {"continuous": 15.0, "peak": 28.0}}, {}, {}),
    ),
    (
        "damping",
        "force",
        {},
        {"damping": "max"},
        {},
        ({"force_limit": {"continuous": 14.0, "peak": 30.0}}, {}, {}),
    ),
    ("mass", "ripple", {}, {"mass": "max"}, {}, ({}, {}, {"ripple_limit": 0.12})),
    (
        "stiffness",
        "delay-margin",
        {"force_limit": BOUNDLESS},
        {"stiffness": "max"},
        {},
        ({"delay": 0.0009}, {}, {}),
    ),
    (
        "damping",
        "gain-margin",
        {},
        {"damping": "min"},
        {},
        ({}, {}, {"margin": "firm"}),
    ),
    ("damping", "wanted", {}, {"damping": 10.0}, {}, ({}, {"damping": 12.0}, {})),
    (
        "stiffness",
        "range",
        {},
        {"stiffness": {"min": 100.0, "max": 900.0}},
        {},
        ({}, {"stiffness": {"min": 100.0, "max": 1000.0}}, {}),
    ),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}-{case[1]}")
def test_relaxing_what_binds_lets_the_value_grow(
    case: tuple[str, str, dict[str, Any], dict[str, Any], dict[str, Any], tuple[Any, ...]],
) -> None:
    effect, limit, device, element, scene, relaxed = case
    profile = _tuned(_device(**device), element, **scene)
    found = profile.elements["it"]
    assert found.limited_by == {effect: limit}
    freer = _tuned(_device(**{**device, **relaxed[0]}), {**element, **relaxed[1]}, **relaxed[2])
    assert abs(getattr(freer.elements["it"], effect)) > 1.005 * abs(getattr(found, effect))


def test_what_no_hand_could_tell_is_played_once_the_encoder_is_finer() -> None:
    """A coarse encoder leaves less than a step of mass; a finer one lets it grow beyond."""
    both = {"damping": "max", "mass": "max"}
    coarse = _tuned(_device(encoder_resolution=6e-5), both).elements["it"]
    assert coarse.limited_by["mass"] == "not-perceptible"
    assert coarse.mass == 0
    fine = _tuned(_device(encoder_resolution=6e-6), both).elements["it"]
    assert fine.limited_by["mass"] != "not-perceptible"
    assert fine.perceived_steps["mass"] >= 1
