"""A servo's log with a white force that nobody logged: nothing else is seen in it."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.situations import DELAY, SITUATIONS, TRUTH, logs_of
from identification import Hardware, Identification, Method, identify, quantity

_SEEDS = 8


@cache
def _found(method: Method) -> list[Identification]:
    logs = logs_of(SITUATIONS[3], 5_000, range(_SEEDS))
    return [identify(log, hardware=Hardware(delay=quantity(DELAY)), method=method) for log in logs]


def _rms(method: Method) -> NDArray[np.float64]:
    """Relative error of mass and damping over seeds."""
    values = [[each.device.mass.value, each.device.damping.value] for each in _found(method)]
    return np.sqrt(np.mean((np.array(values) / TRUTH - 1) ** 2, axis=0))


def test_the_automatic_choice_is_no_worse_than_least_squares() -> None:
    mass, damping = _rms("auto") / _rms("least-squares")
    assert mass < 1.15  # chance: 0.99 over 200 seeds
    assert damping < 1.05  # friction that least squares take for noise is not kept


def test_no_friction_lag_or_play_is_made_of_it() -> None:
    for each in _found("auto"):
        assert each.method != "output-error"
        codes = {finding.code for finding in each.findings}
        assert not codes & {"unmodelled-force", "drive-lag", "vibration-mode", "backlash"}
