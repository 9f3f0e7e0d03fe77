"""Three margins side by side, against the roots of the closed loop in z."""

from __future__ import annotations

from itertools import product
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from identification import Device, load_device, quantity
from tests.commands import haptune
from tests.unlimited import UNLIMITED
from tune import (
    NoFeasibleEffectError,
    Scene,
    candidates,
    candidates_picture,
    compare_candidates,
    load_profile,
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
    device: Device, walls: tuple[Any, ...]
) -> None:
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


def test_the_picture_has_a_bar_for_every_effect_of_every_candidate(
    walls: tuple[Any, ...],
) -> None:
    rows = compare_candidates(walls)
    (axes,) = candidates_picture(rows, "linear").axes
    bars: list[Rectangle] = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    widths = sorted(bar.get_width() for bar in bars)
    assert widths == pytest.approx(sorted(row.steps.value for row in rows))


def test_more_of_one_effect_is_less_of_another(device: Device) -> None:
    """None of them exceeds another in both (Pareto)."""
    wish = {"stiffness": "max", "mass": "max", "damping": 60.0, "penetration": 0.01}
    loop = {"velocity_filter_hz": 50.0, "acceleration_filter_hz": 30.0}
    found = candidates(load_device("homerehab"), _scene({"it": wish}, loop=loop))
    steps = {
        each.name: each.profile.elements["it"].perceived_steps
        for each in found
        if each.profile is not None
    }
    assert list(steps)[3:] == ["more stiffness", "more mass"]
    stiff, even, heavy = (steps[n] for n in ("more stiffness", "balanced", "more mass"))
    assert stiff["stiffness"] >= even["stiffness"] >= heavy["stiffness"]
    assert stiff["mass"] <= even["mass"] <= heavy["mass"]


def test_balanced_is_recommended(walls: tuple[Any, ...]) -> None:
    assert [candidate.margin for candidate in walls if candidate.recommended] == ["balanced"]


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
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
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
    assert "> firm" in table
    assert table.count("280 N/m") == 3
    assert "here the conservative one costs nothing" in ended.out
    written = load_profile(Path("profile.yaml"))
    assert written.margin.name == "firm"
    alone = haptune("tune", "homerehab", "scene.yaml", "--margin", "firm", "-o", "b.yaml", "--json")
    assert "candidates" not in alone.result.get("details", {})
    assert load_profile(Path("b.yaml")).digest == written.digest
