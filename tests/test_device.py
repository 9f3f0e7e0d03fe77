"""Quantities, hardware and devices: what they refuse and keep, and the box that holds them."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from identification import (
    Device,
    ForceLimit,
    Hardware,
    InvalidInputError,
    load_device,
    named_devices,
    parse_document,
    quantity,
    to_mapping,
    to_yaml,
)

BARE: dict[str, Any] = {"sample_time": 1e-3, "mass": 3.0, "damping": 10.0, "delay": 1e-3}


def device(**changes: Any) -> Device:
    """The bare device with some keys of its file changed or added."""
    return Device.model_validate(BARE | changes)


#: Everything a log can tell beyond mass, damping, friction and offset.
BEYOND: dict[str, Any] = {
    "damping_by_direction": {
        "forward": {"value": 9.0, "low": 8.5, "high": 9.5},
        "backward": {"value": 12.0, "low": 11.0, "high": 13.0},
    },
    "friction_by_direction": {"forward": 0.5, "backward": {"value": 0.7, "low": 0.6, "high": 0.8}},
    "position_stiffness": {"value": -3.0, "low": -4.0, "high": -2.0},
    "gravity": {"sine": 1.5, "cosine": {"value": 0.1, "low": -0.1, "high": 0.3}},
}


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


def read_again(found: Device, folder: Path) -> Device:
    """A device as its file has it."""
    path = folder / "device.yaml"
    path.write_text(to_yaml(to_mapping(found)), encoding="utf-8")
    return load_device(path)


@pytest.mark.parametrize("name", named_devices())
def test_named_devices_load_and_come_back(name: str, tmp_path: Path) -> None:
    assert read_again(load_device(name), tmp_path) == load_device(name)


def test_homerehab_is_the_axis_of_the_paper() -> None:
    found = load_device("homerehab")
    assert (found.mass.value, found.damping.value) == (3.0, 10.0)
    assert found.force_limit == ForceLimit(continuous=14.0, peak=28.0)
    assert found.encoder_resolution == quantity(6e-6)


def test_what_differs_by_direction_and_place_comes_back_from_a_file(tmp_path: Path) -> None:
    found = device(**BEYOND)
    assert found.damping_by_direction is not None
    assert found.damping_by_direction.backward == quantity(12.0, 11.0, 13.0)
    assert found.friction_by_direction is not None
    assert found.friction_by_direction.forward == quantity(0.5)
    assert found.position_stiffness == quantity(-3.0, -4.0, -2.0)
    assert found.gravity is not None
    assert found.gravity.cosine == quantity(0.1, -0.1, 0.3)
    assert read_again(found, tmp_path) == found


def test_what_no_log_told_is_not_written() -> None:
    assert not BEYOND.keys() & to_mapping(device()).keys()
    assert not BEYOND.keys() & to_mapping(load_device("emps")).keys()


MODE = {"frequency_hz": {"value": 80.0, "low": 75.0, "high": 85.0}, "damping_ratio": 0.02}


def test_modes_and_lag_survive_the_file(tmp_path: Path) -> None:
    found = device(modes=[{**MODE, "at_encoder": 0.5}], current_lag=0.0004)
    assert read_again(found, tmp_path) == found
    assert found.modes[0].at_handle == 0.5
    assert found.modes[0].frequency_hz.low == 75.0


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ({**MODE, "at_encoder": 1.0, "damping_ratio": 1.0}, "must be below 1"),
        ({**MODE, "at_encoder": 1.0, "frequency_hz": -5.0}, "greater than 0"),
        (MODE, "at_encoder: is missing"),
        ({**MODE, "at_encoder": 1.0, "frequency": 3.0}, "did you mean frequency_hz?"),
    ],
)
def test_impossible_modes_are_refused(mode: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words.replace("?", r"\?")):
        parse_document(Hardware, {"modes": [mode]}, "hardware.yaml")


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"encoder": 6e-6}, "did you mean encoder_resolution?"),
        ({"delay": [0.0005, 0.0015]}, "delay: give a number or {value: …, low: …, high: …}"),
        ({"force_limit": 14}, "give a mapping of keys: continuous, peak (seen: 14)"),
        ({"force_limit": {"continuous": [6, 3], "peak": 9}}, "axes: the coarsest count, the small"),
        ({"encoder_resolution": [1e-5, 2e-5]}, "encoder_resolution: give one for all axes"),
    ],
)
def test_a_wrong_fact_is_told_what_it_is_to_be(facts: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInputError, match=re.escape(words)):
        parse_document(Hardware, facts, "hardware.yaml")


def test_more_modes_than_can_be_judged_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="modes"):
        parse_document(Hardware, {"modes": [{**MODE, "at_encoder": 1.0}] * 5}, "hardware.yaml")


LOG: dict[str, Any] = {
    "source": "log.csv",
    "digest": "sha256:0",
    "samples": 5000,
    "method": "output-error",
}
KNOWN: dict[str, Any] = BARE | {
    "mass": {"value": 3.0, "low": 2.98, "high": 3.02},
    "damping": {"value": 10.0, "low": 9.6, "high": 10.4},
    "force_limit": {"continuous": 14.0, "peak": 28.0},
    "logs": [LOG],
}


def _joint(*matrix: list[float], freedom: float = 59.0) -> dict[str, Any]:
    parameters = ["mass", "damping", "coulomb_friction"][: len(matrix)]
    return {"parameters": parameters, "matrix": list(matrix), "degrees_of_freedom": freedom}


GOOD = _joint([1e-4, -1e-3], [-1e-3, 4e-2])
#: what is wrong, and both numbers as they are told
CONTRADICTIONS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "not positive definite": (
        {"covariance": _joint([1e-4, -3e-3], [-3e-3, 4e-2])},
        ("eigenvalue of its correlations is -0.5", "needed is 0 or more"),
    ),
    "negative variance": ({"covariance": _joint([-1.0])}, ("negative variance, -1",)),
    "not symmetric": (
        {"covariance": _joint([1e-4, -1e-3], [1e-3, 4e-2])},
        ("-0.001 in row 1, column 2", "0.001 the other way round"),
    ),
    "too few rows": ({"covariance": GOOD | {"matrix": [[1e-4]]}}, ("1 x 1 for 2 parameters",)),
    "uneven rows": (
        {"covariance": GOOD | {"matrix": [[1e-4], [0.0, 4e-2]]}},
        ("2 x 1 or 2 for 2 parameters",),
    ),
    "one parameter twice": (
        {"covariance": GOOD | {"parameters": ["mass", "mass"]}},
        ("2 x 2 for 1 parameters, mass, mass",),
    ),
    "an interval much narrower": (
        {"covariance": GOOD, "mass": {"value": 3.0, "low": 2.9999, "high": 3.0001}},
        ("mass is known within ±0.0001", "by its covariance within ±0.0196"),
    ),
    "an interval much wider": (
        {"covariance": GOOD, "damping": {"value": 10.0, "low": -90.0, "high": 110.0}},
        ("damping is known within ±100", "by its covariance within ±0.392"),
    ),
    "an exact number with a variance": (
        {"covariance": GOOD, "mass": 3.0},
        ("mass is known within ±0,", "±0.0196"),
    ),
    "a huge covariance": (
        {"covariance": _joint([1e-4, 1e306], [1e306, 4e-2])},
        ("eigenvalue of its correlations is -1",),
    ),
    "a parameter of another name": (
        {"covariance": GOOD | {"parameters": ["Mass", "damping"]}},
        ("covariance names 'Mass', which is no quantity of this device",),
    ),
    "an end of an interval that is lost": (
        {"mass": {"value": 3.0, "high": 3.02}},
        ("mass: has high alone; an interval needs low and high",),
    ),
    "degrees of freedom": (
        {"covariance": GOOD | {"degrees_of_freedom": 6000.0}},
        ("6000 degrees_of_freedom", "5000 samples"),
    ),
    "degrees of freedom of the shorter log": (
        {"covariance": GOOD, "logs": [LOG, LOG | {"samples": 40}]},
        ("59 degrees_of_freedom", "40 samples"),
    ),
    "a refusal that was not allowed": (
        {"logs": [LOG | {"findings": ["jitter", "sign-flip"]}]},
        ("sign-flip refuses a log; allowed is nothing",),
    ),
    "an offset beyond the actuator": (
        {"force_offset": -30.0},
        ("force_offset is -30", "the peak 28 of force_limit"),
    ),
    "a count of nothing": (
        {"encoder_resolution": 1e-300},
        ("encoder_resolution: must be 1e-15 or more", "not 1e-300"),
    ),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_a_contradiction_is_refused_with_both_numbers(name: str) -> None:
    changes, numbers = CONTRADICTIONS[name]
    with pytest.raises(InvalidInputError) as refused:
        parse_document(Device, KNOWN | changes, "device.yaml")
    for each in numbers:
        assert each in str(refused.value)


def test_what_agrees_is_read() -> None:
    found = {"findings": ["jitter", "sign-flip"], "allowed": ["sign-flip"]}
    agreeing = {"covariance": GOOD, "force_offset": 27.0, "logs": [LOG | found]}
    assert parse_document(Device, KNOWN | agreeing, "device.yaml").covariance is not None
    # What a log suggests of the actuator is a hint, and no limit.
    hint = {"continuous": 1.0, "peak": 1.0, "source": "log"}
    parse_document(Device, KNOWN | {"force_offset": 27.0, "force_limit": hint}, "device.yaml")


@pytest.mark.parametrize("freedom", [12.0, 59.0, 1e9])
def test_the_box_holds_both_at_once_999_times_in_1000(freedom: float) -> None:
    """Draws from the joint distribution itself: the box is at least as sure as it says."""
    from scipy.stats import t

    generator = np.random.default_rng(0)
    normal = generator.multivariate_normal(np.zeros(2), np.array(GOOD["matrix"]), 400_000)
    draws = normal / np.sqrt(generator.chisquare(freedom, (400_000, 1)) / freedom)
    half = t.ppf(0.975, freedom) * np.array([0.01, 0.2])
    found = device(
        mass={"value": 3.0, "low": 3.0 - half[0], "high": 3.0 + half[0]},
        damping={"value": 10.0, "low": 10.0 - half[1], "high": 10.0 + half[1]},
        covariance=GOOD | {"degrees_of_freedom": freedom},
    )
    box = found.simultaneous_box()
    # The truth lies at the estimate less the error.
    mass, damping = 3.0 - draws[:, 0], 10.0 - draws[:, 1]
    inside = (box.mass[0] <= mass) & (mass <= box.mass[1])
    inside &= (box.damping[0] <= damping) & (damping <= box.damping[1])
    assert inside.mean() >= 0.999 - 3 * np.sqrt(0.001 / draws.shape[0])


def test_the_box_spans_both_directions() -> None:
    """Half-widths times sqrt(χ²(0.999, k))/1.96; χ² of 6 quantities from printed tables: 22.458."""
    ranged = {
        "mass": {"value": 3.0, "low": 2.9, "high": 3.1},
        "damping": {"value": 10.0, "low": 9.8, "high": 10.2},
        "coulomb_friction": {"value": 0.8, "low": 0.7, "high": 0.9},
        "force_offset": {"value": 0.0, "low": -0.1, "high": 0.1},
        "damping_by_direction": BEYOND["damping_by_direction"],
    }
    factor = np.sqrt(22.458) / 1.96
    box = device(**ranged).simultaneous_box()
    assert box.damping == pytest.approx((9.0 - 0.5 * factor, 12.0 + 1.0 * factor), rel=1e-4)
    wide = {"value": 10.0, "low": 0.0, "high": 20.0}
    hull = device(**ranged | {"damping": wide}).simultaneous_box()
    assert hull.damping == pytest.approx((10.0 - 10 * factor, 10.0 + 10 * factor), rel=1e-4)


def test_too_few_degrees_of_freedom_say_so() -> None:
    with pytest.raises(InvalidInputError, match="degrees_of_freedom"):
        device(
            mass=KNOWN["mass"],
            damping=KNOWN["damping"],
            covariance=GOOD | {"degrees_of_freedom": 2.0},
        ).simultaneous_box()
