"""Friction whose turns lie anywhere in a sample, judged by an exact event by event simulation."""

import numpy as np
import pytest

from identification import Hardware, identify, quantity
from tests.exact_axis import Axis, logged, multisine


@pytest.mark.parametrize("delay", [0.0, 0.0003, 0.0017])
@pytest.mark.parametrize("stated", [True, False])
def test_intervals_are_near_the_count_and_hold_the_truth(delay: float, stated: bool) -> None:
    """Also at a delay of 0, the end of what is looked at, and where the force changes in a turn."""
    axis = Axis(mass=0.6, damping=3.0, coulomb=0.4, delay=delay)
    force = multisine(np.random.default_rng(5), samples=6000, runs=1, axis=axis, peak=6.0)
    log = logged(axis, force[:, 0], count=5e-6)
    hardware = Hardware(delay=quantity(delay)) if stated else None
    found = identify(log, hardware=hardware)
    assert found.method == "output-error"
    device = found.device
    for value, true in ((device.mass, 0.6), (device.damping, 3.0)):
        half = (value.high - value.low) / 2
        assert abs(value.value - true) <= 2 * half
        assert half <= 3e-4 * true
