"""Logs of millions of samples: what they are told from, and what they cost."""

from typing import Any

import numpy as np
import pytest

from identification import Trajectory, examine, identify

MASS, DAMPING, STEP = 3.0, 10.0, 1e-3


def _log(rows: int, *, still: slice = slice(0)) -> dict[str, Any]:
    """A device under coloured force, one sample late, counted in 6 µm; at rest in some rows."""
    from scipy.signal import lfilter

    force = 10 * np.asarray(lfilter([0.02], [1, -0.98], np.random.default_rng(5).normal(size=rows)))
    force[still] = 0.0
    late = np.append(0.0, force[:-1])
    decay = np.exp(-DAMPING / MASS * STEP)
    gain = (1 - decay) * MASS / DAMPING
    velocity = np.asarray(lfilter([0, (1 - decay) / DAMPING], [1, -decay], late))
    moved = np.cumsum(gain * velocity + (STEP - gain) / DAMPING * late)
    place = np.append(0.0, moved[:-1])
    return {
        "time": np.arange(rows) * STEP,
        "force": force,
        "position": np.rint(place / 6e-6) * 6e-6,
    }


def test_a_long_log_is_told_from_its_most_excited_part(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("identification.trajectory.MOST_FITTED", 10_000)
    log = Trajectory(**_log(40_000, still=slice(0, 27_000)))
    found = identify(log)
    assert found.logs[0].fitted == 10_000
    assert "from the 10000 samples that move most of 40000" in found.reason
    assert found.device.logs[0].samples == 40_000
    for quantity, true in ((found.device.mass, MASS), (found.device.damping, DAMPING)):
        assert quantity.low < true < quantity.high
    seen = examine(log)
    assert (seen.samples, seen.fitted) == (40_000, 10_000)


@pytest.mark.parametrize("still", [slice(5_000, 15_000), slice(0, 15_400)], ids=["paused", "late"])
def test_the_delay_is_looked_for_where_the_device_is_driven(still: slice) -> None:
    """Nothing, or nearly nothing, is driven in the middle."""
    found = identify(Trajectory(**_log(20_000, still=still))).device
    assert found.delay is not None
    for quantity, true in ((found.mass, MASS), (found.damping, DAMPING), (found.delay, STEP)):
        assert quantity.low <= true <= quantity.high
        assert quantity.value == pytest.approx(true, rel=0.02)


def test_a_change_in_the_part_left_out_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last quarter is of a device of another mass: its force is doubled there."""
    monkeypatch.setattr("identification.trajectory.MOST_FITTED", 10_000)
    columns = _log(40_000)
    columns["force"][30_000:] *= 2
    found = identify(Trajectory(**columns), allow=["heldout-misfit", "hand-on-device"])
    assert "heldout-misfit" in found.device.logs[0].findings


def test_columns_that_nobody_can_change_are_not_copied() -> None:
    columns = _log(300)
    columns["force"].setflags(write=False)
    log = Trajectory(**columns)
    assert log.force is columns["force"]
    assert log.position is not columns["position"]
    columns["position"][0] = 7.0
    assert log.position[0] != 7.0
