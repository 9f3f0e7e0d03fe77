"""Elements that fade beside others: proved at every level, against the device moved exactly."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from identification import load_device, quantity
from tests.wall_axis import Axis
from tests.wall_gates import transitions
from tests.wall_play import Bench, Law
from tune import Scene, optimise
from tune.certificate.certify import certify
from tune.certificate.region import Region, Setting
from tune.certificate.zero_exclusion import Claim, prove
from tune.documents.errors import CheckFailedError

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


def test_what_is_stable_in_whole_and_in_every_part_may_not_be_in_between() -> None:
    """A tenth of a block beside all of a feather: the pole radius there is 1.0003."""
    device = load_device("homerehab")
    device = device.model_copy(update={"mass": quantity(3.0), "damping": quantity(10.0)})
    elements = {
        "spring": {"stiffness": 50.0, "penetration": 0.01},
        "block": {"stiffness": 100.0, "mass": 0.5, "penetration": 0.01},
        "feather": {"mass": -0.5, "damping": 20.0},
    }
    scene = {
        "elements": elements,
        "together": [["spring", "block", "feather"]],
        "loop": {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0},
        "ripple_limit": 5.0,
    }
    plain = optimise(device, Scene.model_validate(scene))
    sizes = {
        "spring": (114.787, 0.0, 0.0),
        "block": (9357.18, 0.0, 5.18394),
        "feather": (0.0, 8.547153, -1.796808),
    }
    filters = {"velocity_filter_hz": 10.196, "acceleration_filter_hz": 5.05}

    def refused(part: float) -> set[str]:
        """Moments that are refused for what they are between nothing and all."""
        # The margin asks for twice as much, a sample later.
        played = {
            name: plain.elements[name].model_copy(
                update={
                    **dict(
                        zip(("stiffness", "damping", "mass"), part / 2 * np.array(own), strict=True)
                    ),
                    "margins": plain.elements[name].margins.model_copy(
                        update={"gain": 2.0, "extra_delay_samples": 1.0}
                    ),
                }
            )
            for name, own in sizes.items()
        }
        loop = plain.loop.model_copy(update=filters)
        with pytest.raises(CheckFailedError) as error:
            certify(plain.model_copy(update={"loop": loop, "elements": played}))
        return {each.split(":")[0] for each in error.value.failures if "fades in or out" in each}

    assert refused(0.4) == set()
    assert refused(1.0) == {"block + feather", "spring + block + feather"}
