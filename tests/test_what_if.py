"""What each fact of the hardware costs: every row is a full tune of the device changed by hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from identification import Device, Quantity, as_stored, load_device, quantity
from tests.commands import haptune
from tune import CheckFailedError, NoFeasibleEffectError, Scene, optimise, what_if

SPRING = Scene.model_validate({"elements": {"wall": {"stiffness": "max"}}})


def _times(item: Quantity, factor: float) -> Quantity:
    return quantity(item.value * factor, item.low * factor, item.high * factor)


def _changed(device: Device, change: str) -> Device:
    """The device with one fact changed, as its file would hold it."""
    if change == "as it is":
        return device
    limit, count = device.force_limit, device.encoder_resolution
    assert limit is not None
    assert count is not None
    strong = limit.model_copy(update={"continuous": 2 * limit.continuous, "peak": 2 * limit.peak})
    updates: dict[str, dict[str, object]] = {
        "half the delay": {"delay": _times(device.delay, 0.5)},
        "twice the sample rate": {"sample_time": _times(device.sample_time, 0.5)},
        "an encoder twice as fine": {"encoder_resolution": _times(count, 0.5)},
        "twice the force": {"force_limit": strong},
        "half the damping": {"damping": _times(device.damping, 0.5)},
        "twice the damping": {"damping": _times(device.damping, 2.0)},
    }
    if change in updates:
        return as_stored(device.model_copy(update=updates[change]))
    (mode,) = device.modes
    assert change == f"the mode at {mode.frequency_hz.value:.4g} Hz damped twice as well"
    better = mode.model_copy(update={"damping_ratio": _times(mode.damping_ratio, 2.0)})
    return as_stored(device.model_copy(update={"modes": (better,)}))


def _assert_rows_are_tunes(device: Device, scene: Scene) -> None:
    now, *rows = what_if(device, scene)
    assert now.change == "as it is"
    assert [row.total for row in rows] == sorted((row.total for row in rows), reverse=True)
    for row in (now, *rows):
        try:
            tuned = optimise(_changed(device, row.change), scene)
        except (NoFeasibleEffectError, CheckFailedError, ValidationError):
            assert row.reason is not None
            continue
        steps = {
            f"{name}.{effect}": value
            for name, each in tuned.elements.items()
            for effect, value in each.perceived_steps.items()
        }
        assert row.steps == pytest.approx(steps, rel=1e-6)
        assert row.total == pytest.approx(sum(steps.values()), rel=1e-6)


@pytest.mark.long
def test_a_mode_damped_better_is_one_of_the_rows() -> None:
    vibrating = {
        "frequency_hz": 90.0,
        "damping_ratio": {"value": 0.03, "low": 0.02, "high": 0.04},
        "at_encoder": 0.4,
    }
    device = load_device("homerehab")
    device = Device.model_validate({**dict(device), "modes": [vibrating]})
    _assert_rows_are_tunes(device, SPRING)


def test_the_command_shows_the_table_and_its_numbers_in_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(
        "elements: {water: {damping: 10.0}}\nloop: {velocity_filter_hz: 50.0}\n", encoding="utf-8"
    )
    ended = haptune("tune", "homerehab", "scene.yaml", "--what-if", "--dry-run", "--json")
    assert ended.code == 0, ended.err
    rows = ended.result["details"]["what_if"]
    assert rows[0]["change"] == "as it is"
    assert {"half the delay", "twice the force"} <= {row["change"] for row in rows}
    assert all(row["total"] > 0 for row in rows)
