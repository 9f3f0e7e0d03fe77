"""identify: delay, hardware, several logs, methods and terms as asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from identification import (
    Hardware,
    InvalidInputError,
    Method,
    Trajectory,
    UsageError,
    identify,
    quantity,
)
from identification.estimators import ESTIMATORS
from tests.axis_logs import COUNT, HARDWARE, NAMES, STEP, codes, homerehab, log, refused
from tests.exact_axis import Axis, counted, multisine, positions
from tests.thinned import thinned


@pytest.mark.parametrize("samples", thinned([2.5, 0.0, 1.0], 1))
def test_delay_stated_assumed_or_read(samples: float) -> None:
    axis = Axis(delay=samples * STEP)
    force = multisine(np.random.default_rng(5), samples=8000, runs=1, axis=axis)
    trajectory = log(force[:, 0], counted(positions(axis, force), COUNT)[:, 0])
    found = identify(trajectory)
    assert codes(found) == {"not-stated"}
    assert found.device.damping.value == pytest.approx(10.0, rel=5e-3)
    assert found.logs[0].delay is not None
    assert found.logs[0].delay.value == pytest.approx(samples * STEP, abs=2e-5)
    stored = found.device.delay
    assert stored.value == pytest.approx(max(samples, 1.0) * STEP, rel=1e-2)
    assert stored.source == "log"
    assert stored.low <= samples * STEP <= stored.high
    assert stored.high >= STEP
    assert "delay" not in found.device.missing
    stated = identify(trajectory, hardware=Hardware(delay=quantity(samples * STEP)))
    assert stated.device.delay.value == samples * STEP
    assert stated.device.delay.source == "hardware"
    assert "delay" not in stated.findings[0].seen


def test_hardware_is_kept_and_what_it_leaves_open_is_read() -> None:
    trajectory = homerehab()[0]
    device = identify(trajectory, hardware=HARDWARE).device
    assert device.name == "homerehab"
    assert device.sample_time.source == "hardware"
    assert device.encoder_resolution == quantity(COUNT, source="hardware")
    assert device.force_limit == HARDWARE.force_limit
    assert device.missing == ()
    found = identify(replace(trajectory, motion=None))
    assert codes(found) == {"not-stated"}
    (said,) = found.findings
    for fact in ("motion", "delay", "force_limit", "encoder_resolution"):
        assert fact in said.seen
    bare = found.device
    assert bare.missing == ("motion", "sample_time", "encoder_resolution", "force_limit")
    assert bare.encoder_resolution is not None
    assert bare.encoder_resolution.value == pytest.approx(COUNT, rel=1e-6)
    assert bare.encoder_resolution.source == "log"
    assert bare.force_limit is not None
    assert bare.force_limit.peak == pytest.approx(np.abs(trajectory.force).max(), rel=1e-9)
    assert bare.force_limit.continuous == bare.force_limit.peak
    assert bare.force_limit.source == "log"
    assert bare.sample_time.value == pytest.approx(STEP, rel=1e-9)
    assert bare.sample_time.source == "log"
    assert bare.logs[0].findings == ("not-stated",)


def test_sample_times_that_contradict() -> None:
    trajectory = homerehab()[0]
    with pytest.raises(InvalidInputError, match=r"0\.001.*0\.0013"):
        identify(trajectory, hardware=Hardware(sample_time=quantity(0.0013)))
    assert refused(trajectory, hardware=Hardware(sample_time=quantity(0.0005))) == {
        "dropped-samples"
    }
    close = Hardware(sample_time=quantity(0.001005), delay=quantity(STEP))
    assert identify(trajectory, hardware=close).device.sample_time.value == 0.001005


@pytest.mark.parametrize("delay", [1e3, 1e6, 1e9])
def test_a_delay_that_is_no_small_part_of_the_log_is_refused(delay: float) -> None:
    with pytest.raises(InvalidInputError, match=r"lasts .* s.*a delay of .* at most 0\.1 times"):
        identify(homerehab()[0], hardware=Hardware(delay=quantity(delay)))


def test_several_logs_give_their_envelope() -> None:
    poses: list[Trajectory] = []
    for mass in (2.8, 3.0, 3.3):
        axis = Axis(mass=mass, delay=STEP)
        force = multisine(np.random.default_rng(6), samples=6000, runs=1, axis=axis)
        poses.append(log(force[:, 0], counted(positions(axis, force), COUNT)[:, 0]))
    found = identify(poses, hardware=HARDWARE)
    assert found.device.mass.low <= 2.8
    assert found.device.mass.high >= 3.3
    assert 2.8 < found.device.mass.value < 3.3
    assert len(found.device.logs) == len(found.estimates) == 3
    covariance = found.device.covariance
    assert covariance is not None
    assert np.sqrt(covariance.matrix[0][0]) >= np.std([2.8, 3.0, 3.3], ddof=1) * 0.99
    box = found.device.simultaneous_box()
    assert box.mass[0] < 2.8
    assert box.mass[1] > 3.3


@pytest.mark.parametrize("kind", [{"axis": "y"}, {"motion": "rotary"}])
def test_axes_are_not_mixed(kind: dict[str, Any]) -> None:
    one = homerehab()[0]
    other = log(one.force, one.position, **kind)
    with pytest.raises(UsageError, match=r"one (axis|motion) at a time"):
        identify([one, other])
    with pytest.raises(UsageError, match="hardware"):
        identify(other, hardware=HARDWARE)


def test_requests_that_cannot_be_met() -> None:
    trajectory = homerehab()[0]
    with pytest.raises(UsageError, match="auto, least-squares, instruments, output-error"):
        identify(trajectory, method="guess")  # pyright: ignore[reportArgumentType]
    with pytest.raises(UsageError, match="nonsense"):
        identify(trajectory, allow=["jitter", "nonsense"])
    with pytest.raises(UsageError):
        identify([])


@pytest.mark.parametrize("method", ESTIMATORS)
def test_a_method_can_be_asked_for(method: Method) -> None:
    found = identify(homerehab()[0], hardware=HARDWARE, method=method)
    assert found.method == method
    assert "as asked" in found.reason
    assert found.method in repr(found)
    assert len(repr(found)) < 300


def test_terms_stay_unless_they_are_noise() -> None:
    none = identify(homerehab()[1], hardware=HARDWARE)
    assert none.device.coulomb_friction.low == 0
    assert none.device.coulomb_friction.value < 1e-4
    covariance = none.device.covariance
    assert covariance is not None
    assert covariance.parameters == NAMES
    small = identify(homerehab(0.02, runs=1)[0], hardware=HARDWARE)
    assert small.device.coulomb_friction.value == pytest.approx(0.02, abs=2e-3)


def test_motion_one_way_cannot_split_friction_from_offset() -> None:
    time = np.arange(8000) * STEP
    force = (12 + 3 * np.sin(9 * time) + 2 * np.sin(2 * time))[:, None]
    axis = Axis(coulomb=0.8)
    place = counted(positions(axis, force, speed=1.0), COUNT)[:, 0]
    hardware = Hardware(delay=quantity(0.0))
    found = identify(log(force[:, 0], place), hardware=hardware, allow=["force-unit"])
    assert found.estimates[0].parameters == ("mass", "damping", "force_offset")
    assert found.device.mass.value == pytest.approx(3.0, rel=1e-3)
    assert found.device.force_offset.value == pytest.approx(0.8, rel=0.05)
