"""The simulator of the rehearsal plays the law that the compiled guard plays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from datasets_synthetic import Controller
from datasets_synthetic.calls import Calls
from datasets_synthetic.law import ControlLaw, Element
from tests.entered_scenes import made
from tests.exported import STEP
from tests.guard import built, enter, push
from tune.exporters import export


def test_the_simulator_plays_what_the_guard_plays(tmp_path: Path) -> None:
    """Rubber, water and a cup between two walls: met, entered and left at once."""
    scene = {
        "wall": (12_000.0, 70.0, 0.0),
        "wall 2": (9_000.0, 52.5, 0.0),
        "rubber": (1400.0, 10.0, 0.0),
        "water": (0.0, 10.0, 0.0),
        "cup": (0.0, 0.0, 1.475),
    }
    profile = made("homerehab", scene, together=(("rubber", "water", "cup"),), speed=4.0)
    faces = {"wall": (-1, 0.004), "wall 2": (1, -0.006)}
    beside = [
        Element(
            stiffness=element.stiffness,
            damping=element.damping,
            mass=element.mass,
            side=faces.get(name, (0, 0.0))[0],
            place=faces.get(name, (0, 0.0))[1],
            level=element.force_level or np.inf,
            fade_time=element.fade_time,
        )
        for name, element in profile.elements.items()
    ]
    controller = Controller(
        velocity_filter_hz=50.0,
        acceleration_filter_hz=30.0,
        beside=tuple(beside),
        calls=Calls(entrance=0.001, taps=7),
    )
    time = np.arange(1400) * STEP
    place = 0.006 * np.sin(2 * np.pi * 2.3 * time) + 0.001 * np.cos(2 * np.pi * 17 * time) - 0.0021
    simulator = ControlLaw(controller, np.array([STEP]))
    wanted = [float(simulator.force(np.array([x]))[0]) for x in place]
    calls = [enter(28)]
    calls += [enter(1 << k, face, side) for k, (side, face) in enumerate(faces.values())]
    calls += [push(31 if x > 0.001 else 3, k, x) for k, x in enumerate(place.tolist())]
    replies = built(export(profile, "c"), tmp_path).run(calls)[3:]
    assert {reply.status for reply in replies} == {"OK"}
    found = np.clip(wanted, -28, 28)
    np.testing.assert_allclose([reply.force for reply in replies], found, atol=1e-10)
    assert found.max() > 10
    assert found.min() < -10
