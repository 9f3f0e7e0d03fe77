"""The region of a device and a hand: every corner, every delay, and the spots found later."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from identification import Device, parse_document
from tune.documents.effects import Effects
from tune.documents.errors import LoopError
from tune.documents.scene import FREE_TO_RIGID, Hand
from tune.loop.loop import Filters, Loop
from tune.optimisation.region import PlantPoint, Region
from tune.stability.verdict import largest

MODE = {
    "frequency_hz": {"value": 80.0, "low": 75.0, "high": 85.0},
    "damping_ratio": {"value": 0.03, "low": 0.02, "high": 0.04},
    "at_encoder": 0.5,
}


def _device(**more: Any) -> Device:
    stated: dict[str, Any] = {
        "sample_time": 0.001,
        "mass": {"value": 3.0, "low": 2.9, "high": 3.1},
        "damping": {"value": 10.0, "low": 9.0, "high": 11.0},
        "delay": 0.001,
    }
    return parse_document(Device, {**stated, **more}, "device.yaml")


def _beyond(region: Region, extra: float) -> list[float]:
    return [late.beyond for late in region.loops(Filters(), extra)]


def test_a_rigid_device_alone_has_four_corners_at_each_delay() -> None:
    region = Region.of(_device(), None, extra=2)
    late = region.loops(Filters(), 2)
    assert [one.beyond for one in late] == [0, 1, 2]
    assert all(one.loop.scales[0].shape == (4,) and not one.loop.grounded for one in late)


def test_the_corners_are_those_of_the_simultaneous_box() -> None:
    device = _device()
    box = device.simultaneous_box()
    spring = Effects(damping=5.0)
    (late,) = Region.of(device, None, extra=0).loops(Filters(), 0)
    each = [
        float(
            largest(
                Loop.from_numbers(mass=m, damping=b, sample_time=0.001, delay_samples=1),
                "stiffness",
                spring,
            )
        )
        for m in box.mass
        for b in box.damping
    ]
    np.testing.assert_allclose(largest(late.loop, "stiffness", spring), each, rtol=1e-12)


@pytest.mark.parametrize(
    ("delay", "beyond"),
    [
        ({"value": 1e-3, "low": 0.8e-3, "high": 1.2e-3}, [0, 0, 0, 0.8, 1]),
        ({"value": 0.4e-3, "low": 0.4e-3, "high": 0.4e-3}, [0, 0.6, 1]),
        (0.0, [0, 1]),
        (1.0000000001e-3, [0, 1]),
    ],
)
def test_delays_are_judged_at_their_ends_and_at_whole_samples(
    delay: Any, beyond: list[float]
) -> None:
    region = Region.of(_device(delay=delay), None, extra=1)
    assert _beyond(region, 1) == pytest.approx(beyond)


def test_a_hand_adds_its_corners_and_the_device_alone_stays() -> None:
    late = Region.of(_device(), FREE_TO_RIGID["linear"], extra=1).loops(Filters(), 0)
    assert [(one.loop.grounded, one.loop.scales[0].size) for one in late] == [
        (False, 4),
        (True, 32),
    ]


def test_a_hand_that_is_known_is_one_corner() -> None:
    known = Hand.model_validate({"mass": 0.2, "damping": 3.0, "stiffness": 100.0})
    late = Region.of(_device(), known, extra=1).loops(Filters(), 0)
    assert [one.loop.scales[0].size for one in late] == [4, 4]


def test_modes_and_lag_add_their_corners() -> None:
    device = _device(modes=[MODE], current_lag={"value": 4e-4, "low": 3e-4, "high": 5e-4})
    (late,) = Region.of(device, None, extra=0).loops(Filters(), 0)
    assert late.loop.scales[0].size == 4 * 4 * 2


def test_a_sample_time_that_varies_has_loops_of_its_own() -> None:
    time = {"value": 1e-3, "low": 0.99e-3, "high": 1.01e-3}
    late = Region.of(_device(sample_time=time), None, extra=0).loops(Filters(), 0)
    steps = sorted({float(one.loop.scales[0][0] / one.loop.scales[1][0]) for one in late})
    assert steps[0] == pytest.approx(0.99e-3)
    assert steps[-1] == pytest.approx(1.01e-3)


def test_a_spot_found_later_joins_with_its_delay() -> None:
    region = Region.of(_device(), None, extra=2)
    spot = PlantPoint(mass=2.0, damping=5.0, sample_time=0.001, delay=0.0025)
    wider = replace(region, found=(spot,))
    added = wider.loops(Filters(), 2)[-1]
    assert added.beyond == pytest.approx(1.5)
    expected = Loop.from_numbers(mass=2.0, damping=5.0, sample_time=0.001, delay_samples=2.5)
    np.testing.assert_array_equal(added.loop.terms.free[:, 0], expected.terms.free)
    assert len(wider.loops(Filters(), 1)) == len(region.loops(Filters(), 1))


def test_a_delay_that_cannot_be_judged_is_refused() -> None:
    with pytest.raises(LoopError, match=r"21 samples of 0\.001 s, at most 20 can be tuned"):
        Region.of(_device(delay=0.021), None, extra=2)
