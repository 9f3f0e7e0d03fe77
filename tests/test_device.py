"""Quantities, hardware and devices: what they refuse and what they keep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from identification import (
    Covariance,
    Device,
    ForceLimit,
    Hardware,
    InvalidInputError,
    load_device,
    load_document,
    named_devices,
    parse_document,
    quantity,
    to_mapping,
    to_yaml,
)
from tests.bare_device import BARE, BEYOND, device


def test_a_quantity_is_a_number_or_a_mapping() -> None:
    plain = device(mass=3).mass
    assert (plain.value, plain.low, plain.high, plain.exact) == (3.0, 3.0, 3.0, True)
    assert device(mass={"value": 3.0}).mass == plain
    ranged = device(mass={"value": 3.0, "low": 2.9, "high": 3.2}).mass
    assert ranged == quantity(3.0, 2.9, 3.2)
    assert not ranged.exact


@pytest.mark.parametrize(
    "raw",
    [
        True,
        "3",
        None,
        [3.0],
        float("nan"),
        float("inf"),
        {"value": 3.0, "low": 3.1, "high": 4.0},
        {"value": 3.0, "low": 2.0, "high": 2.9},
        {"low": 2.0, "high": 2.9},
        {"value": 3.0, "extra": 1.0},
        {"value": 3.0, "source": "guess"},
    ],
)
def test_what_is_no_quantity(raw: object) -> None:
    with pytest.raises(ValidationError):
        device(mass=raw)


@pytest.mark.parametrize(
    "changes",
    [
        {"mass": 0.0},
        {"mass": {"value": 1.0, "low": -0.1, "high": 2.0}},
        {"sample_time": 0.0},
        {"delay": -1e-9},
        {"coulomb_friction": -0.1},
        {"encoder_resolution": 0.0},
        {"encoder_resolution": {"value": 1e-6, "low": 0.0, "high": 2e-6}},
        {"damping_by_direction": {"forward": 3.0}},
        {"damping_by_direction": 3.0},
        {"friction_by_direction": {"forward": 1.0, "backward": -0.1}},
        {"gravity": {"sine": 1.0}},
        {"position_stiffness": "soft"},
        {"force_limit": {"continuous": 3.0, "peak": 2.0}},
        {"motion": "spherical"},
        {"stiffness": 1.0},
        {"schema": "haptune/device/2"},
    ],
)
def test_what_is_no_device(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        device(**changes)


def test_damping_may_be_negative_and_delay_zero() -> None:
    assert device(damping=-2.0, delay=0.0).delay.value == 0.0


def test_a_missing_delay_is_one_sample() -> None:
    without = {key: value for key, value in BARE.items() if key != "delay"}
    assert Device.model_validate(without).delay == quantity(1e-3, source="assumed")
    without["sample_time"] = {"value": 2e-3, "low": 1.9e-3, "high": 2.1e-3}
    assert Device.model_validate(without).delay == quantity(2e-3, source="assumed")


@pytest.mark.parametrize("name", named_devices())
def test_named_devices_load_and_come_back(name: str, tmp_path: Path) -> None:
    found = load_device(name)
    path = tmp_path / "device.yaml"
    path.write_text(to_yaml(to_mapping(found)), encoding="utf-8")
    assert load_device(path) == found


def test_homerehab_is_the_axis_of_the_paper() -> None:
    found = load_device("homerehab")
    assert (found.mass.value, found.damping.value) == (3.0, 10.0)
    assert found.force_limit == ForceLimit(continuous=14.0, peak=28.0)
    assert found.encoder_resolution == quantity(6e-6)


def test_hardware_is_optional_in_every_key(tmp_path: Path) -> None:
    path = tmp_path / "hardware.yaml"
    path.write_text("schema: haptune/hardware/1\n", encoding="utf-8")
    found = load_document(Hardware, path)
    assert found == Hardware()
    for wrong in ({"sample_time": -1.0}, {"delay": -1.0}, {"encoder_resolution": 0.0}):
        with pytest.raises(InvalidInputError):
            parse_document(Hardware, wrong, "hardware.yaml")


def test_a_resolution_may_have_an_interval() -> None:
    found = Hardware.model_validate({"encoder_resolution": {"value": 2e-6, "low": 1e-6}})
    assert found.encoder_resolution == quantity(2e-6, 1e-6, 2e-6)
    assert Hardware.model_validate({"encoder_resolution": 2e-6}).encoder_resolution == quantity(
        2e-6
    )


def test_what_differs_by_direction_and_place_comes_back_from_a_file(tmp_path: Path) -> None:
    found = device(**BEYOND)
    assert found.damping_by_direction is not None
    assert found.damping_by_direction.backward == quantity(12.0, 11.0, 13.0)
    assert found.friction_by_direction is not None
    assert found.friction_by_direction.forward == quantity(0.5)
    assert found.position_stiffness == quantity(-3.0, -4.0, -2.0)
    assert found.gravity is not None
    assert found.gravity.cosine == quantity(0.1, -0.1, 0.3)
    path = tmp_path / "device.yaml"
    path.write_text(to_yaml(to_mapping(found)), encoding="utf-8")
    assert load_device(path) == found


def test_what_no_log_told_is_not_written() -> None:
    assert not BEYOND.keys() & to_mapping(device()).keys()
    assert not BEYOND.keys() & to_mapping(load_device("emps")).keys()


@pytest.mark.parametrize(
    ("parameters", "matrix", "freedom"),
    [
        (("mass",), ((1.0, 0.0), (0.0, 1.0)), 10.0),
        (("mass", "damping"), ((1.0,), (0.0, 1.0)), 10.0),
        (("mass",), ((-1.0,),), 10.0),
        (("mass",), ((1.0,),), 0.0),
    ],
)
def test_what_is_no_covariance(parameters: Any, matrix: Any, freedom: float) -> None:
    with pytest.raises(ValidationError):
        Covariance(parameters=parameters, matrix=matrix, degrees_of_freedom=freedom)
