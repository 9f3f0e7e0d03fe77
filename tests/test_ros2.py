"""The files for ROS 2: parameters as any reader takes them, the law in Python, its node."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import haptune
from tests.exported import LOOPS, STEP, changed, tuned
from tests.guard import STATUS, Guard, built, enter, parameters_of, push, write
from tests.middleware import Middleware, module_of
from tune import SafeProfile, export

#: Sets that a hand may touch, some of them not certified.
TOUCHED = (
    (),
    ("wall",),
    ("other",),
    ("wall", "other"),
    ("wall", "other", "rubber"),
    ("cup",),
    ("wall", "cup"),
    ("other", "cup"),
    ("rubber",),
    ("rubber", "cup"),
)


def walled(**loop: Any) -> SafeProfile:
    """The tuned profile with two walls that push only, one of them never met with the cup."""
    profile = changed(**loop)
    wall = profile.elements["wall"].model_copy(update={"one_sided": True})
    other = wall.model_copy(update={"damping": 20.0, "force_level": 10.0})
    elements = {**profile.elements, "wall": wall, "other": other}
    return profile.model_copy(update={"elements": elements, "apart": (("other", "cup"),)})


class Knocked:
    """A fake device: mass, damping and friction, an encoder, and a hand that pushes at random."""

    def __init__(self, seed: int) -> None:
        self.source = np.random.default_rng(seed)
        self.place = self.speed = self.hand = 0.0

    def read(self) -> float:
        return round(self.place / 6e-6) * 6e-6

    def move(self, force: float) -> None:
        """One period under a force, in two steps."""
        self.hand += 0.02 * (float(self.source.normal(0.0, 200.0)) - self.hand) - self.place
        for _ in range(2):
            total = force + self.hand - 10.0 * self.speed - 0.8 * math.tanh(self.speed / 1e-2)
            self.speed += total / 3.0 * STEP / 2
            self.place += self.speed * STEP / 2


def drive(law: Any, guard: Guard, samples: int) -> tuple[float, set[str]]:
    """Play both on one device, to the last bit alike: (largest force, every status seen)."""
    device = Knocked(samples)
    source = device.source
    places = {name: 1 << place for place, name in enumerate(law.names)}
    guard.start()
    touched: tuple[str, ...] = ()
    largest = 0.0
    seen: set[str] = set()
    for k in range(samples):
        elements = sum(places[name] for name in touched)
        changes = source.random()
        if changes < 0.01:
            touched = TOUCHED[source.integers(len(TOUCHED))]
            elements = sum(places[name] for name in touched)
        if changes < 0.02:
            chosen = [touched, touched[:1], law.names][source.integers(3)]
            rest = device.place + float(source.choice([0.0, 0.01, -0.01]))
            side = int(source.choice([-1, 0, 1], p=[0.45, 0.1, 0.45]))
            told = guard.call(enter(sum(places[name] for name in chosen), rest, side)).status
            assert law.reset(chosen, rest, side).name == told
            seen.add(told)
        period = (2**32 - 500 + k) % 2**32
        reading, chance, gain = device.read(), source.random(), 1.0
        if chance < 0.02:  # nothing came, for one period or several
            device.move(law.last_force)
            if chance > 0.0005:
                continue
        elif chance < 0.025:
            reading = float(source.choice([np.nan, np.inf, reading + 0.3]))
        elif chance < 0.03:
            period = (period - 1) % 2**32
        elif chance < 0.1:
            gain = float(source.choice([0.0, 0.5, 1.5]))
        force = law.force(touched, period, reading, gain)
        reply = guard.call(push(elements, period, reading, gain))
        assert (law.status.name, law.clamped) == (reply.status, reply.clamped)
        assert (law.missed, law.glitches) == (reply.missed, reply.glitches)
        assert force == reply.force
        assert abs(force) <= law.peak
        walls = [law.elements[name] for name in law.walls]
        assert all(wall.force * wall.side >= 0 for wall in walls)
        largest = max(largest, abs(force))
        seen.add(reply.status)
        device.move(force)
    return largest, seen


@pytest.mark.parametrize(
    ("name", "samples"),
    [
        ("as-tuned", 20_000),
        *(pytest.param(name, 100_000, marks=pytest.mark.long) for name in LOOPS),
    ],
)
def test_the_law_in_python_keeps_to_the_forces_of_the_guard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, samples: int
) -> None:
    profile = walled(**LOOPS[name])
    files = export(profile, "ros2")
    write(files, tmp_path)
    law = module_of(tmp_path, "haptune_law", monkeypatch).Law(
        parameters_of(files["haptune_params.yaml"])
    )
    largest, seen = drive(law, built(export(profile, "c"), tmp_path), samples)
    assert largest > 10
    assert seen == set(STATUS)


def test_the_node_plays_the_law_by_the_stamps_of_its_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = export(walled(), "ros2", node="/robot/haptune_x")
    write(files, tmp_path)
    given = parameters_of(files["haptune_params.yaml"], "/robot/haptune_x")
    ros = Middleware(tmp_path, given, monkeypatch)
    law = sys.modules["haptune_law"]

    class Played(ros.module.HaptuneNode):
        def touched(self, position: float) -> dict[str, tuple[float, int]]:
            rubber = {"rubber": (9.0, 0)} if position > 0 else {}
            return {"wall": (0.0 if node.law.missed < 2 else 1e-3, -1)} | rubber

    node, alone = Played(), law.Law(given)
    assert node.name == "haptune_x"
    periods = [*range(20), *range(21, 40), *range(50, 80), *range(81, 300)]
    wanted: list[float] = []
    inside: dict[str, tuple[float, int]] = {}
    for period in periods:
        place = 0.002 * np.sin(period / 10)
        now = 1_000_000_000 + period * 1_000_000 + 40_000 * (period % 3)
        touched = node.touched(place)
        ros.now = now
        ros.deliver(now, ["other", "x"], [9.0, place])
        for name, entry in touched.items():
            if inside.get(name) != entry and alone.reset([name], *entry).name == "OK":
                inside[name] = entry
        wanted.append(alone.force(list(touched), period, place))
        inside = {name: inside[name] for name in touched if name in inside}
        if alone.status.name == "LATE":
            inside = {}
    assert [force for _, force in ros.sent] == wanted
    assert min(wanted) < -0.5
    assert wanted[60:70] != [0.0] * 10
    assert alone.elements["wall"].face == 1e-3
    assert any(text.startswith("LATE") for text in ros.said)


@pytest.mark.parametrize("name", ["9x", "a-b", "/robot//x", "robot/x", ""])
def test_a_name_that_no_node_can_have_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("profile.yaml").write_text(tuned().to_yaml(), encoding="utf-8")
    ended = haptune("export", "profile.yaml", "--to", "ros2", "--node", name)
    assert ended.code == 2
    assert "is no name of a node" in ended.err
    ended = haptune("export", "profile.yaml", "--to", "c", "--node", "haptune")
    assert (ended.code, "names a node of ROS 2" in ended.err) == (2, True)
