"""What the commands rehearse of a profile: every moment as it is played, on devices it may be."""

from __future__ import annotations

from typing import Any
from unittest import mock

import numpy as np
import pytest

from datasets_synthetic import Controller, Rehearsal, Rig
from identification import SlopeRange, quantity
from tests.exported import tuned
from tune import SafeProfile
from tune.cli.rehearse import refuse_restless


def rehearsed(profile: SafeProfile) -> tuple[Rig, Controller, dict[str, Any]]:
    """What the simulator is asked to play."""
    settled = Rehearsal(trials=())
    with mock.patch(
        "datasets_synthetic.rehearse", side_effect=lambda _, law, **__: [settled] * law.size()
    ) as played:
        refuse_restless(profile, lambda _: None)
    played.assert_called_once()
    return *played.call_args.args, dict(played.call_args.kwargs)


def profile_with(**device: Any) -> SafeProfile:
    """Wall, cup and rubber, the wall one-sided, on HomeRehab with these facts."""
    elements = dict(tuned().elements)
    elements["wall"] = elements["wall"].model_copy(update={"one_sided": True})
    changed = tuned().device.model_copy(update=device)
    return tuned().model_copy(update={"elements": elements, "device": changed})


def test_every_moment_is_played_with_its_walls_and_its_fades() -> None:
    """Wall, cup, rubber, and the wall with each of them."""
    profile = profile_with()
    names = [set(moment) for moment in profile.moments()]
    _, law, _ = rehearsed(profile)
    size = {name: element.stiffness for name, element in profile.elements.items()}
    cup, fade = profile.elements["cup"].mass, profile.elements["cup"].fade_time
    assert fade >= 0.1
    assert law.size() == len(names)
    wall, spring, fading = law.beside
    assert [each.one_sided for each in law.beside] == [True, False, False]
    there = {each: np.array([each in moment for moment in names]) for each in size}
    for element, name, wanted in (
        (wall, "stiffness", size["wall"] * there["wall"]),
        (spring, "stiffness", size["rubber"] * there["rubber"]),
        (fading, "mass", cup * there["cup"]),
        (fading, "fade_time", fade * there["cup"]),
    ):
        np.testing.assert_array_equal(getattr(element, name), wanted)


def test_corners_of_the_box_are_played_with_the_extra_delay() -> None:
    profile = profile_with()
    box = profile.device.simultaneous_box()
    rig, _, options = rehearsed(profile)
    assert (rig.mass[0], rig.damping[0], rig.delay[0]) == (3.0, 10.0, 0.001)
    corners = [(each.mass[0], each.damping[0], each.delay[0]) for each in options["others"]]
    late = pytest.approx(0.002)
    (light, heavy), (least, most) = box.mass, box.damping
    assert corners == [(light, least, late), (heavy, least, late), (light, most, late)]


def test_slopes_of_friction_and_its_stiffness_are_among_the_devices_played() -> None:
    profile = profile_with(
        damping_slope=SlopeRange(low=4.0, high=30.0),
        presliding_stiffness=SlopeRange(low=10.0, high=200.0),
        damping=quantity(10.0),
    )
    _, _, options = rehearsed(profile)
    assert [each.damping[0] for each in options["others"]] == [4.0, 4.0, 30.0, 10.0]
    assert [each.stiffness[0] for each in options["others"]] == [0, 0, 0, 200.0]


def test_what_no_moment_has_is_not_played() -> None:
    wall = tuned().elements["wall"]
    _, law, _ = rehearsed(tuned().model_copy(update={"elements": {"wall": wall}, "together": ()}))
    assert len(law.beside) == 1
