"""Inputs at the edge of sense: a right answer, or a sentence and its exit code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from identification import Device, ForceLimit, load_device, quantity, to_mapping, to_yaml
from tests.commands import Ended, haptune
from tune import load_profile

FILTERS = "loop: {velocity_filter_hz: 50.0, acceleration_filter_hz: 30.0}\n"
WALL = "elements: {wall: {stiffness: max}}\n"
BLOCK = "elements: {block: {stiffness: max, damping: max, mass: max}}\n" + FILTERS


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def _device(**changes: Any) -> Device:
    return load_device("homerehab").model_copy(update=changes)


def _tuned(device: Device, scene: str) -> Ended:
    Path("device.yaml").write_text(to_yaml(to_mapping(device)), encoding="utf-8")
    Path("scene.yaml").write_text(scene, encoding="utf-8")
    return haptune("tune", "device.yaml", "scene.yaml", "-o", "profile.yaml")


def _refused(ended: Ended, code: int, *words: str) -> None:
    """One sentence with all the words, and nothing written."""
    assert ended.code == code, ended.err
    sentence = " ".join(ended.err.split())
    for word in words:
        assert word in sentence
    assert not Path("profile.yaml").exists()


# The damping of the device may be nothing at all.


@pytest.mark.parametrize("low", [-2.0, 0.0])
def test_a_spring_on_a_device_that_may_have_no_damping_is_refused(low: float) -> None:
    ended = _tuned(_device(damping=quantity(5.0, low, 12.0)), WALL)
    _refused(ended, 5, "lowest damping of the device is", "not positive", "longer log")


def test_a_damper_of_its_own_does_not_help_where_damping_may_be_negative() -> None:
    ended = _tuned(_device(damping=quantity(5.0, -2.0, 12.0)), BLOCK)
    _refused(ended, 5, "not positive", "add damping")


# The device is known exactly.


def test_a_device_without_any_interval_is_certified_as_it_is() -> None:
    device = _device(mass=quantity(3.0), damping=quantity(10.0), delay=quantity(0.0))
    ended = _tuned(device, BLOCK)
    assert ended.code == 0, ended.err
    certificate = load_profile(Path("profile.yaml")).certificate
    assert certificate.mass == (3.0, 3.0)
    assert certificate.delay_samples == (0.0, 0.0)
    assert haptune("check", "profile.yaml").code == 0


# The mass of the device may be anything within a decade.


# Nothing can be played.


def test_no_effect_that_a_hand_could_tell() -> None:
    device = _device(encoder_resolution=quantity(1e-3))
    ended = _tuned(device, "elements: {cup: {mass: max}}\n" + FILTERS)
    _refused(ended, 5, "cup.mass", "of a step a hand can tell", "limited by ripple")


@pytest.mark.parametrize("effect", ["stiffness", "damping", "mass"])
def test_no_force_at_all(effect: str) -> None:
    device = _device(force_limit=ForceLimit(continuous=0.0, peak=0.0))
    ended = _tuned(device, f"elements: {{it: {{{effect}: max}}}}\n" + FILTERS)
    _refused(ended, 5, f"it.{effect}", "exceeds the force limit, 0 continuous and 0 at the peak")


# Wishes that contradict each other or the device.


def test_a_range_upside_down() -> None:
    ended = _tuned(_device(), "elements: {wall: {stiffness: {min: 300, max: 200}}}\n")
    _refused(ended, 3, "min 300 exceeds max 200")


def test_a_range_that_starts_beyond_what_is_safe() -> None:
    ended = _tuned(_device(), "elements: {wall: {stiffness: {min: 20000, max: 30000}}}\n")
    _refused(ended, 5, "wall.stiffness", "range starts at 20000", "is not stable")


def test_ranges_that_are_each_possible_but_not_at_once() -> None:
    """14 N carry 1000 N/m over 10 mm, or another 1000 N/m, and not both."""
    one = "{penetration: 0.01, stiffness: {min: 1000, max: 1200}}"
    apart = f"elements: {{wall: {one}, floor: {one}}}\n"
    assert _tuned(_device(), apart).code == 0
    Path("profile.yaml").unlink()
    ended = _tuned(_device(), apart + "together: [[wall, floor]]\n")
    _refused(ended, 5, "range starts at 1000", "together with the other effects")


# Very many things.
