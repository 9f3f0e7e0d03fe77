"""The certificate against the criterion that tunes: two assemblies, two arithmetics, one truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.thinned import thinned
from tune.certificate.poles import judge
from tune.certificate.region import Point, Setting
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop
from tune.stability.verdict import safe_gain


def _case(seed: int) -> tuple[Point, Setting, Loop, Effects]:
    rng = np.random.default_rng(seed)
    mass, step = 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(-4, -2.5)
    damping = 0.0 if rng.random() < 0.1 else mass * 10 ** rng.uniform(-3, 2)
    delay = int(rng.integers(0, 4))
    cutoffs = [None if rng.random() < 0.3 else float(c) for c in rng.choice([20.0, 50.0], 2)]
    stiffness = 10 ** rng.uniform(-5, 0) * mass / step**2
    virtual_damping = rng.choice([0, 1, -0.01]) * 10 ** rng.uniform(-3, 0) * mass / step
    virtual_mass = rng.choice([0, 1, -0.3]) * 10 ** rng.uniform(-2, 0.5) * mass
    point = Point(mass=mass, damping=damping, sample_time=step, delay_samples=delay)
    setting = Setting(
        stiffness=stiffness,
        damping=virtual_damping,
        mass=virtual_mass,
        velocity_filter_hz=cutoffs[0],
        acceleration_filter_hz=cutoffs[1],
    )
    loop = Loop.from_numbers(
        mass=mass,
        damping=damping,
        sample_time=step,
        delay_samples=delay,
        filters=Filters(velocity_filter_hz=cutoffs[0], acceleration_filter_hz=cutoffs[1]),
    )
    effects = Effects(
        stiffness=stiffness, damping=virtual_damping or None, mass=virtual_mass or None
    )
    return point, setting, loop, effects


@pytest.mark.parametrize("block", thinned(range(4), 2))
def test_the_gain_up_to_which_all_gains_are_stable_is_the_same(block: int) -> None:
    bounded = 0
    for seed in range(50 * block, 50 * block + 50):
        point, setting, loop, effects = _case(seed)
        gain = float(safe_gain(loop, effects))
        if gain == 0:
            assert judge(point, setting, 1e-6).answer != "stable"
        elif math.isinf(gain):
            assert judge(point, setting, 1e3).answer == "stable"
        else:
            bounded += 1
            assert judge(point, setting, gain * (1 - 1e-8)).answer == "stable"
            assert judge(point, setting, gain * (1 + 1e-8)).answer != "stable"
    assert bounded > 20


def test_marginal_is_not_stable() -> None:
    """An undamped device under a virtual mass alone drifts for ever."""
    point = Point(mass=1.0, damping=0.0, sample_time=1e-3, delay_samples=0)
    setting = Setting(
        stiffness=0.0, damping=0.0, mass=0.5, velocity_filter_hz=None, acceleration_filter_hz=None
    )
    assert judge(point, setting, 1.0).answer == "undecided"
