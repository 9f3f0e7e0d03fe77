"""Quantities, hardware and devices: what they refuse, what they keep, and the simultaneous box.

One file: the keys of one file, each with what it refuses.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.special import chdtri, fdtri

from identification import (
    Covariance,
    Device,
    ForceLimit,
    Hardware,
    InvalidInputError,
    Quantity,
    load_device,
    load_document,
    named_devices,
    parse_document,
    quantity,
    to_mapping,
    to_yaml,
)
from identification.device.box import widening
from identification.estimators.intervals import NORMAL_95

BARE: dict[str, Any] = {"sample_time": 1e-3, "mass": 3.0, "damping": 10.0, "delay": 1e-3}


def device(**changes: Any) -> Device:
    return Device.model_validate(BARE | changes)


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


def test_an_unknown_device_is_told_what_there_is() -> None:
    with pytest.raises(InvalidInputError, match="homerehab"):
        load_device("homerehap")
    with pytest.raises(InvalidInputError, match="No such file"):
        load_device("nothing.yaml")


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


def joint(freedom: float) -> Covariance:
    matrix = np.array([[0.01**2, -0.5 * 0.01 * 0.2], [-0.5 * 0.01 * 0.2, 0.2**2]])
    return Covariance(
        parameters=("mass", "damping"),
        matrix=tuple(tuple(row) for row in matrix.tolist()),
        degrees_of_freedom=freedom,
    )


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


@pytest.mark.parametrize("freedom", [12.0, 59.0, 1e9])
def test_the_box_holds_both_at_once_999_times_in_1000(freedom: float) -> None:
    """Draws from the joint distribution itself: the box is at least as sure as it says."""
    from scipy.stats import t

    generator = np.random.default_rng(0)
    covariance = joint(freedom)
    normal = generator.multivariate_normal(np.zeros(2), np.array(covariance.matrix), 400_000)
    draws = normal / np.sqrt(generator.chisquare(freedom, (400_000, 1)) / freedom)
    half = t.ppf(0.975, freedom) * np.array([0.01, 0.2])
    found = device(
        mass={"value": 3.0, "low": 3.0 - half[0], "high": 3.0 + half[0]},
        damping={"value": 10.0, "low": 10.0 - half[1], "high": 10.0 + half[1]},
        covariance=covariance.model_dump(),
    )
    box = found.simultaneous_box()
    # The truth lies at the estimate less the error.
    mass, damping = 3.0 - draws[:, 0], 10.0 - draws[:, 1]
    inside = (box.mass[0] <= mass) & (mass <= box.mass[1])
    inside &= (box.damping[0] <= damping) & (damping <= box.damping[1])
    assert inside.mean() >= 0.999 - 3 * np.sqrt(0.001 / draws.shape[0])


def test_the_box_of_exact_numbers_is_a_point() -> None:
    box = device().simultaneous_box()
    assert box.mass == (3.0, 3.0)
    assert box.damping == (10.0, 10.0)


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


@pytest.mark.parametrize("key", BEYOND)
def test_every_uncertain_quantity_widens_the_box(key: str) -> None:
    """All of them are to lie inside at once, so one more makes each interval wider."""
    known = {
        "mass": {"value": 3.0, "low": 2.9, "high": 3.1},
        "damping": {"value": 10.0, "low": 0.0, "high": 20.0},
    }
    before = device(**known).simultaneous_box()
    after = device(**known, **{key: BEYOND[key]}).simultaneous_box()
    # One uncertain number more is three instead of two: printed χ² 16.266 against 13.816.
    expected = {"damping_by_direction": 18.467}.get(key, 16.266)
    ratio = (after.damping[1] - 10.0) / (before.damping[1] - 10.0)
    assert ratio == pytest.approx(np.sqrt(expected / 13.816), rel=1e-4)
    assert after.mass[1] > before.mass[1]


def test_the_box_keeps_mass_positive_and_takes_times_as_stated() -> None:
    wide: Quantity = quantity(1.0, 0.3, 3.0)
    box = device(mass=wide, delay=quantity(1e-3, 0.5e-3, 2e-3)).simultaneous_box()
    assert 0 < box.mass[0] < 0.3
    assert box.mass[1] > 3.0
    assert box.delay == (0.5e-3, 2e-3)
    assert box.sample_time == (1e-3, 1e-3)


def test_too_few_degrees_of_freedom_say_so() -> None:
    with pytest.raises(InvalidInputError, match="degrees_of_freedom"):
        device(covariance=joint(2.0).model_dump()).simultaneous_box()


@pytest.mark.parametrize("freedom", [4.0, 7.5, 60.0, 7990.0, np.inf])
def test_the_box_widens_by_hotellings_quantile(freedom: float) -> None:
    """The tail beyond the radius found, by many digits of the incomplete functions."""
    radius = (widening(3, freedom, 0.999) * NORMAL_95) ** 2
    with mpmath.workdps(30):
        if np.isinf(freedom):
            tail = mpmath.gammainc(1.5, radius / 2, regularized=True)
        else:
            ratio = radius / freedom  # count·F/(freedom - count + 1)
            rest = (freedom - 2) / 2
            tail = mpmath.betainc(rest, 1.5, 0, 1 / (1 + mpmath.mpf(ratio)), regularized=True)
        assert float(tail) == pytest.approx(1e-3, rel=1e-11)


@pytest.mark.parametrize("count", [2, 3, 5, 8])
@pytest.mark.parametrize("freedom", [8.01, 9.3, 59.0, 1e4, 9e5, 2e6, np.inf])
def test_the_box_widens_by_quantiles_of_hotelling(count: int, freedom: float) -> None:
    """As scipy.special has those of F and χ²."""
    squares = {
        confidence: chdtri(count, 1 - confidence)
        if freedom > 1e6
        else count * freedom / (freedom - count + 1) * fdtri(count, freedom - count + 1, confidence)
        for confidence in (0.9, 0.999)
    }
    for confidence, square in squares.items():
        found = widening(count, freedom, confidence) * NORMAL_95
        assert found == pytest.approx(np.sqrt(square), rel=1e-12)


@pytest.mark.parametrize("freedom", [2.0, 1.0, np.nan])
def test_too_few_degrees_of_freedom_have_no_box(freedom: float) -> None:
    with pytest.raises(InvalidInputError, match="for 2 parameters"):
        widening(2, freedom, 0.999)
