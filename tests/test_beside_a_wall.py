"""What is felt beside a wall acts alone outside of it, and the law of both is judged."""

from typing import Any

import numpy as np
import pytest

from datasets_synthetic import VirtualElement
from identification import Trajectory
from tests.test_verify import STYLUS, T, said, verdicts
from tune import Verification, verify

#: Force at which the wall yields, N; its face, m, and the side to which it pushes.
LEVEL, ABOVE, BELOW = 1.0, (0.034, -1), (0.026, 1)
K, B, _ = STYLUS.elements["wall"]
ELEMENTS = STYLUS.profile.elements
WALL = ELEMENTS["wall"].model_copy(update={"one_sided": True, "force_level": LEVEL})
PROFILE = STYLUS.profile.model_copy(update={"elements": {**ELEMENTS, "wall": WALL}})
SWINGS = np.sin(2 * np.pi * 2 * T * np.arange(1500))


def _log(
    at: tuple[float, int], gain: float, push: float, part: float = 1.0, **law: Any
) -> Trajectory:
    """A hand moves the handle in gel into a wall and out of it; the wall at a part of the gain."""
    face, side = at
    mine = gain * part
    wall = VirtualElement(
        stiffness=mine * K, damping=mine * B, side=side, place=face, level=mine * LEVEL
    )
    run = {"push": push * SWINGS}
    return STYLUS.log("gel", gain, beside=(wall,), place=STYLUS.start, run=run, **law)


def _seen(log: Trajectory, **stated: Any) -> Verification:
    seen = verify(PROFILE, log, **stated)
    assert seen.elements == ("wall", "gel")
    return seen


@pytest.mark.parametrize(
    ("at", "gain", "push", "element"),
    [
        (ABOVE, 0.2, 0.3, "wall+gel"),
        (BELOW, 0.2, 0.3, None),
        (ABOVE, 0.5, 1.0, None),
        (BELOW, 0.5, 1.0, "wall+gel"),
        (ABOVE, 0.5, 2.0, "wall+gel"),
        (BELOW, 0.5, 2.0, None),
    ],
)
def test_a_wall_beside_gel_agrees(
    at: tuple[float, int], gain: float, push: float, element: str | None
) -> None:
    seen = _seen(_log(at, gain, push), element=element)
    assert (verdicts(seen)["law"], verdicts(seen)["gain"]) == ("agrees", "agrees")
    assert seen.gain == pytest.approx(gain, rel=1e-6)
    assert "leaves a one-sided wall" in said(seen, "decay")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"velocity_filter_hz": 30.0}, "velocity is filtered at 30 Hz"),
        ({"velocity_filter_hz": np.inf}, "velocity is not filtered"),
        ({"damping": 3.0}, "law disagrees"),
        ({"part": 0.8}, "law disagrees"),
    ],
)
def test_a_wrong_law_beside_a_wall_is_named(changed: dict[str, Any], words: str) -> None:
    assert words in said(_seen(_log(ABOVE, 0.5, 1.0, **changed)), "law")


def test_a_shifted_force_or_another_gain_beside_a_wall_is_named() -> None:
    log = _log(ABOVE, 0.5, 1.0)
    assert "gain disagrees: 0.5 of wall+gel" in said(_seen(log, gain=0.4), "gain")
    late = Trajectory(time=log.time, force=np.roll(log.force, 1), position=log.position)
    assert "the force column is 1 row(s) late" in said(_seen(late), "law")


def test_a_wall_that_is_not_met_is_not_told_to_agree() -> None:
    log = _log((0.06, -1), 0.5, 1.0)
    assert verify(PROFILE, log).elements == ("gel",)
    assert verdicts(verify(PROFILE, log, element="wall+gel"))["law"] == "disagrees"
