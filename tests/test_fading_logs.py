"""Logs of an element that fades in, of which only what comes after the fade tells the law."""

from dataclasses import replace

import numpy as np
import pytest

from identification import Trajectory
from tests.test_verify import AXIS, T, verdicts
from tune import verify
from tune.documents.profile import Design

FADE = 0.1


def _profile(fade_time: float = FADE) -> Design:
    """Whose cup fades."""
    elements = AXIS.profile.elements
    cup = elements["cup"].model_copy(update={"fade_time": fade_time})
    return AXIS.profile.model_copy(update={"elements": {**elements, "cup": cup}})


def _faded(log: Trajectory, pause: float = 0.0) -> Trajectory:
    """The log, after half a second of rest, with a force that fades in, and away for so long, s."""
    rest = np.full(500, log.position[0])
    position, force = np.append(rest, log.position), np.append(0.0 * rest, log.force)
    time = np.arange(position.size) * T
    level = np.clip((time - 0.5) / FADE, 0.0, 1.0)
    if pause:
        level *= np.clip((np.abs(time - 1.0) - 0.5 * pause) / FADE, 0.0, 1.0)
    return replace(log, time=time, position=position, force=level * force)


@pytest.mark.parametrize("pause", [0.0, 0.2])
@pytest.mark.parametrize("element", ["cup", None])
def test_the_law_of_an_element_that_fades_in_is_judged_after_its_fade(
    element: str | None, pause: float
) -> None:
    seen = verify(_profile(), _faded(AXIS.log("cup", 0.5), pause), element=element)
    assert (verdicts(seen)["law"], verdicts(seen)["gain"]) == ("agrees", "agrees")
    assert seen.gain == pytest.approx(0.5, rel=1e-3)
    assert verdicts(verify(AXIS.profile, _faded(AXIS.log("cup", 0.5))))["law"] == "disagrees"


def test_a_wrong_law_is_still_found_after_a_fade_and_no_law_within_one() -> None:
    wrong = _faded(AXIS.log("cup", 0.5, velocity_filter_hz=20.0))
    (law,) = verify(_profile(), wrong).disagreements
    assert law.check == "law"
    assert "20 Hz" in law.seen
    short = verify(_profile(fade_time=2.0), wrong, element="cup")
    assert verdicts(short)["law"] == "not assessed"
