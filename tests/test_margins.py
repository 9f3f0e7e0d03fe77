"""Margins against the loop in z at 60 digits and more, on random loops, and known answers."""

from __future__ import annotations

from collections import Counter
from math import exp, pi

import numpy as np
import pytest
from flint import acb, arb

from identification import Device, quantity
from tests.margin_cases import draw, effects_of, loop_of
from tests.sampled_loops import Case
from tests.sampled_reference import Sampled
from tests.thinned import thinned
from tune.documents.scene import Effects, Hand
from tune.loop.loop import Filters, Loop
from tune.margins import (
    disk_margin,
    least_damping_ratio,
    margins_of,
    phase_margin,
    slowest_decay,
)
from tune.stability.verdict import safe_gain

#: What every margin must agree to, relative.
AGREEMENT = 1e-9


def _differences(case: Case) -> dict[str, float]:
    """Relative difference of each margin from the reference."""
    reference = Sampled(case)
    loop, effects = loop_of(case), effects_of(case)
    fixed, varied, closed = reference.loop.fixed, reference.loop.varied, reference.closed

    def balanced(z: acb) -> arb:
        return abs((fixed(z) - varied(z)) / closed(z)) / 2

    def sensitivity(z: acb) -> arb:
        return abs(fixed(z) / closed(z))

    peaks = [reference.largest(balanced), reference.largest(sensitivity)]
    disk = disk_margin(loop, effects)
    decays = reference.in_s()
    slow = [(d, r) for d, r in decays if exp(-d * case.sample_time) > exp(-pi)]
    pairs = {
        "gain": (float(safe_gain(loop, effects)), reference.safe_gain()),
        "decay": (float(slowest_decay(loop, effects)), min(d for d, _ in decays)),
        "ratio": (
            float(least_damping_ratio(loop, effects)),
            min((r for _, r in slow), default=1.0),
        ),
        "phase": (float(phase_margin(loop, effects)), reference.phase_margin()),
        "balanced": (disk.balanced, 1 / peaks[0][0]),
        "balanced_hz": (disk.balanced_hz, peaks[0][1]),
        "sensitivity": (disk.sensitivity, 1 / peaks[1][0]),
        "sensitivity_hz": (disk.sensitivity_hz, peaks[1][1]),
    }
    return {
        name: 0.0 if ours == theirs else abs(ours - theirs) / abs(theirs)
        for name, (ours, theirs) in pairs.items()
    }


def _compare(count: int, seed: int, *, plain: bool) -> None:
    rng = np.random.default_rng(seed)
    wrong: Counter[str] = Counter()
    examples: dict[str, tuple[Case, float]] = {}
    for _ in range(count):
        case = draw(rng, plain=plain)
        for name, difference in _differences(case).items():
            if not difference <= AGREEMENT:
                wrong[name] += 1
                examples[name] = (case, difference)
    assert not wrong, (wrong, examples)


@pytest.mark.parametrize("plain", thinned([False, True], 1))
@pytest.mark.parametrize("count", thinned([3, 5], 1))
def test_margins_of_random_loops(plain: bool, count: int) -> None:
    _compare(count, seed=1, plain=plain)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_margins_of_random_loops_long(seed: int) -> None:
    _compare(200, seed=100 + seed, plain=bool(seed % 2))


def _homerehab(delay: float, filters: Filters | None = None) -> Loop:
    return Loop.from_numbers(
        mass=3.0, damping=10.0, sample_time=1e-3, delay_samples=delay, filters=filters
    )


def _device(**changes: object) -> Device:
    values = {"mass": 3.0, "damping": 10.0, "sample_time": 1e-3, "delay": 1e-3, **changes}
    return Device.model_validate(
        {
            "schema": "haptune/device/1",
            "name": "test",
            "axis": "x",
            "motion": "linear",
            "coulomb_friction": 0.0,
            "force_offset": 0.0,
            **values,
        }
    )


def test_sensitivity_of_a_lightly_damped_spring() -> None:
    """Known: m = 3, b = 10, K = 1000 at 1 ms has Ms = 5.9 and a gain margin of 20."""
    disk = disk_margin(_homerehab(0), Effects(stiffness=1000.0))
    assert f"{1 / disk.sensitivity:.1f}" == "5.9"
    # Seiler, Packard and Gahinet 2020: both disks bound each other, and the gains they bear.
    assert disk.balanced / (1 + disk.balanced / 2) <= disk.sensitivity <= 1
    assert disk.balanced <= 2


def test_poles_of_a_slow_loop_are_those_of_the_spring_in_continuous_time() -> None:
    """At a thousand samples a swing the pole is that of m·s² + (b - KT/2)·s + K, to (ωT)²."""
    mass, damping, stiffness, step = 3.0, 10.0, 1000.0, 1e-5
    loop = Loop.from_numbers(mass=mass, damping=damping, sample_time=step)
    effects = Effects(stiffness=stiffness)
    decay = (damping - stiffness * step / 2) / (2 * mass)
    frequency = np.sqrt(stiffness / mass)
    assert float(slowest_decay(loop, effects)) == pytest.approx(decay, rel=1e-6)
    assert float(least_damping_ratio(loop, effects)) == pytest.approx(decay / frequency, rel=1e-4)


def test_free_motion_is_not_a_slow_pole() -> None:
    """A damper alone leaves the position free; what decays is the velocity, at (b + B)/m."""
    loop = Loop.from_numbers(mass=3.0, damping=10.0, sample_time=1e-5)
    decay = float(slowest_decay(loop, Effects(damping=20.0)))
    assert decay == pytest.approx(30.0 / 3.0, rel=1e-3)


def test_an_unstable_loop_has_no_margins_but_a_growth() -> None:
    found = margins_of(_device(), Effects(stiffness=30_000.0))
    assert (found.gain < 1, found.phase, found.disk.balanced) == (True, 0.0, 0.0)
    assert (found.delay.every_gain, found.delay.full_gain) == (0.0, 0.0)
    assert found.decay < 0
    assert np.isnan(found.time_constant)


def test_all_margins_of_the_papers_setting() -> None:
    """K = 1000, B = 10, M = 1 with 30 Hz filters and one sample of delay: fit, but not passive."""
    filters = Filters(velocity_filter_hz=30.0, acceleration_filter_hz=30.0)
    effects = Effects(stiffness=1000.0, damping=10.0, mass=1.0)
    found = margins_of(_device(), effects, filters)
    assert found.gain > 2
    assert found.delay.every_gain > 1
    assert 0 < found.damping_ratio < 1
    assert found.time_constant == pytest.approx(1 / found.decay)
    assert 0 < found.disk.balanced < 2
    assert 1 < found.critical_frequency_hz < 50
    assert found.passivity.passive is False


def test_filters_of_absent_effects_are_left_out() -> None:
    """A 0.1 Hz filter that nothing uses must not show as a slow pole."""
    filters = Filters(velocity_filter_hz=0.1, acceleration_filter_hz=0.1)
    found = margins_of(_device(), Effects(stiffness=1000.0), filters)
    bare = margins_of(_device(), Effects(stiffness=1000.0))
    assert found == bare


def test_margins_of_a_device_that_vibrates_in_a_hand() -> None:
    quantities = {"frequency_hz": 60.0, "damping_ratio": 0.02, "at_encoder": 0.5}
    device = _device(modes=[{**quantities, "at_handle": -2.0}])
    hand = Hand(mass=quantity(0.2), damping=quantity(5.0), stiffness=quantity(300.0))
    effects = Effects(stiffness=500.0, damping=5.0)
    found, bare = margins_of(device, effects, hand=hand), margins_of(device, effects)
    assert found.gain != bare.gain
    assert found.passivity.passive is None
    assert "vibrates" in found.passivity.reason
