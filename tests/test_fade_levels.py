"""Elements that fade beside others: proved at every level, against the device moved exactly."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from tests.wall_axis import Axis
from tests.wall_gates import transitions
from tests.wall_play import Bench, Law
from tune.certificate.branch_and_bound import Claim
from tune.certificate.point import Setting
from tune.certificate.region import Region
from tune.certificate.zero_exclusion import prove

T = 1e-3
#: K, B and M of what stays and of what fades, each with a level of its own; Hz of both filters.
Elements = tuple[tuple[float, float, float], ...]
CASES: dict[str, tuple[Elements, Elements, float, float]] = {
    "mass beside a spring": (((1400.0, 0.0, 0.0),), ((0.0, 0.0, 1.5),), 50.0, 30.0),
    "heavy mass beside a spring": (((3000.0, 20.0, 0.0),), ((0.0, 0.0, 6.0),), 60.0, 8.0),
    "two that fade": ((), ((900.0, 30.0, 1.5), (0.0, -3.0, -0.4)), 60.0, 30.0),
    "two beside a spring": (((1000.0, 0.0, 0.0),), ((0.0, -2.0, 0.0), (0.0, 0.0, 2.0)), 60.0, 20.0),
    "masses alone": (((0.0, 0.0, 0.0),), ((0.0, 0.0, 1.0), (0.0, 20.0, 2.0)), 60.0, 20.0),
}


def reach(name: str, delay: float) -> float:
    """The least gain at which the device is unstable at some level, over a grid of levels."""
    still, fading, velocity, acceleration = CASES[name]
    levels = np.array(list(product(np.linspace(0, 1, 5), repeat=len(fading))))
    kept = np.sum(still, axis=0) if still else np.zeros(3)
    sums = kept + levels @ np.array(fading)
    axis = Axis(mass=3.0, damping=10.0, sample_time=T, delay_samples=delay)
    poles = [float(np.exp(-2 * np.pi * hz * T)) for hz in (velocity, acceleration)]

    def stable(gain: float) -> bool:
        law = Law(
            stiffness=gain * sums[:, 0],
            damping=gain * sums[:, 1],
            steady_mass=gain * sums[:, 2],
            velocity_pole=poles[0],
            acceleration_pole=poles[1],
        )
        values = np.linalg.eigvals(transitions(Bench(axis, law, len(sums)), 1.0, 0.0))
        free = sums[:, 0] == 0
        near = np.abs(values - 1).argmin(axis=1)
        values[free, near[free]] = 0
        return bool(np.abs(values).max() < 1)

    low, high = 0.01, 0.01
    while stable(high):
        low, high = high, 1.2 * high
    for _ in range(14):
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@pytest.mark.parametrize(
    ("name", "delay"),
    [
        pytest.param(
            name,
            delay,
            marks=[] if (name, delay) == ("mass beside a spring", 2.4) else [pytest.mark.long],
        )
        for name in CASES
        for delay in (1.0, 2.4)
    ],
)
def test_what_is_proved_is_what_is_stable_at_every_level(name: str, delay: float) -> None:
    """Nearly to the gain at which some level of the grid is unstable, and not beyond it."""
    still, fading, velocity, acceleration = CASES[name]
    settings: list[Setting] = []
    corners = list(product((0.0, 1.0), repeat=len(fading)))
    kept = np.sum(still, axis=0) if still else np.zeros(3)
    for corner in corners:
        K, B, M = (float(each) for each in kept + np.array(corner) @ np.array(fading))
        if K or B or M:
            settings.append(
                Setting(
                    stiffness=K,
                    damping=B,
                    mass=M,
                    velocity_filter_hz=velocity,
                    acceleration_filter_hz=acceleration,
                )
            )
    region = Region(
        mass=(3.0, 3.0), damping=(10.0, 10.0), sample_time=(T, T), delay=(delay * T, delay * T)
    )
    edge, nothing = reach(name, delay), len(settings) < len(corners)
    for part, cells in ((0.98, 100_000), (1.02, 20_000)):
        claims, others = [Claim(gain=part * edge, extra=0.0)], settings[1:]
        found = prove(region, settings[0], claims, cells, others, or_nothing=nothing)
        assert found.proved == (part < 1)
