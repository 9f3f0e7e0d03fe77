"""Simulated device, log, calibrate: how safe is the true device with its profile?"""

from collections import Counter

import numpy as np
import pytest

from identification import ForceLimit, Hardware, LogRefusedError, Trajectory, identify, quantity
from tests.exact_axis import fleet
from tests.thinned import thinned
from tests.true_loops import judged
from tune import NoFeasibleEffectError, Scene, optimise


def _scene(elements: dict[str, dict[str, str]], *together: list[str]) -> Scene:
    """Firm margins and no limit of force or ripple, so that stability is what binds."""
    return Scene.model_validate(
        {
            "elements": elements,
            "together": list(together),
            "margin": "firm",
            "ripple_limit": 1e6,
            "loop": {"velocity_filter_hz": 60.0, "acceleration_filter_hz": 40.0},
        }
    )


EVERYTHING = _scene(
    {
        "wall": {"stiffness": "max", "damping": "max"},
        "rubber": {"stiffness": "max"},
        "cup": {"mass": "max"},
        "light": {"mass": "min"},
    },
    ["wall", "cup"],
)
#: One element each, so that a study of many devices costs one proof a device. A mass alone would be
#: felt as damping on most of them.
ONE_BY_ONE = (
    _scene({"wall": {"stiffness": "max", "damping": "max"}}),
    _scene({"rubber": {"stiffness": "max"}}),
    _scene({"cup": {"mass": "max", "damping": "max"}}),
    _scene({"light": {"mass": "min", "damping": "max"}}),
    _scene({"ball": {"stiffness": "max", "damping": "max", "mass": "max"}}),
)


def _calibrate(
    count: int, seed: int, *scenes: Scene, seconds: float = 8.0, taken: int | None = None
) -> Counter[str]:
    """Devices calibrated from their logs, scenes in turn."""
    tally: Counter[str] = Counter()
    axis, force, place, counts = fleet(count, seed, seconds)
    T, delay = axis.sample_time, axis.delay
    for member in range(count if taken is None else taken):
        log = Trajectory(
            time=np.arange(len(force)) * np.float64(T),
            force=force[:, member],
            position=place[:, member],
            # The limit of the data sheet is larger than any force.
            stated_units=frozenset({"force"}),
        )
        sheet = Hardware(
            motion="linear",
            sample_time=quantity(T),
            delay=quantity(delay),
            encoder_resolution=quantity(float(counts[member])),
            force_limit=ForceLimit(continuous=1e6, peak=1e6),
        )
        try:
            profile = optimise(identify(log, hardware=sheet).device, scenes[member % len(scenes)])
        except LogRefusedError as error:
            tally["refused: " + error.findings[0].code] += 1
        except NoFeasibleEffectError:
            tally["nothing feasible"] += 1
        else:
            m, b = (float(np.asarray(each)[member]) for each in (axis.mass, axis.damping))
            tally["profiles"] += 1
            tally[judged(profile, (m, b, T), round(delay / T))] += 1
    return tally


@pytest.mark.parametrize("taken", thinned([1, 3], 1))
def test_true_devices_are_stable_with_their_profiles(taken: int) -> None:
    tally = _calibrate(3, 0, EVERYTHING, taken=taken)
    assert tally["stable"] == tally["profiles"] == taken, tally


@pytest.mark.long
@pytest.mark.parametrize("seed", range(1, 101))
def test_ten_thousand_true_devices_are_stable_with_their_profiles(seed: int) -> None:
    """A hundred of them: none unstable; of 10 000 at most ten short of what is claimed."""
    tally = _calibrate(100, seed, *ONE_BY_ONE, seconds=5.0)
    print(dict(tally))
    assert tally["unstable"] == 0, tally
    assert tally["short of what is claimed"] <= 1, tally
    assert tally["profiles"] >= 80, tally
