"""Designs that are certified, refused or forged."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from identification import load_device, to_mapping, to_yaml
from tests.commands import digest_of
from tests.random_boxes import safe_gain as limit_of_corners
from tune import SafeProfile, Scene, optimise
from tune.certificate.certify import NO_HAND, WITH_HAND, certify
from tune.certificate.check import check
from tune.certificate.poles import judge
from tune.certificate.region import Point, regions_of, setting_of
from tune.documents import CheckFailedError
from tune.documents.profile import Design


def _design(**changes: object) -> Design:
    """A tuned scene on the homerehab, changed by hand before it is certified.

    The depth of the wall is stated, so that its force is not cut and no multiplier is asked for.
    """
    wall = {"stiffness": 1500.0, "damping": 20.0, "penetration": 0.01}
    profile = optimise(
        load_device("homerehab"),
        Scene.model_validate({"elements": {"wall": wall, "cup": {"mass": 1.0}}}),
    )
    content = to_mapping(profile)
    for key in ("certificate", "digest"):
        content.pop(key)
    for element in content["elements"].values():
        element["margins"] |= {"gain": 2.0, "extra_delay_samples": 1.0}
        element |= {"ripple": 1.0, "rendered": None, "perceived_steps": {}}
    content["ripple_limit"] = 1.0
    content["device"] |= changes.pop("device", {})  # type: ignore[operator]
    return Design.model_validate(content | changes)


HAND = {
    "mass": {"value": 0.1, "low": 0.02, "high": 0.5},
    "damping": {"value": 5.0, "low": 2.0, "high": 20.0},
    "stiffness": {"value": 300.0, "low": 50.0, "high": 1500.0},
}
MODE = {
    "frequency_hz": {"value": 60.0, "low": 57.0, "high": 63.0},
    "damping_ratio": {"value": 0.05, "low": 0.04, "high": 0.06},
    "at_encoder": 0.3,
    "at_handle": -0.3,
}


def test_hand_mode_lag_and_part_of_a_sample_are_certified_and_said() -> None:
    design = _design(
        hand=HAND,
        device={
            "modes": [MODE],
            "current_lag": {"value": 2e-4, "low": 1e-4, "high": 3e-4},
            "delay": {"value": 1e-3, "low": 8e-4, "high": 1.2e-3},
        },
    )
    certificate = certify(design)
    assert set(certificate.interior) == {"wall", "cup"}
    assert certificate.hand is not None
    assert certificate.hand.stiffness == (50.0, 1500.0)
    assert certificate.modes[0].frequency_hz == (57.0, 63.0)
    assert certificate.current_lag == (1e-4, 3e-4)
    assert certificate.delay_samples == (0.8, 1.2)
    assert WITH_HAND in certificate.assumes
    assert NO_HAND not in certificate.assumes
    place = certificate.worst
    assert 0.8 - 1e-9 <= place.delay_samples <= 2.2 + 1e-9
    assert len(place.modes) == 1


def test_what_is_not_proved_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    """A claim a part in 10⁴ below the limit: true, but a hundred cells are too few to prove it."""
    design = _design()
    setting = setting_of(design, ("wall",))
    assert setting is not None
    limit = limit_of_corners(regions_of(design)[0], setting, extra=0.0)
    content = to_mapping(design)
    content["elements"]["wall"]["margins"]["gain"] = limit * (1 - 1e-4)
    edge = Design.model_validate(content)
    assert certify(edge).interior == {"wall": "proved", "cup": "proved"}
    monkeypatch.setattr("tune.certificate.certify.MOST_CELLS", 100)
    with pytest.raises(CheckFailedError, match="wall: not proved for every device") as failed:
        certify(edge)
    assert any("worst is a pole radius of 0.99" in words for words in failed.value.failures)


def test_a_hand_that_destabilises_is_named() -> None:
    design = _design(hand=HAND | {"damping": {"value": 0.1, "low": 0.0, "high": 0.2}})
    content = to_mapping(design)
    content["elements"]["cup"]["mass"] = -1.49
    with pytest.raises(CheckFailedError, match="cup in a hand: margin: unstable at mass"):
        certify(Design.model_validate(content))


@cache
def _wall_and_water() -> SafeProfile:
    scene = {"elements": {"wall": {"stiffness": 1500.0}, "water": {"damping": 20.0}}}
    return optimise(load_device("homerehab"), Scene.model_validate(scene))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mass": 2.0}, "certificate.worst is not a point of the box"),
        ({"delay_samples": 1.0}, "certificate.worst.pole_radius says"),
        ({"elements": ["cup"]}, "certificate.worst names cup, which is not felt"),
        ({"hand": {"mass": 0.1, "damping": 5.0, "stiffness": 300.0}}, "not a point of the box"),
        # A harmless point and its true radius: a worse one is there to be found.
        ({"elements": ["water"]}, "a worse one was found"),
    ],
)
def test_a_forged_worst_point_is_found_out(
    tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    profile = _wall_and_water()
    assert profile.certificate.worst.elements == ("wall",)
    content = to_mapping(profile)
    worst = content["certificate"]["worst"]
    worst |= changes
    if words.startswith("a worse"):
        setting = setting_of(profile, ("water",))
        assert setting is not None
        point = Point(
            **{key: worst[key] for key in ("mass", "damping", "sample_time", "delay_samples")}
        )
        worst["pole_radius"] = judge(point, setting, worst["gain"]).radius
    content["digest"] = digest_of(content)
    path = tmp_path / "profile.yaml"
    path.write_text(to_yaml(content), encoding="utf-8")
    with pytest.raises(CheckFailedError, match=words):
        check(path)
