"""A device that contradicts itself is refused with both numbers; what identify writes does not."""

from __future__ import annotations

from typing import Any

import pytest

from identification import InvalidInputError, parse_document
from identification.device.device import Device
from tests.bare_device import BARE

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
