"""``haptune audit``: the paper's own setting, what makes it unfit, and the nearest safe values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flint import arb

from identification import load_device, named_devices
from tests.commands import haptune
from tests.reference import reference_loop, stable_by_jury
from tests.thinned import thinned
from tune import Effects, Filters, Loop, audit, largest

PAPER = ("--stiffness", "1000", "--damping", "10", "--mass", "1")
FILTERED = ("--velocity-filter", "30", "--acceleration-filter", "30")


def test_the_papers_own_setting_is_safe_with_filters() -> None:
    ended = haptune("audit", "homerehab", *PAPER, *FILTERED)
    assert ended.code == 0, ended.err
    assert "delay 1 sample" in ended.out
    assert "gain margin" in ended.out
    assert "extra delay, samples" in ended.out
    assert "N rms" in ended.out
    assert "safe with margin balanced" in ended.out


def test_without_filters_the_encoder_is_why_it_is_not_fit() -> None:
    ended = haptune("audit", "homerehab", *PAPER)
    assert ended.code == 6
    assert "the encoder makes the force ripple by 4.19 rms" in ended.err
    assert "Filter velocity and acceleration" in ended.err


def test_a_spring_too_stiff_ends_in_6_with_the_nearest_safe_value() -> None:
    ended = haptune(
        "audit", "homerehab", "--stiffness", "30000", "--damping", "0", "--mass", "0", "--json"
    )
    assert ended.code == 6
    details = ended.result["details"]
    assert {fault["limit"] for fault in details["faults"]} == {"stability", "force"}
    assert details["nearest"] == {"stiffness": pytest.approx(1400.0)}
    assert details["wall"]["restitution"][1] > 1  # an unstable wall gives more than it takes
    assert details["jitter"] == 0
    assert "nearest safe values: --stiffness 1400" in ended.err


def test_the_nearest_safe_values_are_safe_and_near() -> None:
    device = load_device("homerehab")
    wanted = Effects(stiffness=1000.0, damping=10.0, mass=1.0)
    found = audit(device, wanted)
    assert found.nearest is not None
    again = audit(device, found.nearest)
    assert again.safe
    assert again.certificate is not None
    K, B, M = (float(value) for value in found.nearest.arrays() if value is not None)
    assert 100 < K <= 1000
    assert 1 < B <= 10
    assert 0 < M < 0.1  # at 6 N of ripple a kilogram, 0.1 N is all but reached by 0.02 kg


def test_the_gain_margin_is_that_of_the_roots() -> None:
    """The device is known exactly but for the box of its mass and damping: the worst corner."""
    device = load_device("homerehab")
    box = device.simultaneous_box()
    found = audit(device, Effects(stiffness=2000.0))
    T = device.sample_time.value
    for share, stable in ((1 - 1e-6, True), (1 + 1e-6, False)):
        corners = [
            stable_by_jury(
                reference_loop(b * T / m, 2000.0 * T * T / m, 0, 0, delay=1).at(
                    arb(found.gain * share)
                )
            )
            for m in box.mass
            for b in box.damping
        ]
        assert all(corners) == stable


def test_further_delay_becomes_part_of_the_device() -> None:
    device = load_device("homerehab")
    gains = Effects(stiffness=1000.0, damping=10.0)
    near = audit(device, gains, filters=Filters(velocity_filter_hz=50.0))
    late = audit(device, gains, filters=Filters(velocity_filter_hz=50.0), extra_delay_samples=1.5)
    assert late.design.device.delay.value == pytest.approx(0.0025)
    assert late.gain < near.gain
    assert near.delay_samples == 10.0 or near.delay_samples - late.delay_samples == pytest.approx(
        1.5, abs=0.11
    )


EFFECTS = ("stiffness", "damping", "mass")


def _limits(name: str) -> dict[str, float]:
    """What each effect may be alone on the device at its best estimate; below zero all it has."""
    device = load_device(name)
    loop = Loop.from_parts(device, Filters())
    found = {effect: float(largest(loop, effect, Effects())) for effect in EFFECTS}
    return found | {"less damping": -device.damping.value, "less mass": -device.mass.value}


def _judged(name: str, gains: dict[str, float], filters: Filters | None = None) -> None:
    """An audit has an answer in numbers: safe with a certificate, or the faults."""
    found = audit(load_device(name), Effects(**gains), filters=filters)
    assert found.safe == (found.certificate is not None) == (not found.faults)
    assert found.gain >= 0
    assert (found.margins is None) == (found.gain <= 1)
    assert found.ripple is None or math.isfinite(found.ripple)
    if found.nearest is not None:
        assert all(np.isfinite(size) for size in found.nearest.arrays() if size is not None)


def _each(shares: list[float]) -> list[tuple[str, dict[str, float]]]:
    return [
        (name, {effect.removeprefix("less "): share * limit})
        for name in named_devices()
        for effect, limit in _limits(name).items()
        for share in shares
    ]


@pytest.mark.parametrize(("name", "gains"), [*_each([1.001]), *thinned(_each([0.5, 10.0]), 0)])
def test_every_named_device_is_judged_at_and_beyond_its_limit(
    name: str, gains: dict[str, float]
) -> None:
    _judged(name, gains)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--stiffness", "1e308"), "--stiffness: 1e+308 is beyond 1e-09 to 1e+09"),
        (("--damping", "-1e10"), "--damping: -1e+10 is beyond"),
        (("--mass", "1e-308"), "--mass: 1e-308 is beyond"),
        (("--mass", "1", "--velocity-filter", "1e-300"), "--velocity-filter: 1e-300 is beyond"),
        (("--mass", "1", "--acceleration-filter", "1e300"), "--acceleration-filter: 1e+300 is"),
    ],
)
def test_values_that_no_scene_holds_are_a_usage_error(options: tuple[str, ...], words: str) -> None:
    ended = haptune("audit", "homerehab", *options)
    assert ended.code == 2
    assert words in ended.err
