"""Devices and scenes to tune, and the parts of the work on them, each to be timed alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from identification import Device, as_stored, load_device
from tune.certificate.certify import certify
from tune.documents.perception import default_table
from tune.documents.profile import Certificate, Design
from tune.documents.scene import MARGINS, Scene
from tune.loop.loop import Filters
from tune.optimisation import design_of
from tune.optimisation.problem import DesignTask
from tune.optimisation.saturation import witness_of
from tune.optimisation.solve import Solution, groups, solve

#: Cut-offs where a case does not say otherwise, Hz.
FILTERS = Filters(velocity_filter_hz=50.0, acceleration_filter_hz=30.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A scene on a device, with its filters."""

    device: Device
    scene: Scene
    filters: Filters = FILTERS

    def task(self) -> DesignTask:
        """With nothing kept from earlier work."""
        return DesignTask.of(as_stored(self.device), self.scene, default_table())


def case(elements: dict[str, Any], **more: Any) -> Case:
    """A scene on HomeRehab; ``device`` changes it, ``filters`` replaces the cut-offs."""
    device = load_device("homerehab").model_copy(update=more.pop("device", {}))
    filters = more.pop("filters", FILTERS)
    wishes = {effect for element in elements.values() for effect in element}
    used = Filters(
        velocity_filter_hz=filters.velocity_filter_hz if "damping" in wishes else None,
        acceleration_filter_hz=filters.acceleration_filter_hz if "mass" in wishes else None,
    )
    scene = Scene.model_validate({"elements": elements, **more})
    return Case(device=device, scene=scene, filters=used)


def fifty_elements() -> Case:
    """Fifty things, each with numbers of its own; ten of them are felt in pairs."""
    elements: dict[str, Any] = {}
    for k in range(50):
        wall = {"stiffness": "max", "penetration": 0.004 + 0.0002 * k}
        damped = {**wall, "damping": 5.0 + 0.4 * k}
        water = {"damping": "max", "speed": 0.1 + 0.005 * k}
        cup = {"mass": "max", "acceleration": 1.0 + 0.02 * k}
        block = {"stiffness": "max", "damping": "max", "penetration": 0.005 + 0.0001 * k}
        elements[f"thing{k}"] = (wall, damped, water, cup, block)[k % 5]
    together = [[f"thing{k}", f"thing{k + 2}"] for k in (0, 10, 20, 30, 40)]
    return case(elements, together=together)


def proposal(chosen: Case, task: DesignTask) -> list[Solution]:
    """The sizes of every group."""
    return [solve(task, elements, chosen.filters) for elements in groups(chosen.scene)]


def description(chosen: Case, task: DesignTask, solutions: list[Solution]) -> Design:
    """Margins, steps, ripple and limits of every element."""
    dropped = {label: why for solved in solutions for label, why in solved.dropped.items()}
    return as_stored(design_of(task, chosen.filters, solutions, dropped))


def certificate(
    chosen: Case, task: DesignTask, solutions: list[Solution], design: Design
) -> Callable[[], Certificate]:
    """The call that certifies a design, with what proves its one-sided combinations."""
    margin = MARGINS[chosen.scene.margin]
    witnesses = {
        " + ".join(names): as_stored(witness_of(found, margin, task.slack))
        for solved in solutions
        for names, found in solved.absolute.items()
    }
    return lambda: certify(design, None, witnesses)
