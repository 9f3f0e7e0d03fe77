"""identify: what is wrong with a log, and what no log may end in."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identification import (
    ForceLimit,
    Hardware,
    IdentificationError,
    Method,
    Trajectory,
    identify,
    quantity,
)
from identification.findings import CODES
from tests.axis_logs import COUNT, HARDWARE, STEP, codes, homerehab, log, refused
from tests.exact_axis import Axis, counted, multisine, positions
from tests.simulated.families import FAMILIES
from tests.thinned import thinned


def test_alternating_steps_are_taken_as_they_are() -> None:
    family = FAMILIES["alternating-steps"]
    trajectory = family.logs([0])[0]
    found = identify(trajectory, hardware=family.hardware)
    assert "jitter" in codes(found)
    device = found.device
    assert device.mass.value == pytest.approx(family.truth["mass"], rel=2e-3)
    assert device.damping.value == pytest.approx(family.truth["damping"], rel=2e-3)
    assert (device.sample_time.low, device.sample_time.high) == pytest.approx((0.010, 0.012))


def test_dropped_samples_are_counted_and_bridged() -> None:
    plain = homerehab()[0]
    keep = np.ones(len(plain), dtype=bool)
    keep[[500, 501, 9000]] = False
    gaps = Trajectory(time=plain.time[keep], force=plain.force[keep], position=plain.position[keep])
    found = identify(gaps, hardware=HARDWARE)
    (seen,) = [each.seen for each in found.findings if each.code == "dropped-samples"]
    assert "2 gaps, about 3 samples lost" in seen
    assert found.device.mass.value == pytest.approx(3.0, rel=1e-3)


def test_few_counts() -> None:
    plain = homerehab()[0]
    coarse = log(plain.force, counted(plain.position, 2e-3))
    assert "few-counts" in refused(coarse)


def test_force_at_its_limit() -> None:
    plain = homerehab()[0]
    clipped = log(np.clip(plain.force, -6, 6), plain.position)
    assert refused(clipped) == {"force-saturated"}
    weak = HARDWARE.model_copy(update={"force_limit": ForceLimit(continuous=5.0, peak=9.0)})
    assert refused(plain, hardware=weak) == {"force-saturated"}


def test_a_force_of_the_wrong_sign() -> None:
    plain = homerehab(0.8, disturbance=5e-3)[0]
    turned = log(-plain.force, plain.position)
    assert "sign-flip" in refused(turned, hardware=HARDWARE)
    # A negative mass is no device, whatever is allowed.
    assert "sign-flip" in refused(turned, hardware=HARDWARE, allow=CODES)


def test_a_device_without_damping_is_not_refused() -> None:
    axis = Axis(mass=3.0, damping=0.0)
    force = multisine(np.random.default_rng(10), samples=8000, runs=1, axis=axis)
    place = counted(positions(axis, force), COUNT)[:, 0]
    device = identify(log(force[:, 0], place), hardware=Hardware(delay=quantity(0.0))).device
    assert device.damping.low <= 0 <= device.damping.high


def test_every_refusal_of_a_log_is_listed_at_once() -> None:
    plain = homerehab()[0]
    clipped = np.clip(plain.force, -6, 6)
    stamps = plain.time + np.where(np.arange(len(plain)) > 700, 5.0, 0.0)
    bad = Trajectory(time=stamps, force=clipped, position=counted(plain.position, 2e-3))
    assert refused(bad) == {"force-saturated", "dropped-samples", "few-counts"}


WAVE = np.sin(2 * np.pi * 2 * np.arange(2000) * STEP)
ROWS = np.arange(2000.0)
SIGNS = (-1.0) ** np.arange(2000)
SPIKE = np.where(ROWS == 500, 1.0, 0.0)
WALK = np.random.default_rng(1).standard_normal(2000)
NOISE = np.random.default_rng(2).standard_normal(2000)
STRANGE: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {
    "walks": (np.cumsum(WALK), np.cumsum(NOISE)),
    "noise": (WALK, NOISE),
    "impulse": (SPIKE, WAVE),
    "jump": (WAVE, SPIKE),
    "steps": (np.sign(WAVE), np.sign(WAVE)),
    "huge": (WAVE * 1e200, WAVE * 1e150),
    "tiny": (WAVE * 1e-200, WAVE * 1e-160),
    "ramps": (ROWS, ROWS),
    "alternating": (SIGNS, 1e-4 * SIGNS),
    "far away": (WAVE, 1e9 + WAVE * 1e-3),
    "growing": (np.exp(ROWS / 200), np.exp(ROWS / 200)),
    "one count": (WAVE, np.where(WAVE > 0, 1e-3, 0.0)),
    "shortest": (WAVE[:200], WAVE[:200]),
}


@pytest.mark.parametrize("allow", [(), CODES], ids=["strict", "all allowed"])
@pytest.mark.parametrize("method", thinned(["auto", "output-error"], 1))
@pytest.mark.parametrize("name", STRANGE)
def test_no_log_ends_in_anything_but_a_device_or_a_sentence(
    name: str, method: Method, allow: tuple[str, ...]
) -> None:
    force, place = STRANGE[name]
    with suppress(IdentificationError):
        device = identify(log(force, place), method=method, allow=allow).device
        assert device.mass.low > 0
        assert device.simultaneous_box().mass[0] > 0
