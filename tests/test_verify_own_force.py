"""Verification on a device with a spring of its own: what swings is held by both springs."""

from __future__ import annotations

import numpy as np
import pytest

from tests.closed_loop_logs import Bench, verdicts
from tune.verification import advise, verify

SPRUNG = Bench(
    mass=3.0,
    damping=10.0,
    coulomb_friction=0.4,
    stiffness=400.0,
    encoder_resolution=6e-6,
    force_limit=28.0,
    start=0.02,
    elements={"wall": (800.0, 10.0, 0.0), "oil": (0.0, 10.0, 0.0)},
    velocity_filter_hz=50.0,
)


@pytest.mark.parametrize(
    ("element", "gain", "spring"),
    [
        pytest.param("wall", 0.5, 800.0, id="wall", marks=pytest.mark.long),
        pytest.param("oil", 1.0, 400.0, id="oil"),
    ],
)
def test_an_agreeing_log_agrees_and_another_spring_shows(
    element: str, gain: float, spring: float
) -> None:
    """Frequency of both springs together, √(k + K) by the textbook, with an element of none too."""
    seen = verify(SPRUNG.profile, SPRUNG.log(element, gain, samples=2500))
    found = verdicts(seen)
    assert [found[check] for check in ("law", "frequency", "decay")] == ["agrees"] * 3
    assert seen.motion is not None
    assert seen.motion.measured is not None
    decay = seen.motion.measured.decay
    hertz = np.sqrt(spring / 3.0 - decay**2) / (2 * np.pi)
    assert seen.motion.measured.frequency == pytest.approx(hertz, rel=0.02)
    softer = SPRUNG.log(element, gain, samples=2500, other={"stiffness": 200.0})
    assert verdicts(verify(SPRUNG.profile, softer))["frequency"] == "disagrees"


@pytest.mark.long
def test_advice_lets_go_of_an_element_without_a_spring_too() -> None:
    (oil,) = advise(SPRUNG.profile, (("oil",),))
    assert oil.play is not None
    assert oil.play.displacement is not None
