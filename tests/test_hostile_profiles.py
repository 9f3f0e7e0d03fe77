"""Profiles of numbers no device has, signed anew: ``haptune check`` refuses them in a sentence."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import pytest

from identification import load_device, load_mapping, to_mapping, to_yaml
from tests.commands import digest_of, haptune
from tests.thinned import thinned
from tune import Scene, optimise

SCENE: dict[str, Any] = {
    "elements": {"wall": {"stiffness": 500.0, "damping": 10.0}},
    "loop": {"velocity_filter_hz": 50.0},
}


@functools.cache
def _profile() -> str:
    profile = optimise(load_device("homerehab"), Scene.model_validate(SCENE))
    return to_yaml(to_mapping(profile))


def _forged(place: str, value: float, folder: Path) -> Path:
    """The profile with one number changed and its digest made to fit."""
    path = folder / "profile.yaml"
    path.write_text(_profile(), encoding="utf-8")
    content = load_mapping(path)
    *inner, last = place.split(".")
    part: Any = content
    for key in inner:
        part = part[key]
    assert last in part
    part[last] = value
    content["digest"] = digest_of(content)
    path.write_text(to_yaml(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("place", "value"),
    thinned(
        [
            ("elements.wall.motion.penetration", 0.0),
            ("margin.gain", 1e300),
            ("margin.gain", 1.7e308),
            ("loop.velocity_filter_hz", 1e-300),
            ("loop.velocity_filter_hz", 0.0),
            ("elements.wall.stiffness", 1e308),
            ("elements.wall.stiffness", 5e-324),
            ("elements.wall.damping", -1e308),
            ("elements.wall.mass", 1e300),
            ("elements.wall.margins.gain", 1.7e308),
            ("perception.damping", 5e-324),
        ],
        6,
    ),
)
def test_a_number_no_device_has_is_refused_in_a_sentence(
    tmp_path: Path, place: str, value: float
) -> None:
    ended = haptune("check", str(_forged(place, value, tmp_path)))
    assert ended.code in {3, 6}, ended.err
    assert ended.err.startswith("haptune check: ")
