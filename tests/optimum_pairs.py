"""Random devices, each with a scene that asks something else of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from identification import Device, ForceLimit, quantity
from tune.documents.scene import Scene
from tune.loop.loop import Filters

#: What a scene may ask for.
KINDS = (
    "single",
    "wall",
    "block",
    "together",
    "priorities",
    "wanted",
    "range",
    "lighter",
    "light block",
    "hand",
    "three together",
    "object",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """A device and a scene of one group of elements, with filters that are given.

    Attributes:
        filters_hz: (velocity, acceleration), None for none.
    """

    kind: str
    device: Device
    scene: Scene
    filters_hz: tuple[float | None, float | None]

    @property
    def elements(self) -> list[str]:
        return list(self.scene.elements)

    @property
    def filters(self) -> Filters:
        """Only those that an effect of the scene uses."""
        wishes = {effect for one in self.scene.elements.values() for effect in one.wishes()}
        velocity, acceleration = self.filters_hz
        return Filters(
            velocity_filter_hz=velocity if "damping" in wishes else None,
            acceleration_filter_hz=acceleration if "mass" in wishes else None,
        )


def random_pair(seed: int) -> Pair:
    """Kinds take turns; everything else is drawn."""
    rng = np.random.default_rng([20_261_121, seed])
    kind = KINDS[seed % len(KINDS)]
    device = _device(rng)
    step = device.sample_time.value
    filters = (
        None if rng.random() < 0.25 else round(float(rng.uniform(0.01, 0.2) / step), 2),
        None if rng.random() < 0.1 else round(float(rng.uniform(0.008, 0.06) / step), 2),
    )
    elements, more = _elements(kind, device, rng)
    scene = Scene.model_validate(
        {
            "elements": elements,
            "margin": str(rng.choice(["conservative", "balanced", "firm"])),
            "ripple_limit": float(rng.choice([0.02, 0.1, 0.5])),
            "loop": {
                "velocity_filter_hz": filters[0] or "none",
                "acceleration_filter_hz": filters[1] or "none",
            },
            **more,
        }
    )
    return Pair(kind=kind, device=device, scene=scene, filters_hz=filters)


def _device(rng: np.random.Generator) -> Device:
    """0.05 to 95 kg, slowing down within 0.05 to 3 s, 0.2 to 2 ms a sample."""
    mass = float(10 ** rng.uniform(np.log10(0.05), np.log10(95.0)))
    damping = mass / float(10 ** rng.uniform(np.log10(0.05), np.log10(3.0)))
    step = float(rng.choice([2e-4, 5e-4, 1e-3, 2e-3]))
    spread = float(rng.choice([0.0, 0.01, 0.05]))
    stamps = float(rng.choice([0.0, 0.0, 0.01]))
    delay = float(rng.choice([0.0, 0.5, 1.0, 1.0, 2.0])) * step
    late = float(rng.choice([0.0, 0.0, 0.5])) * step
    strength = float(10 ** rng.uniform(0.5, 2))
    return Device(
        mass=quantity(mass, mass * (1 - spread), mass * (1 + spread)),
        damping=quantity(damping, damping * (1 - 2 * spread), damping * (1 + 2 * spread)),
        sample_time=quantity(step, step * (1 - stamps), step * (1 + stamps)),
        delay=quantity(delay, delay, delay + late),
        coulomb_friction=quantity(float(rng.uniform(0.0, 1.5))),
        encoder_resolution=(
            None if rng.random() < 0.3 else quantity(float(10 ** rng.uniform(-6.5, -5)))
        ),
        force_limit=(
            None if rng.random() < 0.3 else ForceLimit(continuous=strength, peak=2 * strength)
        ),
    )


def _elements(
    kind: str, device: Device, rng: np.random.Generator
) -> tuple[dict[str, Any], dict[str, Any]]:
    """(elements, the rest of the scene) of a kind."""
    mass, damping = device.mass.value, device.damping.value
    wall: dict[str, Any] = {"stiffness": "max", "damping": "max"}
    top = float(damping * rng.uniform(2, 30))
    ranked = [int(rank) for rank in rng.integers(1, 3, 2)]
    either = str(rng.choice(["damping", "mass"]))
    elements: dict[str, dict[str, Any]] = {
        "single": {"thing": {str(rng.choice(["stiffness", "damping", "mass"])): "max"}},
        "wall": {"wall": {**wall, "penetration": 0.005}},
        "block": {"block": {**wall, "mass": "max"}},
        "together": {"wall": wall, "water": {"damping": "max"}},
        "priorities": {
            "wall": {**wall, "priority": ranked[0]},
            "cup": {"mass": "max", "priority": ranked[1]},
        },
        "wanted": {"wall": {**wall, "damping": float(damping * 10 ** rng.uniform(0, 2))}},
        "range": {"wall": {**wall, "damping": {"min": damping, "max": top}}},
        "lighter": {"feather": {"mass": "min", "damping": str(rng.choice(["min", "max"]))}},
        "light block": {"block": {**wall, "mass": "min"}},
        "hand": {"block": {"stiffness": "max", either: "max"}},
        "three together": {
            "wall": {"stiffness": "max", "priority": 2},
            "water": {"damping": "max"},
            "cup": {"mass": float(mass * rng.uniform(0.3, 1.5))},
        },
        "object": {"thing": {"damping": "max", "mass": "max", "acceleration": 1.0}},
    }
    together = {
        "together": [["wall", "water"]],
        "priorities": [["wall", "cup"]],
        "three together": [["wall", "water"], ["water", "cup"]],
    }
    more: dict[str, Any] = {"together": together[kind]} if kind in together else {}
    if kind == "hand":
        more["hand"] = _hand(device, rng)
    for element in elements[kind].values():
        if "stiffness" in element:
            element.setdefault("penetration", 0.01)
    return elements[kind], more


def _hand(device: Device, rng: np.random.Generator) -> dict[str, Any]:
    mass, damping = device.mass.value, device.damping.value
    return {
        "mass": {"value": 0.1 * mass, "low": 0.05 * mass, "high": 0.3 * mass},
        "damping": {"value": damping, "low": 0.5 * damping, "high": 3.0 * damping},
        "stiffness": float(rng.choice([100.0, 1000.0])),
    }
