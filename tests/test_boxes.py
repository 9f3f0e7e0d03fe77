"""The proof over whole boxes: what it proves is true, and what is false it does not prove."""

from __future__ import annotations

import numpy as np
import pytest

from tests.thinned import thinned
from tune.certificate.poles import judge
from tune.certificate.region import Point, Region, Setting
from tune.certificate.zero_exclusion import Claim, prove

CELLS = 3000


def _setting(rng: np.random.Generator, mass: float, damping: float, step: float) -> Setting:
    kinds = rng.random(3) < 0.7
    if not kinds.any():
        kinds[0] = True
    sign = -1 if rng.random() < 0.2 else 1
    return Setting(
        stiffness=float(kinds[0] * 10 ** rng.uniform(-1, 0.3) * damping / step),
        damping=float(kinds[1] * 10 ** rng.uniform(-1, 1.5) * damping),
        mass=float(kinds[2] * sign * 10 ** rng.uniform(-2, -0.3) * mass),
        velocity_filter_hz=None if rng.random() < 0.4 else float(rng.uniform(20, 0.2 / step)),
        acceleration_filter_hz=None if rng.random() < 0.4 else float(rng.uniform(20, 0.2 / step)),
    )


def _draw(seed: int) -> tuple[Region, Setting, Claim, np.random.Generator]:
    rng = np.random.default_rng(seed)
    mass, step = 10 ** rng.uniform(-1.3, 1.3), float(rng.choice([5e-4, 1e-3, 2e-3]))
    damping = mass / 10 ** rng.uniform(-1, 0.5)
    spread = rng.uniform(0.001, 0.2)
    region = Region(
        mass=(mass * (1 - spread), mass * (1 + spread)),
        damping=(damping * (1 - spread), damping * (1 + spread)),
        sample_time=(step * (1 - spread / 20), step * (1 + spread / 20)),
        delay=(0.0, float(rng.choice([0.0, 0.4, 1.0])) * step),
    )
    claim = Claim(gain=float(rng.uniform(1, 3)), extra=float(rng.choice([0.0, 0.7, 2.0])))
    return region, _setting(rng, mass, damping, step), claim, rng


def _stable(region: Region, setting: Setting, claim: Claim, where: np.ndarray) -> bool:  # type: ignore[type-arg]
    low, high = np.array((*region.sides(), (0.0, claim.extra))).T
    values = low + where * (high - low)
    point = region.point(values[:-1], float(values[-1]))
    return judge(point, setting, claim.gain).answer == "stable"


@pytest.mark.parametrize("block", thinned(range(4), 1))
def test_no_proved_box_holds_an_unstable_device(block: int) -> None:
    """A stable corner and no crossing: then 20 random devices are stable at every gain."""
    proved = unproved = 0
    for seed in range(block * 15, block * 15 + 15):
        region, setting, claim, rng = _draw(seed)
        if not (
            _stable(region, setting, claim, np.zeros(len(region.sides()) + 1))
            and prove(region, setting, [claim], CELLS).proved
        ):
            unproved += 1
            continue
        proved += 1
        for _ in range(20):
            assert _stable(region, setting, claim, rng.random(len(region.sides()) + 1))
    assert proved >= 3
    assert unproved >= 1


def test_a_box_with_both_kinds_of_device_is_not_proved() -> None:
    """Boxes chosen so that one corner is stable and another is not."""
    mixed = 0
    for seed in range(1000, 1060):
        region, setting, claim, rng = _draw(seed)
        answers = {
            _stable(region, setting, claim, rng.integers(0, 2, len(region.sides()) + 1))
            for _ in range(6)
        }
        if len(answers) == 2:
            mixed += 1
            assert not prove(region, setting, [claim], CELLS).proved
    assert mixed >= 5


def _device(mass: float, damping: float, step: float, delay: float) -> Region:
    return Region(
        mass=(mass, mass),
        damping=(damping, damping),
        sample_time=(step, step),
        delay=(delay, delay),
    )


def test_a_gap_in_the_gains_is_not_overlooked() -> None:
    """Stable near zero and at full gain, unstable between them, in a box of a single device."""
    region = _device(1.0, 0.0057, 1.0, 0.0)
    setting = Setting(
        stiffness=0.752,
        damping=0.211,
        mass=0.576,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    point = Point(mass=1.0, damping=0.0057, sample_time=1.0, delay_samples=0)
    assert judge(point, setting, 1.0).radius < 1
    assert not prove(region, setting, [Claim(gain=1.0, extra=0.0)], CELLS).proved
    assert prove(region, setting, [Claim(gain=0.039, extra=0.0)], CELLS).proved


def test_a_negative_damper_that_outweighs_the_device_is_not_overlooked() -> None:
    """The root leaves through z = 1: b = 1.0 to 1.1 against 0.6 times the gain."""
    region = Region(
        mass=(1.0, 1.1), damping=(1.0, 1.1), sample_time=(1e-3, 1e-3), delay=(1e-3, 1e-3)
    )
    setting = Setting(
        stiffness=0.0, damping=-0.6, mass=0.0, velocity_filter_hz=None, acceleration_filter_hz=None
    )
    assert prove(region, setting, [Claim(gain=1.5, extra=0.0)], CELLS).proved
    assert not prove(region, setting, [Claim(gain=1.9, extra=0.0)], CELLS).proved


@pytest.mark.parametrize("extra", [0.0, 1.0, 2.0])
def test_the_known_limit_of_a_spring_is_the_edge_of_the_proof(extra: float) -> None:
    """m = 3 kg, b = 10 N·s/m, 1 ms: 20 011, 6 673 and 4 006 N/m by samples of delay.

    The table of docs/theory.md prints whole newtons; between the samples every delay counts too.
    """
    limit = {0.0: 20_011.0, 1.0: 6_673.0, 2.0: 4_006.0}[extra]
    region = _device(3.0, 10.0, 1e-3, 0.0)
    setting = Setting(
        stiffness=1.0, damping=0.0, mass=0.0, velocity_filter_hz=None, acceleration_filter_hz=None
    )
    assert prove(region, setting, [Claim(gain=limit - 1, extra=extra)], CELLS).proved
    assert not prove(region, setting, [Claim(gain=limit + 1, extra=extra)], CELLS).proved


def test_a_loss_between_two_samples_of_delay_is_not_overlooked() -> None:
    """A box whose delay covers 0 to 1 sample is not proved by its two ends."""
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(40):
        setting = _setting(rng, 1.0, 5.0, 1e-3)
        claim = Claim(gain=float(rng.uniform(1, 6)), extra=1.0)
        region = _device(1.0, 5.0, 1e-3, 0.0)
        inside = [
            _stable(region, setting, claim, np.append(np.zeros(len(region.sides())), part))
            for part in np.linspace(0, 1, 9)
        ]
        if not all(inside):
            found += 1
            assert not prove(region, setting, [claim], CELLS).proved
    assert found >= 5
