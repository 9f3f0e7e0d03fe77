"""Whatever delay a log has, and whatever is stated of it: an answer, or a sentence why not."""

import warnings
from contextlib import suppress

import numpy as np
import pytest

from identification import (
    METHODS,
    Hardware,
    IdentificationError,
    Method,
    Trajectory,
    identify,
    quantity,
)
from identification.findings import CODES
from tests.exact_axis import Axis, counted, positions
from tests.thinned import thinned

_BATCH = 10


def _drawn(seed: int) -> tuple[Trajectory, Hardware, Method, tuple[str, ...]]:
    dice = np.random.default_rng(seed)
    step = 1 / float(dice.choice([100.0, 250.0, 500.0, 1000.0, 2000.0, 5000.0]))
    samples = int(dice.integers(220, 1600))
    late = float(dice.choice([dice.uniform(0, 0.014), step * dice.integers(0, 8)]))
    mass = 10 ** dice.uniform(-1, 1)
    axis = Axis(
        mass=mass,
        damping=mass * 10 ** dice.uniform(-0.5, 1.5),
        coulomb=float(dice.choice([0.0, 0.3, 1.0])),
        sample_time=step,
        delay=late,
    )
    time = step * np.arange(samples)
    lines = dice.uniform(0.3, 12.0, int(dice.integers(1, 7)))
    force = 4 * np.sin(6.28 * lines[:, None] * time + lines[:, None]).mean(axis=0)
    if dice.random() < 0.2:
        force = 3 * np.sign(force)
    if dice.random() < 0.5:  # a warm-up without force
        force[: int(dice.integers(0, samples // 2))] = 0.0
    place = counted(positions(axis, force[:, None]), 10 ** dice.uniform(-6, -4))[:, 0]
    uneven = time + step * dice.uniform(0, 0.3, samples) * float(dice.random() < 0.2)
    kept = dice.random(samples) > (0.02 if dice.random() < 0.2 else 0.0)
    reference = (place + 1e-3 * np.sin(5 * time))[kept] if dice.random() < 0.3 else None
    log = Trajectory(
        time=uneven[kept],
        force=force[kept],
        position=place[kept],
        reference=reference,
        motion="linear",
    )
    lag = step * float(dice.choice([0.0, 0.5, 1.0, 2.0, 4.0, 6.0, 30.0]))
    doubt = float(dice.choice([0.0, lag]))
    hardware = Hardware(delay=quantity(lag, lag - doubt, lag + doubt))
    method = METHODS[int(dice.integers(len(METHODS)))]
    allow = CODES if dice.random() < 0.6 else ()
    return log, hardware if dice.random() < 0.5 else Hardware(), method, allow


def _answers(seed: int) -> bool:
    try:
        log, hardware, method, allow = _drawn(seed)
        found = identify(log, hardware=hardware, method=method, allow=allow)
    except IdentificationError:
        return False
    assert found.device.mass.low > 0
    return True


@pytest.mark.parametrize("batch", thinned(range(1000 // _BATCH), 1))
def test_every_delay_and_known_lag_is_answered_or_refused(batch: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answered = [_answers(seed) for seed in range(_BATCH * batch, _BATCH * (batch + 1))]
    assert any(answered)


def test_slow_motion_lets_instruments_move_the_delay_anywhere() -> None:
    """Their delay once left the rows that feel only logged forces."""
    for seed in (3, 20):
        dice = np.random.default_rng(seed)
        time = 1e-3 * np.arange(int(dice.integers(250, 1200)), dtype=np.float64)
        force = np.sin(6.28 * dice.uniform(0.5, 3) * time + seed)
        axis = Axis(mass=1.0, damping=dice.uniform(0.5, 20), delay=dice.uniform(0, 0.01))
        place = counted(positions(axis, force[:, None]), 1e-5)[:, 0]
        log = Trajectory(time=time, force=force, position=place, motion="linear")
        with suppress(IdentificationError):
            identify(log, method="instruments", allow=CODES)


def test_terms_that_are_alike_leak_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _answers(398)
