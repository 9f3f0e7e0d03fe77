"""Loops from devices and hands, and what cannot be a loop."""

from __future__ import annotations

import numpy as np
import pytest

from identification import load_device
from tests.general_loops import HAND, HOMEREHAB, MODE
from tune.documents import LoopError
from tune.documents.scene import FREE_TO_RIGID
from tune.loop.loop import Filters, Loop
from tune.loop.plant import HandNumbers


def test_from_parts_reads_the_device_and_the_hand() -> None:
    device = load_device("homerehab")
    hand = FREE_TO_RIGID["linear"]
    filters = Filters(velocity_filter_hz=50.0)
    loop = Loop.from_parts(device, filters, hand, extra_delay_samples=0.25)
    numbers = Loop.from_numbers(
        mass=device.mass.value,
        damping=device.damping.value,
        sample_time=device.sample_time.value,
        delay_samples=device.delay.value / device.sample_time.value + 0.25,
        filters=filters,
        hand=HandNumbers(
            mass=hand.mass.value, damping=hand.damping.value, stiffness=hand.stiffness.value
        ),
    )
    assert loop.grounded
    for mine, theirs in ((loop.terms, numbers.terms), (loop.sizes, numbers.sizes)):
        np.testing.assert_array_equal(mine.free, theirs.free)
        np.testing.assert_array_equal(mine.alpha, theirs.alpha)


def test_a_quotient_that_should_be_whole_is_whole() -> None:
    """0.0003/0.0001 is 2.9999999999999996 in doubles."""
    quotient = 0.0003 / 0.0001
    assert quotient < 3
    exact = Loop.from_numbers(**HOMEREHAB, delay_samples=3)
    assert Loop.from_numbers(**HOMEREHAB, delay_samples=quotient).degree == exact.degree


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"delay_samples": -1e-3}, "negative"),
        ({"delay_samples": 22.5}, "22"),
        ({"delay_samples": np.array([0.5, 1.75])}, "whole part"),
        ({"delay_samples": np.nan}, "delay"),
        ({"mass": 0.0}, "mass"),
        ({"current_lag": -1e-3}, "current_lag"),
        ({"modes": (MODE._replace(frequency_hz=0.0),)}, "frequency"),
        ({"modes": (MODE._replace(damping_ratio=-0.1),)}, "damping ratio"),
        ({"hand": HAND._replace(mass=-0.1)}, "hand"),
    ],
)
def test_what_cannot_be_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(LoopError, match=words):
        Loop.from_numbers(**{**HOMEREHAB, **change})


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"velocity_filter_hz": 0.0}, "velocity_filter_hz"),
        ({"acceleration_filter_hz": np.inf}, "acceleration_filter_hz"),
        ({"velocity_filter_order": 3}, "velocity_filter_order"),
        ({"filter_damping_ratio": 0.0}, "filter_damping_ratio"),
        ({"filter_damping_ratio": 1.5}, "filter_damping_ratio"),
        ({"velocity_window_samples": 0}, "velocity_window_samples"),
        ({"velocity_window_samples": 61}, "velocity_window_samples"),
        ({"velocity_window_samples": 5, "velocity_filter_hz": 30.0}, "exclude"),
    ],
)
def test_filters_that_do_not_exist_are_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(LoopError, match=words):
        Filters(**wrong)  # type: ignore[arg-type]
