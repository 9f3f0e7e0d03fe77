"""A device that its own force pushes away: nothing on it is certified, whatever the effect."""

from pathlib import Path
from typing import Any

import pytest

from datasets_synthetic import log_text
from identification import Device, load_device, parse_document, to_mapping, to_yaml
from tests.commands import haptune
from tests.simulated.families import FAMILIES
from tune import (
    CheckFailedError,
    Effects,
    NoFeasibleEffectError,
    SafeProfile,
    Scene,
    audit,
    optimise,
)
from tune.certificate.certify import certify
from tune.certificate.check import check_content
from tune.verification import advise

PUSHED: dict[str, Any] = {"position_stiffness": -500.0}
#: What pushes a device away from where it is, at least somewhere in its box or on its travel.
UNBALANCED: dict[str, dict[str, Any]] = {
    "a spring that pushes away": PUSHED,
    "a spring of either sign": {"position_stiffness": {"value": 1.0, "low": -2.0, "high": 4.0}},
    "a spring that may be none": {"position_stiffness": {"value": 1.0, "low": 0.0, "high": 2.0}},
    "a pendulum that hangs": {"gravity": {"sine": 1.5, "cosine": 0.0}},
    "a pendulum that stands": {"gravity": {"sine": -1.5, "cosine": 0.0}},
    "a level arm": {"gravity": {"sine": 0.0, "cosine": 0.4}},
    "an arm on a spring": {"position_stiffness": 50.0, "gravity": {"sine": 1.0, "cosine": 0.0}},
}
WALL = Scene.model_validate({"elements": {"wall": {"stiffness": 300.0}}})


def with_force(**force: Any) -> Device:
    """HomeRehab with a force by position of its own."""
    return parse_document(Device, to_mapping(load_device("homerehab")) | force, "device.yaml")


@pytest.fixture(scope="module")
def plain() -> SafeProfile:
    """A wall on HomeRehab as it is."""
    return optimise(load_device("homerehab"), WALL)


@pytest.mark.parametrize("force", UNBALANCED.values(), ids=UNBALANCED)
def test_nothing_is_tuned_audited_or_certified(force: dict[str, Any], plain: SafeProfile) -> None:
    device = with_force(**force)
    (name, *_) = reversed(force)
    with pytest.raises(NoFeasibleEffectError, match=f"device: {name}"):
        optimise(device, WALL)
    found = audit(device, Effects(stiffness=300.0))
    assert not found.safe
    assert found.faults[0].limit == "device"
    assert found.nearest is None
    assert found.certificate is None
    forged = plain.model_copy(update={"device": device})
    for verdict in (certify, advise):
        with pytest.raises(CheckFailedError, match=f"device: {name}"):
            verdict(forged)


def test_a_spring_of_its_own_is_certified_stated_and_checked() -> None:
    spring = {"value": 500.0, "low": 480.0, "high": 530.0}
    profile = optimise(with_force(position_stiffness=spring), WALL)
    stated = profile.certificate
    box = profile.device.simultaneous_box().position_stiffness
    assert stated.position_stiffness == pytest.approx(box, rel=1e-9)
    assert any("force by position is proportional" in each for each in stated.assumes)
    assert stated.worst.position_stiffness is not None
    assert box[0] <= stated.worst.position_stiffness <= box[1]
    content = to_mapping(profile)
    assert check_content(content, "profile.yaml").certificate.interior == {"wall": "proved"}
    for key, value, said in (
        ("position_stiffness", [400.0, 600.0], "certificate.position_stiffness says"),
        ("worst", content["certificate"]["worst"] | {"position_stiffness": 300.0}, "not a point"),
    ):
        other = content | {"certificate": content["certificate"] | {key: value}}
        with pytest.raises(CheckFailedError, match=said):
            check_content(other, "profile.yaml")


def test_identify_warns_of_what_tune_refuses(here: Path) -> None:
    """The log of an arm that hangs: gravity is found, the device written, the warning given."""
    (log,) = FAMILIES["offset-gravity"].logs([0])
    Path("log.csv").write_text(log_text(log), encoding="utf-8")
    Path("hardware.yaml").write_text("motion: rotary\n", encoding="utf-8")
    ended = haptune("identify", "log.csv", "--hardware", "hardware.yaml", "-o", "device.yaml")
    assert ended.code == 0, ended.err
    assert "warning: tune will refuse this device: gravity: the slope" in ended.err
    assert load_device("device.yaml").gravity is not None


def test_commands_end_in_5_and_6(here: Path, plain: SafeProfile) -> None:
    device = with_force(**PUSHED)
    Path("device.yaml").write_text(to_yaml(to_mapping(device)), encoding="utf-8")
    Path("scene.yaml").write_text("elements: {wall: {stiffness: 300.0}}\n", encoding="utf-8")
    forged = plain.model_copy(update={"device": device}).signed()
    Path("old.yaml").write_text(forged.to_yaml(), encoding="utf-8")
    for code, command in (
        (5, ("tune", "device.yaml", "scene.yaml")),
        (6, ("audit", "device.yaml", "--stiffness", "300")),
        (6, ("check", "old.yaml")),
        (6, ("export", "old.yaml", "--to", "json")),
        (6, ("verify", "old.yaml")),
    ):
        ended = haptune(*command)
        assert ended.code == code, (command, ended.err)
        assert "device: position_stiffness: -500 to -500 N/m" in ended.err
        assert "needed: above 0 N/m throughout, or none" in ended.err
        assert "Counterbalance the axis" in ended.err
    assert not Path("profile.yaml").exists()
