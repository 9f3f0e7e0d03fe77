"""Fades: a mass that comes and goes beside a spring is a pump if it does so too fast."""

from __future__ import annotations

import numpy as np
import pytest

from identification import InvalidInputError, load_device
from tests.test_jitter import one_step
from tune import Scene, optimise

#: N/m and kg behind 5 Hz on HomeRehab, where they still have the margin's gain of two.
SOFT, HEAVY = 238.0, 5.17
LEVELS = np.linspace(0, 1, 33)


def _tuned(**fade: float) -> float:
    """The time over which the mass fades, s."""
    scene = {
        "elements": {"rubber": {"stiffness": SOFT}, "cup": {"mass": HEAVY, **fade}},
        "together": [["rubber", "cup"]],
        "loop": {"acceleration_filter_hz": 5.0},
    }
    found = (
        optimise(load_device("homerehab"), Scene.model_validate(scene)).elements["cup"].fade_time
    )
    assert found is not None
    return found


def _pumped(seconds: float) -> float:
    """Largest growth of a period in which a hand waits out of the mass, and then in it.

    At twice the gain, one sample late, over all waits up to a swing of either.
    """
    steps = [one_step(3.0, 10.0, 1, (2 * SOFT, 0.0, 2 * HEAVY * at), None, 5.0) for at in LEVELS]
    samples = round(seconds * 1e3 / (LEVELS.size - 1))
    rise = fall = np.eye(len(steps[0]))
    for up, down in zip(steps[1:], steps[-2::-1], strict=True):
        rise = np.linalg.matrix_power(up, samples) @ rise
        fall = np.linalg.matrix_power(down, samples) @ fall
    waits = np.arange(0, 1000, 20)
    out, within = (np.array([np.linalg.matrix_power(s, k) for k in waits]) for s in steps[::32])
    periods = fall @ within[:, None] @ rise @ out[None]
    return float(np.abs(np.linalg.eigvals(periods)).max())


def test_the_fade_that_is_stated_lets_nothing_grow_and_a_fast_one_does() -> None:
    assert _tuned() == 0.4
    assert _pumped(0.064) > 1.05
    assert _pumped(0.4) < 1


def test_a_scene_may_ask_for_a_longer_fade_and_not_for_a_shorter_one() -> None:
    assert _tuned(fade_time=0.6) == 0.6
    with pytest.raises(InvalidInputError, match=r"it must fade over 0\.4 s") as refused:
        _tuned(fade_time=0.2)
    assert "cup.fade_time" in str(refused.value)
