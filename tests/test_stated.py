"""What nobody stated is asked for, all at once, before anything is solved."""

import shutil
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from datasets_synthetic import bundled_path
from identification import (
    Device,
    InvalidInputError,
    UnstatedError,
    as_stored,
    identify,
    load_device,
    load_mapping,
    load_trajectory,
    named_devices,
    parse_document,
    to_mapping,
    to_yaml,
)
from tests.commands import FLUID, files, haptune
from tune import CheckFailedError, Scene, check, export, load_profile, optimise

FACTS = ("motion", "sample_time", "delay", "encoder_resolution", "force_limit")
#: A device of which a person states everything.
STATED: dict[str, Any] = {
    "motion": "linear",
    "sample_time": 0.001,
    "delay": 0.0,
    "encoder_resolution": 0.000006,
    "force_limit": {"continuous": 14.0, "peak": 28.0},
    "mass": {"value": 3.0, "low": 2.9, "high": 3.1},
    "damping": {"value": 10.0, "low": 9.5, "high": 10.5},
}
SCENE = Scene.model_validate({"elements": {"water": {"damping": 10.0}}})


@pytest.fixture(autouse=True)
def _here(here: Path) -> None:
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")


def _device(**changes: Any) -> Device:
    content = {key: item for key, item in (STATED | changes).items() if item is not ...}
    return parse_document(Device, content, "device.yaml")


def test_a_device_that_a_person_wrote_in_full_lacks_nothing() -> None:
    device = _device()
    assert device.missing == device.unstated() == ()
    device.require_stated()
    assert "missing" not in to_mapping(device)
    for name in named_devices():
        assert load_device(name).unstated() == ()


@pytest.mark.parametrize("fact", FACTS)
@pytest.mark.parametrize("how", ["absent", "blank", "listed"])
def test_each_fact_can_be_missing_and_stays_so_in_its_file(fact: str, how: str) -> None:
    changes = {"absent": {fact: ...}, "blank": {fact: None}, "listed": {"missing": [fact]}}[how]
    if fact == "sample_time" and how != "listed":
        with pytest.raises(InvalidInputError, match="sample_time"):
            _device(**changes)
        return
    device = _device(**changes)
    assert device.missing == device.unstated() == (fact,)
    assert as_stored(device) == device
    text = to_yaml(to_mapping(device), "")
    Path("device.yaml").write_text(text, encoding="utf-8")
    assert load_device("device.yaml") == device
    assert ("motion: linear" in text) is (fact != "motion")


@pytest.mark.parametrize(
    ("fact", "seen", "hint"),
    [
        ("sample_time", {"value": 0.001, "source": "log"}, "steps by 0.001 s"),
        ("encoder_resolution", {"value": 6e-6, "source": "log"}, "is 6e-06"),
        ("force_limit", {"continuous": 9.0, "peak": 9.0, "source": "log"}, "--force-gain"),
        ("delay", {"value": 1e-3, "low": 0.0, "high": 1.1e-3, "source": "log"}, "0 to 0.0011 s"),
    ],
)
def test_what_a_log_says_is_a_hint_and_no_statement(
    fact: str, seen: dict[str, Any], hint: str
) -> None:
    with pytest.raises(UnstatedError) as caught:
        optimise(_device(**{fact: seen}), SCENE)
    (asked,) = caught.value.missing
    assert asked.key == fact
    assert asked.write.startswith(f"{fact}: ")
    assert hint in asked.hint
    assert "a hint that is not used" in str(caught.value)


def test_nothing_is_solved_before_all_is_stated() -> None:
    bare = _device(motion=..., force_limit=..., encoder_resolution=..., delay=...)
    with (
        mock.patch("tune.optimisation.choose_filters", side_effect=AssertionError),
        pytest.raises(UnstatedError) as caught,
    ):
        optimise(bare, SCENE)
    assert [each.key for each in caught.value.missing] == [
        fact for fact in FACTS if fact != "sample_time"
    ]
    # A copy is no way round it.
    copied = _device().model_copy(update={"force_limit": None})
    with pytest.raises(UnstatedError, match="force_limit"):
        optimise(copied, SCENE)


def test_the_question_of_calibrate_and_its_answer() -> None:
    shutil.copy(bundled_path("homerehab.csv"), "log.csv")
    haptune("new", "hardware", "--quiet")
    form = Path("hardware.yaml").read_text(encoding="utf-8")
    calibrate = (
        *("calibrate", "log.csv", "--scene", "scene.yaml", "--hardware", "hardware.yaml"),
        *("--method", "least-squares"),
    )
    asked = haptune(*calibrate, "--json")
    assert asked.code == 3
    assert asked.result["outputs"] == []
    keys = [each["key"] for each in asked.result["details"]["missing"]]
    assert keys == ["motion", "sample_time", "encoder_resolution", "force_limit"]
    assert "--hardware" in asked.err
    assert all(f"\n  {key}: " in asked.err for key in keys)
    for blank, answer in (
        ("motion:", "motion: linear"),
        ("sample_time:", "sample_time: 0.001"),
        ("encoder_resolution:", "encoder_resolution: 0.000006"),
        ("force_limit:", "force_limit: {continuous: 14.0, peak: 28.0}"),
    ):
        form = form.replace(f"\n{blank} ", f"\n{answer} ")
    Path("hardware.yaml").write_text(form, encoding="utf-8")
    ended = haptune(*calibrate)
    assert ended.code == 0, ended.err
    device = load_profile("profile.yaml").device
    assert device.missing == ()
    assert device.delay.source == "log"
    assert device.delay.low <= 0.001 <= device.delay.high
    assert haptune("check", "profile.yaml", "--quiet").code == 0


def test_a_device_file_is_asked_about_and_mended_in_place() -> None:
    log = load_trajectory(bundled_path("homerehab.csv"))
    found = identify(log, method="least-squares")
    Path("device.yaml").write_text(to_yaml(to_mapping(found.device), ""), encoding="utf-8")
    before = files()
    for command in (("tune", "device.yaml", "scene.yaml"), ("audit", "device.yaml", "--mass", "1")):
        asked = haptune(*command)
        assert asked.code == 3
        assert "device.yaml: does not state motion, sample_time" in asked.err
        assert files() == before
    content = load_mapping("device.yaml")
    assert content["missing"] == ["motion", "sample_time", "encoder_resolution", "force_limit"]
    answers = {key: STATED[key] for key in content["missing"]}
    half = {**content, **answers}
    Path("device.yaml").write_text(to_yaml(half, ""), encoding="utf-8")
    assert "'missing'" in haptune("tune", "device.yaml", "scene.yaml").err
    del half["missing"]
    Path("device.yaml").write_text(to_yaml(half, ""), encoding="utf-8")
    assert haptune("tune", "device.yaml", "scene.yaml", "--quiet").code == 0


def test_a_profile_of_an_unstated_device_is_neither_passed_nor_exported() -> None:
    profile = optimise(_device(), SCENE)
    device = _device(force_limit={"continuous": 14.0, "peak": 28.0, "source": "log"})
    forged = profile.model_copy(update={"device": device}).signed()
    Path("profile.yaml").write_text(forged.to_yaml(), encoding="utf-8")
    with pytest.raises(CheckFailedError, match=r"device\.force_limit was stated by nobody"):
        check("profile.yaml")
    assert haptune("export", "profile.yaml", "--to", "c").code == 6
    with pytest.raises(UnstatedError):
        export(forged, "c")
