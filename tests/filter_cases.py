"""Devices and scenes on which cut-offs are chosen, and the best of a grid of cut-offs."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from identification import Device, ForceLimit, load_device, quantity
from tune.documents.perception import default_table
from tune.documents.scene import Scene
from tune.loop.loop import Filters
from tune.optimisation.cutoffs import CutoffObjective, ranks_of, tune_with_filters
from tune.optimisation.problem import DesignTask
from tune.optimisation.solve import groups

DEVICES = {
    "homerehab": load_device("homerehab"),
    "light": Device(
        name="light",
        motion="linear",
        sample_time=quantity(1e-3),
        mass=quantity(0.08, 0.076, 0.084),
        damping=quantity(0.1, 0.08, 0.12),
        coulomb_friction=quantity(0.05),
        delay=quantity(1e-3),
        encoder_resolution=quantity(2e-5),
        force_limit=ForceLimit(continuous=1.5, peak=6.0),
    ),
    "knob": Device(
        name="knob",
        motion="rotary",
        sample_time=quantity(5e-4),
        mass=quantity(1e-4, 9e-5, 1.1e-4),
        damping=quantity(2e-4, 1.5e-4, 2.5e-4),
        coulomb_friction=quantity(2e-3),
        delay=quantity(5e-4),
        encoder_resolution=quantity(2 * np.pi / 40000),
        force_limit=ForceLimit(continuous=0.1, peak=0.3),
    ),
    "heavy": Device(
        name="heavy",
        motion="linear",
        sample_time=quantity(1e-3),
        mass=quantity(12.0, 11.0, 13.0),
        damping=quantity(40.0, 34.0, 46.0),
        coulomb_friction=quantity(4.0),
        delay=quantity(2e-3),
        encoder_resolution=quantity(1e-5),
        force_limit=ForceLimit(continuous=80.0, peak=200.0),
    ),
}
SCENES: dict[str, dict[str, Any]] = {
    "block": {"block": {"stiffness": "max", "damping": "max", "mass": "max"}},
    "cup": {"cup": {"mass": "max", "damping": 20.0}},
    "mix": {
        "wall": {"stiffness": "max", "damping": "max"},
        "cup": {"mass": "max", "damping": "max"},
        "water": {"damping": "max"},
    },
}
#: Ripple limits, in multiples of the smallest force a hand notices.
RIPPLES = (0.3, 1.0, 3.0)


def task_of(device: str, elements: dict[str, Any], ripple: float = 1.0, **more: Any) -> DesignTask:
    """A scene on a device, its ripple limit in multiples of the default."""
    table = default_table()
    limit = ripple * table.threshold(DEVICES[device].motion)
    scene = Scene.model_validate({"elements": elements, "ripple_limit": limit, **more})
    return DesignTask.of(DEVICES[device], scene, table)


def worth_of(task: DesignTask, filters: Filters) -> CutoffObjective:
    """All elements of a scene with certain filters."""
    total = CutoffObjective(kept=(0,) * len(ranks_of(task)), value=0.0)
    for elements in groups(task.scene):
        total = total.plus(tune_with_filters(task, elements, filters).worth)
    return total


def best_of_grid(task: DesignTask, count: int) -> CutoffObjective:
    """The largest worth on a grid of count by count cut-offs from 5 Hz to Nyquist, and none."""
    hertz = np.geomspace(5.0, 0.5 / task.device.sample_time.value, count)
    choices = (None, *(float(f) for f in hertz))
    wishes = {name: set(element.wishes()) for name, element in task.scene.elements.items()}
    nothing = CutoffObjective(kept=(0,) * len(ranks_of(task)), value=0.0)
    total = dict.fromkeys(product(choices, choices), nothing)
    for elements in groups(task.scene):
        used = {effect for name in elements for effect in wishes[name]}
        known: dict[tuple[float | None, float | None], CutoffObjective] = {}
        for pair, before in total.items():
            velocity = pair[0] if "damping" in used else None
            acceleration = pair[1] if "mass" in used else None
            key = (velocity, acceleration)
            if key not in known:
                filters = Filters(velocity_filter_hz=velocity, acceleration_filter_hz=acceleration)
                known[key] = tune_with_filters(task, elements, filters).worth
            total[pair] = before.plus(known[key])
    return max(total.values())
