"""The proof over whole boxes: what it proves is true, and what is false it does not prove."""

from __future__ import annotations

import numpy as np
import pytest

from tune.certificate.boxes import Cell, no_crossing
from tune.certificate.polynomial import Point, Setting
from tune.certificate.roots import judge

CELLS = 64


def _setting(rng: np.random.Generator, mass: float, damping: float, step: float) -> Setting:
    kinds = rng.random(3) < 0.7
    if not kinds.any():
        kinds[0] = True
    sign = -1 if rng.random() < 0.2 else 1
    return Setting(
        stiffness=float(kinds[0] * 10 ** rng.uniform(-2, 0) * damping / step),
        damping=float(kinds[1] * 10 ** rng.uniform(-1, 1.5) * damping),
        mass=float(kinds[2] * sign * 10 ** rng.uniform(-2, -0.3) * mass),
        velocity_filter_hz=None if rng.random() < 0.4 else float(rng.uniform(20, 0.2 / step)),
        acceleration_filter_hz=None if rng.random() < 0.4 else float(rng.uniform(20, 0.2 / step)),
    )


def _draw(seed: int) -> tuple[Cell, Setting, int, np.random.Generator]:
    rng = np.random.default_rng(seed)
    mass, step = 10 ** rng.uniform(-1.3, 1.3), float(rng.choice([5e-4, 1e-3, 2e-3]))
    damping = mass / 10 ** rng.uniform(-1, 0.5)
    spread = rng.uniform(0.001, 0.2)
    cell = Cell(
        mass=(mass * (1 - spread), mass * (1 + spread)),
        damping=(damping * (1 - spread), damping * (1 + spread)),
        sample_time=(step * (1 - spread / 20), step * (1 + spread / 20)),
    )
    return cell, _setting(rng, mass, damping, step), int(rng.integers(0, 4)), rng


def _stable(cell: Cell, setting: Setting, delay: int, where: np.ndarray, gain: float) -> bool:  # type: ignore[type-arg]
    sides = (cell.mass, cell.damping, cell.sample_time)
    m, b, T = (low + u * (high - low) for (low, high), u in zip(sides, where, strict=True))
    point = Point(mass=m, damping=b, sample_time=T, delay_samples=delay)
    return judge(point, setting, gain).answer == "stable"


@pytest.mark.parametrize("block", range(4))
def test_no_proved_box_holds_an_unstable_device(block: int) -> None:
    """A stable corner and no crossing: then 30 random devices are stable at every gain."""
    proved = unproved = 0
    for seed in range(block * 40, block * 40 + 40):
        cell, setting, delay, rng = _draw(seed)
        gain = float(rng.uniform(1, 3))
        corner = _stable(cell, setting, delay, np.zeros(3), gain)
        if not (corner and no_crossing(cell, setting, delay, gain, CELLS)):
            unproved += 1
            continue
        proved += 1
        for _ in range(30):
            assert _stable(cell, setting, delay, rng.random(3), gain)
    assert proved >= 8
    assert unproved >= 3


def test_a_box_with_both_kinds_of_device_is_not_proved() -> None:
    """Boxes chosen so that one corner is stable and another is not."""
    mixed = 0
    for seed in range(1000, 1500):
        cell, setting, delay, rng = _draw(seed)
        gain = float(rng.uniform(1, 3))
        answers = {
            _stable(cell, setting, delay, np.array([i, j, 0.5]), gain)
            for i in (0, 1)
            for j in (0, 1)
        }
        if len(answers) == 2:
            mixed += 1
            assert not no_crossing(cell, setting, delay, gain, CELLS)
    assert mixed >= 10


def test_a_gap_in_the_gains_is_not_overlooked() -> None:
    """Stable near zero and at full gain, unstable between them, in a box of a single device."""
    cell = Cell(mass=(1.0, 1.0), damping=(0.0057, 0.0057), sample_time=(1.0, 1.0))
    setting = Setting(
        stiffness=0.752,
        damping=0.211,
        mass=0.576,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )
    assert not no_crossing(cell, setting, 0, 1.0, CELLS)
    assert no_crossing(cell, setting, 0, 0.039, CELLS)


def test_a_negative_damper_that_outweighs_the_device_is_not_overlooked() -> None:
    """The root leaves through w = 0, where the odd part vanishes by itself."""
    cell = Cell(mass=(1.0, 1.1), damping=(1.0, 1.1), sample_time=(1e-3, 1e-3))
    setting = Setting(
        stiffness=0.0, damping=-0.6, mass=0.0, velocity_filter_hz=None, acceleration_filter_hz=None
    )
    assert no_crossing(cell, setting, 1, 1.5, CELLS)
    assert not no_crossing(cell, setting, 1, 1.9, CELLS)
