"""Modes, current lag and hand in the files: what is said is carried, what cannot be is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from identification import (
    Device,
    Hardware,
    InvalidInputError,
    load_document,
    parse_document,
    to_mapping,
    to_yaml,
)

MODE = {"frequency_hz": {"value": 80.0, "low": 75.0, "high": 85.0}, "damping_ratio": 0.02}
DEVICE = {"sample_time": 0.001, "mass": 3.0, "damping": 10.0}


def test_modes_and_lag_survive_the_file(tmp_path: Path) -> None:
    stated = {**DEVICE, "modes": [{**MODE, "at_encoder": 0.5}], "current_lag": 0.0004}
    device = parse_document(Device, stated, "device.yaml")
    path = tmp_path / "device.yaml"
    path.write_text(to_yaml(to_mapping(device)), encoding="utf-8")
    assert load_document(Device, path) == device
    assert device.modes[0].at_handle == 0.5
    assert device.modes[0].frequency_hz.low == 75.0


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


def test_more_modes_than_can_be_judged_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="modes"):
        parse_document(Hardware, {"modes": [{**MODE, "at_encoder": 1.0}] * 5}, "hardware.yaml")
