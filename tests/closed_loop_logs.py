"""Simulated devices with profiles, and closed-loop logs of their elements, right and wrong."""

from __future__ import annotations

from typing import Any

import numpy as np

from datasets_synthetic import Controller, Rig, simulate
from identification import Device, Trajectory, quantity
from tune import Verification
from tune.documents.profile import Design

T = 0.001
Sizes = tuple[float, float, float]


class Bench:
    """A simulated device, the profile written for it, and logs of an element on it."""

    def __init__(
        self,
        *,
        start: float,
        elements: dict[str, Sizes],
        velocity_filter_hz: float | None = None,
        acceleration_filter_hz: float | None = None,
        loop: dict[str, Any] | None = None,
        **truth: Any,
    ) -> None:
        self.truth: dict[str, Any] = {"sample_time": T, "delay": T, **truth}
        self.start = start
        self.elements = elements
        self.filters: dict[str, Any] = {
            "velocity_filter_hz": velocity_filter_hz or np.inf,
            "acceleration_filter_hz": acceleration_filter_hz or np.inf,
        }
        filters = {
            "velocity_filter_hz": velocity_filter_hz,
            "acceleration_filter_hz": acceleration_filter_hz,
        }
        self.profile = Design.model_validate(
            {
                "device": self._device(),
                "scene": "bench",
                "loop": {"sample_time": T, "extra_delay_samples": 1.0, **filters, **(loop or {})},
                "margin": {"name": "balanced", "gain": 2.0, "extra_delay_samples": 1},
                "elements": {name: _element(sizes) for name, sizes in elements.items()},
                "ripple_limit": 0.1,
            }
        )

    def _device(self) -> Device:
        """As it would be identified: mass to 1 %, damping to 5 %, friction to 10 %."""

        def within(name: str, part: float) -> Any:
            value = self.truth[name]
            return quantity(value, value * (1 - part), value * (1 + part))

        return Device(
            motion=self.truth.get("motion", "linear"),
            mass=within("mass", 0.01),
            damping=within("damping", 0.05),
            coulomb_friction=within("coulomb_friction", 0.1),
            position_stiffness=within("stiffness", 0.02) if "stiffness" in self.truth else None,
            sample_time=quantity(T),
            delay=quantity(T),
            encoder_resolution=self.truth["encoder_resolution"],
            force_limit={
                "continuous": self.truth["force_limit"] / 2,
                "peak": self.truth["force_limit"],
            },  # pyright: ignore[reportArgumentType]
        )

    def log(
        self,
        element: str,
        gain: float,
        *,
        samples: int = 1500,
        other: dict[str, float] | None = None,
        position: float | None = None,
        velocity: float = 0.0,
        run: dict[str, Any] | None = None,
        **controller: Any,
    ) -> Trajectory:
        """An element played at a gain; ``other`` truth of the device than the profile's."""
        K, B, M = (gain * size for size in self.elements[element])
        conditions: dict[str, Any] = dict(run or {})
        rules = {"stiffness": K, "damping": B, "mass": M, **self.filters, **controller}
        return simulate(
            Rig(**{**self.truth, **(other or {})}),
            np.zeros(samples),
            controller=Controller(**rules),
            position=self.start if position is None else position,
            velocity=velocity,
            **conditions,
        ).trajectory()


def _element(sizes: Sizes) -> dict[str, Any]:
    return {
        **dict(zip(("stiffness", "damping", "mass"), sizes, strict=True)),
        "perceived_steps": {},
        "margins": {"gain": 3.0, "extra_delay_samples": 1.0, "passive": "not-applicable"},
        "limited_by": {},
        "motion": {"penetration": 0.01, "speed": 0.2, "acceleration": 2.0},
    }


AXIS = Bench(
    mass=3.0,
    damping=10.0,
    coulomb_friction=0.8,
    encoder_resolution=6e-6,
    force_limit=28.0,
    start=0.02,
    elements={"wall": (1000.0, 10.0, 0.0), "cup": (1000.0, 10.0, 1.0), "water": (0.0, 20.0, 0.0)},
    velocity_filter_hz=50.0,
    acceleration_filter_hz=30.0,
)
STYLUS = Bench(
    mass=0.05,
    damping=0.1,
    coulomb_friction=0.02,
    encoder_resolution=2e-5,
    force_limit=3.0,
    start=0.03,
    elements={"wall": (100.0, 0.4, 0.0), "gel": (50.0, 8.0, 0.0)},
    velocity_filter_hz=100.0,
)
KNOB = Bench(
    motion="rotary",
    mass=1e-4,
    damping=5e-4,
    coulomb_friction=0.002,
    encoder_resolution=0.00076699,
    force_limit=0.15,
    start=0.6,
    elements={"detent": (0.1, 5e-4, 0.0)},
    velocity_filter_hz=100.0,
)
BENCHES = {
    "axis": (AXIS, "cup", 0.8),
    "stylus": (STYLUS, "wall", 0.5),
    "knob": (KNOB, "detent", 0.5),
}


def verdicts(seen: Verification) -> dict[str, str]:
    return {each.check: each.verdict for each in seen.outcomes}


def said(seen: Verification, check: str) -> str:
    return str(next(each for each in seen.outcomes if each.check == check))
