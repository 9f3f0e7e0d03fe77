"""Devices that are hardly known, and what a gentle first play and a full second do to them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification import (
    Device,
    Excitation,
    ExcitationSpec,
    ForceLimit,
    Hardware,
    Trajectory,
    identify,
    parse_document,
    quantity,
    to_mapping,
    to_yaml,
)
from tests.exact_axis import Axis, counted, positions

Array = NDArray[np.float64]
STEP = 1e-3


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """What is guessed, and the device as it is: up to two times off, pulled by up to 2 %."""

    guesses: dict[str, Any]
    axis: Axis

    @classmethod
    def drawn(cls, seed: int, duration: float) -> Unknown:
        """30 g to 10 kg, 50 ms to 2 s, 3 to 50 cm, with friction up to a tenth of the force."""
        dice = np.random.default_rng(seed)
        mass = 10 ** dice.uniform(-1.5, 1)
        damping = mass / 10 ** dice.uniform(-1.3, 0.3)
        travel = 10 ** dice.uniform(-1.5, -0.3)
        force = mass * travel * (2 * np.pi * 10 ** dice.uniform(-0.2, 0.5)) ** 2
        friction = force * float(dice.choice([0.0, 0.02, 0.05, 0.1]))
        guesses = {
            "sample_time": STEP,
            "duration": duration,
            "ramp": 0.2,
            "force": force,
            "travel": travel,
            "speed": travel * float(dice.choice([6.0, 100.0])),
            "mass": mass,
            "damping": damping,
            "coulomb_friction": friction,
            "encoder_resolution": travel * 10 ** dice.uniform(-5, -4),
        }
        off = 2 ** dice.uniform(-1, 1, 3)
        axis = Axis(
            mass=mass * off[0],
            damping=damping * off[1],
            coulomb=friction * off[2],
            offset=force * dice.uniform(-0.02, 0.02),
        )
        return cls(guesses=guesses, axis=axis)

    def spec(self, **keys: Any) -> ExcitationSpec:
        return parse_document(ExcitationSpec, self.guesses | keys, "guesses")

    def played(self, plan: Excitation) -> Array:
        """Position under the planned force, shape (n,), m."""
        return positions(self.axis, plan.best.force[:, None])[:, 0]

    def identified(self, plan: Excitation, position: Array) -> Device:
        """The device as its log shows it."""
        count, force = self.guesses["encoder_resolution"], self.guesses["force"]
        log = Trajectory(
            time=plan.time,
            force=plan.best.force,
            position=counted(position, count),
            stated_units=frozenset({"force"}),  # --force-gain 1: a gentle force looks like amperes
        )
        hardware = Hardware(
            sample_time=quantity(STEP),
            delay=quantity(0.0),
            encoder_resolution=quantity(count),
            force_limit=ForceLimit(continuous=force, peak=force),
        )
        return identify(log, hardware=hardware).device

    def used(self, position: Array) -> float:
        """The larger part of travel and speed that a motion uses."""
        reach = np.max(np.abs(position)) / self.guesses["travel"]
        return float(max(reach, np.max(np.abs(np.diff(position))) / STEP / self.guesses["speed"]))


def stored(device: Device, path: Path) -> str:
    """Write a device as identify does; the name of its file."""
    path.write_text(to_yaml(to_mapping(device), "first play"), encoding="utf-8")
    return path.name
