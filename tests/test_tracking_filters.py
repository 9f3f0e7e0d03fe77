"""Tracking filters against the observer they are, and what they make of a wall."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from identification import load_device
from tests.felt import Observer
from tests.guard import InPython, built, enter, push
from tests.test_verify import AXIS, Bench, verdicts
from tune import SafeProfile, Scene, check, export, optimise, verify
from tune.documents.profile import LoopProfile
from tune.documents.scene import LoopFreedom

TRACKING: dict[str, Any] = {
    "velocity_filter": "tracking",
    "velocity_filter_hz": 45.0,
    "acceleration_filter": "tracking",
    "acceleration_filter_hz": 36.0,
}


def tuned(
    element: dict[str, Any], *, ripple_limit: float | None = None, **loop: Any
) -> SafeProfile:
    scene = {"elements": {"a": element}, "loop": loop, "ripple_limit": ripple_limit}
    return optimise(load_device("homerehab"), Scene.model_validate(scene)).signed()


@pytest.mark.parametrize(("velocity", "acceleration", "ratio"), [(2, 3, 1.0), (3, 4, 0.5)])
def test_the_guard_plays_the_observer_to_the_last_digits(
    velocity: int, acceleration: int, ratio: float, tmp_path: Path
) -> None:
    profile = tuned(
        {"damping": 30.0, "mass": 0.8, "fade_time": 0.1},
        ripple_limit=5.0,
        velocity_filter_hz=120.0,
        acceleration_filter_hz=80.0,
        velocity_filter="tracking",
        acceleration_filter="tracking",
        velocity_filter_order=velocity,
        acceleration_filter_order=acceleration,
        filter_damping_ratio=ratio,
    )
    played = profile.elements["a"]
    assert played.damping > 20
    assert played.mass > 0.7
    rng = np.random.default_rng(3)
    readings = np.cumsum(np.cumsum(rng.normal(scale=1e-8, size=2000)))
    law = played.damping * Observer(velocity, 120.0, ratio).play(readings, 1)
    law += played.mass * Observer(acceleration, 80.0, ratio).play(readings, 2)
    for player in (built(export(profile, "c"), tmp_path), InPython(profile)):
        player.start()
        calls = [enter(1, 0.0), *(push(1, k + 1, y) for k, y in enumerate(readings.tolist()))]
        forces = np.array([reply.force for reply in player.run(calls)[1:]])
        assert np.max(np.abs(forces + law)[150:]) <= 1e-12 * np.max(np.abs(law))


def test_verify_knows_the_tracking_law_by_a_simulation_of_the_observer() -> None:
    filters: dict[str, Any] = {
        "velocity_filter": "tracking",
        "velocity_filter_order": 3,
        "acceleration_filter": "tracking",
        "acceleration_filter_order": 4,
        "filter_damping_ratio": 0.5,
    }
    bench = Bench(
        **AXIS.truth,
        start=0.02,
        elements={"cup": (1000.0, 10.0, 0.5)},
        velocity_filter_hz=50.0,
        acceleration_filter_hz=40.0,
        loop=filters,
    )
    right = verdicts(verify(bench.profile, bench.log("cup", 0.8, **filters)))
    assert right["law"] == "agrees"
    assert "disagrees" not in right.values()
    wrong = filters | {"acceleration_filter": "low-pass", "acceleration_filter_order": 2}
    assert verdicts(verify(bench.profile, bench.log("cup", 0.8, **wrong)))["law"] == "disagrees"


@pytest.mark.parametrize(
    ("loop", "words"),
    [
        ({"velocity_filter": "tracking", "velocity_filter_order": 1}, "2 or 3"),
        ({"acceleration_filter": "tracking", "acceleration_filter_order": 2}, "3 or 4"),
        ({"acceleration_filter_order": 3}, "1 or 2"),
        ({"acceleration_filter": "kalman"}, "low-pass, tracking or free"),
        ({"velocity_filter": "tracking", "velocity_window_samples": 5}, "takes the place"),
    ],
)
def test_filters_that_do_not_exist_are_refused_in_words(loop: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        LoopFreedom.model_validate(loop)


def test_a_wall_that_tracks_its_speed_is_a_fifth_stiffer_and_stands_in_every_check(
    tmp_path: Path,
) -> None:
    """Three states with poles that ring; the certificate proves it over the box by itself."""
    wall = {"stiffness": "max", "damping": "max", "one_sided": True}
    plain = tuned(wall, velocity_filter="low-pass")
    tracks = tuned(wall, velocity_filter="tracking", filter_damping_ratio=0.5)
    free = tuned(wall)
    assert tracks.elements["a"].stiffness >= 1.2 * plain.elements["a"].stiffness
    assert free.elements["a"].stiffness >= 0.98 * tracks.elements["a"].stiffness
    path = tmp_path / "profile.yaml"
    path.write_text(tracks.to_yaml(), encoding="utf-8")
    check(path)


def test_without_a_kind_filters_are_low_passes_in_scenes_and_in_old_profiles() -> None:
    assert LoopFreedom().kind("velocity") == ("low-pass", 1)
    assert LoopFreedom(acceleration_filter="tracking").kind("acceleration") == ("tracking", 4)
    old = {"sample_time": 0.001, "extra_delay_samples": 1.0, "velocity_filter_hz": 50.0}
    assert LoopProfile.model_validate(old).velocity_filter == "low-pass"
