"""Three margins side by side, and what each fact of the hardware costs."""

from itertools import product
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from identification import Device, Quantity, as_stored, load_device, quantity
from tests.commands import haptune
from tests.unlimited import UNLIMITED
from tune import (
    CheckFailedError,
    NoFeasibleEffectError,
    Scene,
    candidates,
    compare_candidates,
    load_profile,
    load_scene,
    optimise,
    what_if,
)

#: gain and further samples of delay, as the README promises them
PROMISED: dict[Any, tuple[float, int]] = {
    "conservative": (3.0, 2),
    "balanced": (2.0, 1),
    "firm": (1.5, 1),
}
WALL: dict[str, Any] = {"wall": {"stiffness": "max"}}


def _scene(elements: dict[str, Any] = WALL, **more: Any) -> Scene:
    return Scene.model_validate({"elements": elements, **more})


@pytest.fixture(scope="module")
def device() -> Device:
    """HomeRehab without the limits that would hide stability."""
    return load_device("homerehab").model_copy(update={**UNLIMITED, "delay": quantity(0.0)})


@pytest.fixture(scope="module")
def said() -> list[str]:
    """Sentences of progress while the walls were tuned."""
    return []


@pytest.fixture(scope="module")
def walls(device: Device, said: list[str]) -> tuple[Any, ...]:
    """The margin that the scene names is not looked at."""
    return candidates(device, _scene(margin="firm"), progress=said.append)


def _radius(stiffness: float, mass: float, damping: float, samples: int) -> float:
    """Largest pole of a spring on m·q̈ + b·q̇ = F, held for 1 ms, so many samples late."""
    step = 1e-3
    tau, pole = mass / damping, exp(-damping * step / mass)
    plant = np.array([step - tau * (1 - pole), tau * (1 - pole) - step * pole]) / damping
    bare = np.polymul([1.0, -1.0], [1.0, -pole])
    late = np.concatenate([bare, np.zeros(samples)])
    return float(np.abs(np.roots(np.polyadd(late, stiffness * plant))).max())


def _stiffness(candidate: Any) -> float:
    assert candidate.profile is not None
    return candidate.profile.elements["wall"].stiffness


def test_each_candidate_is_as_stiff_as_its_own_margin_allows(
    device: Device, walls: tuple[Any, ...], said: list[str]
) -> None:
    for margin in PROMISED:
        assert f"{margin} margin: tuning wall (1 of 1)" in said
    box = device.simultaneous_box()
    assert [candidate.margin for candidate in walls] == list(PROMISED)
    for candidate in walls:
        gain, extra = PROMISED[candidate.margin]
        # Without a delay of its own a spring takes too little damping away for a hand to tell.

        def worst(stiffness: float, late: int = extra) -> float:
            return max(_radius(stiffness, m, b, late) for m, b in product(box.mass, box.damping))

        limit = gain * _stiffness(candidate)
        assert worst(limit) < 1
        # Effects are rounded to six digits; delay is kept at the gain of the margin.
        assert worst(limit * 1.001) > 1
    assert _stiffness(walls[0]) < _stiffness(walls[1]) < _stiffness(walls[2])


def test_a_margin_that_allows_nothing_says_why_and_the_others_stand(
    device: Device, walls: tuple[Any, ...]
) -> None:
    between = (_stiffness(walls[0]) * _stiffness(walls[1])) ** 0.5
    scene = _scene({"wall": {"stiffness": {"min": between, "max": 1e5}}})
    conservative, balanced, firm = candidates(device, scene)
    assert conservative.profile is None
    assert isinstance(conservative.error, NoFeasibleEffectError)
    assert "its range starts at" in str(conservative.error)
    assert _stiffness(balanced) == pytest.approx(_stiffness(walls[1]), rel=1e-4)
    assert firm.error is None
    assert {row.margin for row in compare_candidates((conservative, balanced, firm))} == {
        "balanced",
        "firm",
    }


@pytest.fixture
def here(here: Path) -> None:
    # 14 N over 50 mm (table 1 of the paper): 280 N/m, far below what stability allows.
    text = "elements: {wall: {stiffness: max, penetration: 0.05}}\n"
    Path("scene.yaml").write_text(text, encoding="utf-8")


@pytest.mark.usefixtures("here")
def test_tune_shows_all_and_writes_the_margin_chosen() -> None:
    ended = haptune("tune", "homerehab", "scene.yaml", "--margin", "firm", "--candidates")
    assert ended.code == 0
    table = ended.out.partition("conservative:")[0]
    assert [table.count(margin) for margin in PROMISED] == [1, 1, 1]
    assert "balanced *" in table
    assert "firm >" in table
    assert ended.out.count("filters: none") == 3
    (row,) = (line.split() for line in table.splitlines() if "wall stiffness, N/m" in line)
    assert row[-3:] == ["280"] * 3
    assert "here the conservative one costs nothing" in ended.out
    written = load_profile(Path("profile.yaml"))
    assert written.margin.name == "firm"
    alone = haptune("tune", "homerehab", "scene.yaml", "--margin", "firm", "-o", "b.yaml", "--json")
    assert "candidates" not in alone.result.get("details", {})
    assert load_profile(Path("b.yaml")).digest == written.digest


def _times(item: Quantity, factor: float) -> Quantity:
    return quantity(item.value * factor, item.low * factor, item.high * factor)


#: The fact that each change multiplies, and with what.
CHANGES: dict[str, tuple[str, float]] = {
    "half the delay": ("delay", 0.5),
    "twice the sample rate": ("sample_time", 0.5),
    "an encoder twice as fine": ("encoder_resolution", 0.5),
    "half the damping": ("damping", 0.5),
    "twice the damping": ("damping", 2.0),
}


def _changed(device: Device, change: str) -> Device:
    """The device with one fact changed, as its file would hold it."""
    update: dict[str, Any] = {}
    if change in CHANGES:
        fact, factor = CHANGES[change]
        update = {fact: _times(getattr(device, fact), factor)}
    elif change == "twice the force":
        limit = device.force_limit
        assert limit is not None
        double = {"continuous": 2 * limit.continuous, "peak": 2 * limit.peak}
        update = {"force_limit": limit.model_copy(update=double)}
    elif change != "as it is":
        (mode,) = device.modes
        assert change == f"the mode at {mode.frequency_hz.value:.4g} Hz damped twice as well"
        better = mode.model_copy(update={"damping_ratio": _times(mode.damping_ratio, 2.0)})
        update = {"modes": (better,)}
    return as_stored(device.model_copy(update=update))


@pytest.mark.long
def test_a_mode_damped_better_is_one_of_the_rows() -> None:
    """Each row is what a tune of the device gives that has its fact changed."""
    vibrating = {
        "frequency_hz": 90.0,
        "damping_ratio": {"value": 0.03, "low": 0.02, "high": 0.04},
        "at_encoder": 0.4,
    }
    device = Device.model_validate({**dict(load_device("homerehab")), "modes": [vibrating]})
    scene = _scene()
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


def test_the_command_shows_the_table_and_its_numbers_in_json(here: Path) -> None:
    Path("scene.yaml").write_text(
        "elements: {water: {damping: 10.0}}\nloop: {velocity_filter_hz: 50.0}\n", encoding="utf-8"
    )
    ended = haptune("tune", "homerehab", "scene.yaml", "--what-if", "--dry-run", "--json")
    assert ended.code == 0, ended.err
    rows = ended.result["details"]["what_if"]
    told = what_if(load_device("homerehab"), load_scene("scene.yaml"))
    assert [(each.change, each.total) for each in told] == [(r["change"], r["total"]) for r in rows]
    assert rows[0]["change"] == "as it is"
    assert {row["change"] for row in rows[1:]} == {*CHANGES, "twice the force"}
    less, own, more = (
        next(row["total"] for row in rows if row["change"] == change)
        for change in ("half the damping", "as it is", "twice the damping")
    )
    assert less > own > more  # steps of 10 N·s/m beside the device's own
    assert all(row["total"] > 0 for row in rows)
